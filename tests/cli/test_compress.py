"""compress, as a user runs it, on small generated logs."""

import contextlib
import gzip
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gpszip as package
from gpszip.io.values.dates import DATE_ORDERS
from gpszip.io.values.timestamps import TIME_UNITS
from gpszip.testing import city, patrol


def distances(log, archive):
    """Synchronised distance of every sample of a log to its position in the archive."""
    opened = package.open(archive)
    found = [
        np.linalg.norm(
            opened.position(track.id, track.times, metres=True) - track.positions, axis=1
        )
        for track in package.read(log)
    ]
    return np.concatenate(found)


def keep_rows(log, count):
    """Shorten a log to its first rows."""
    log.write_text("\n".join(log.read_text().splitlines()[: count + 1]) + "\n")


def test_the_rmse_is_within_the_bound_and_reported(gpszip, log):
    done = gpszip("compress", log, "-o", "walk.gpsz", "--rmse", "50cm", "--effort", "1", "--json")
    assert done.code == 0, done.err
    off = distances(log, "walk.gpsz")
    assert np.sqrt((off**2).mean()) <= 0.5
    assert done.json["rmse"] == pytest.approx(np.sqrt((off**2).mean()), rel=1e-6)
    assert done.json["max_error"] == pytest.approx(off.max(), rel=1e-6)
    assert done.json["bytes_out"] == Path("walk.gpsz").stat().st_size
    assert done.json["bytes_in"] == log.stat().st_size
    assert done.json["points"] == 200


def test_the_largest_error_is_within_the_bound(gpszip, log):
    done = gpszip(
        "compress", log, "-o", "walk.gpsz", "--max-error", "1m", "--effort", "1", "--json"
    )
    assert done.json["max_error"] <= 1
    assert distances(log, "walk.gpsz").max() <= 1


@pytest.mark.parametrize(
    ("arguments", "most"),
    [(["--bytes", "0.1KiB"], 102), (["--ratio", "20"], None)],
    ids=str,
)
def test_the_archive_is_within_the_size_asked_for(gpszip, log, arguments, most):
    keep_rows(log, 80)
    if arguments[0] == "--ratio":
        most = log.stat().st_size // 20
    done = gpszip("compress", log, "-o", "walk.gpsz", "--effort", "1", *arguments)
    assert done.code == 0, done.err
    assert len(done.err.splitlines()) == 1
    assert f"size <= {most} bytes" in done.err
    assert "RMSE 0." in done.err
    assert Path("walk.gpsz").stat().st_size <= most


def test_too_small_a_size_ends_with_6_and_no_file(gpszip, log):
    done = gpszip("compress", log, "-o", "walk.gpsz", "--bytes", "5", "--effort", "1")
    assert done.code == 6
    assert "the smallest archive takes" in done.err
    assert len(done.err.splitlines()) == 1
    assert not Path("walk.gpsz").exists()


def test_one_line_says_what_was_done(gpszip, log):
    done = gpszip("compress", log, "-o", "walk.gpsz", "--rmse", "50cm", "--effort", "1")
    assert done.out == ""
    assert len(done.err.splitlines()) == 1
    size = Path("walk.gpsz").stat().st_size
    for part in ("walk.gpsz: 200 points in 1 track", f"-> {size} B", "RMSE 0.", "maximum ", " s"):
        assert part in done.err


def test_quiet_says_nothing(gpszip, log):
    done = gpszip("compress", log, "-o", "walk.gpsz", "--rmse", "50cm", "--effort", "1", "--quiet")
    assert (done.code, done.out, done.err) == (0, "", "")


def test_without_a_bound_one_is_estimated_and_printed(gpszip, log):
    done = gpszip("compress", log, "-o", "walk.gpsz", "--effort", "1")
    assert done.code == 0
    assert "no bound was given" in done.err


def test_without_times_the_archive_is_smaller(gpszip, log):
    gpszip("compress", log, "-o", "timed.gpsz", "--rmse", "50cm", "--effort", "1")
    assert (
        gpszip(
            "compress", log, "-o", "shape.gpsz", "--rmse", "50cm", "--effort", "1", "--no-times"
        ).code
        == 0
    )
    assert Path("shape.gpsz").stat().st_size < Path("timed.gpsz").stat().st_size
    assert "times are not kept" in gpszip("info", "shape.gpsz", "--detail").out


def test_an_archive_with_a_layer_decodes_alike(gpszip, log):
    gpszip("compress", log, "-o", "plain.gpsz", "--rmse", "50cm", "--effort", "1")
    gpszip(
        "compress", log, "-o", "layered.gpsz", "--rmse", "50cm", "--effort", "1", "--layer", "bz2"
    )
    knots = [gpszip("decompress", name, "-o", "-").out for name in ("plain.gpsz", "layered.gpsz")]
    assert knots[0] == knots[1] != ""
    assert "bz2" in gpszip("info", "layered.gpsz").out


def test_standard_input_to_standard_output(shell, log):
    packed = gzip.compress(log.read_bytes())
    done = shell("compress - -o - --rmse 50cm --effort 1 --json", data=packed)
    assert done.returncode == 0, done.stderr
    assert package.open(done.stdout).ids == ("0",)
    # the numbers go to standard error if data goes to standard output
    assert json.loads(done.stderr)["bytes_out"] == len(done.stdout)


def test_degrees_come_back_as_degrees(gpszip, tmp_path):
    rows = ["vehicle,timestamp,Lat,Lon"]
    for name, (times, degrees) in city(2, vehicles=2, period=15.0, duration=300.0).items():
        rows += [
            f"{name},{1.7e9 + t:.0f},{lat:.7f},{lon:.7f}"
            for t, (lat, lon) in zip(times, degrees, strict=True)
        ]
    (tmp_path / "fleet.csv").write_text("\n".join(rows))
    assert (
        gpszip("compress fleet.csv -o fleet.gpsz --max-error 30m --gap none --effort 1").code == 0
    )
    lines = gpszip("decompress", "fleet.gpsz", "-o", "-", "--track", "bus-1").out.splitlines()
    assert lines[0] == "track_id,t,lat,lon"
    first, last = (line.split(",") for line in (lines[1], lines[-1]))
    assert float(first[1]) == pytest.approx(1.7e9, abs=1e-3)
    assert float(last[1]) == pytest.approx(1.7e9 + 285, abs=60)
    assert float(first[2]) == pytest.approx(37.98, abs=0.01)


def test_the_same_log_gives_the_same_bytes(gpszip, log):
    for name in ("one.gpsz", "two.gpsz"):
        gpszip("compress", log, "-o", name, "--rmse", "50cm", "--effort", "1")
    assert Path("one.gpsz").read_bytes() == Path("two.gpsz").read_bytes()


def test_left_out_logs_are_named_and_end_with_3(gpszip, log, tmp_path):
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    done = gpszip(
        f"compress {log} bad.csv nowhere.csv -o walk.gpsz --rmse 1m --effort 1 --skip-bad"
    )
    assert done.code == 3
    assert "left out bad.csv" in done.err
    assert "left out nowhere.csv" in done.err
    assert len(package.open("walk.gpsz").ids) == 1


def test_repairs_are_counted(gpszip, tmp_path):
    (tmp_path / "holes.csv").write_text("t,x,y,speed\n0,0,0,1\n1,,1,1\n2,2,2,1\n2,2,2,1\n3,3,3,1\n")
    run = "compress holes.csv -o holes.gpsz --rmse 1m --effort 1"
    done = gpszip(run, "--json")
    assert done.json["points"] == 3
    assert sum(repair["count"] for repair in done.json["repairs"] if repair["drops"]) == 2
    assert done.json["dropped"] == ["speed"]
    told = gpszip(run, "--force").err
    assert "not kept: speed" in told


def test_kept_columns_come_back_with_the_samples(gpszip, log):
    rows = [
        f'{row},{i * 0.5:.1f},{"" if i % 7 == 0 else i},"a, {i // 90}"'
        for i, row in enumerate(log.read_text().splitlines()[1:])
    ]
    log.write_text("\n".join(["t,x,y,speed,count,note", *rows]))
    done = gpszip(
        f"compress {log} -o walk.gpsz --rmse 50cm --effort 1 --keep", "speed,count, note", "--json"
    )
    assert done.code == 0, done.err
    assert done.json["dropped"] == []
    assert "times of the samples, speed, count, note" in gpszip("info", "walk.gpsz").out
    lines = gpszip("decompress", "walk.gpsz", "-o", "-", "--samples").out.splitlines()
    assert lines[0] == "track_id,t,x,y,speed,count,note"
    assert len(lines) == 201
    found = package.read(log, keep=["speed", "count", "note"])[0]
    Path("back.csv").write_text("\n".join(lines))
    back = package.read("back.csv", keep=["speed", "count", "note"])[0]
    np.testing.assert_array_equal(back.times, found.times)
    for name in ("speed", "count", "note"):
        np.testing.assert_array_equal(back.attributes[name], found.attributes[name])
    assert np.sqrt(((back.positions - found.positions) ** 2).sum(axis=1).mean()) <= 0.5


def test_times_are_kept_without_columns(gpszip, log):
    assert (
        gpszip(f"compress {log} -o walk.gpsz --rmse 50cm --keep-times --bytes 300 --effort 1").code
        == 2
    )
    assert (
        gpszip(
            "compress", log, "-o", "walk.gpsz", "--keep-times", "--bytes", "300", "--effort", "1"
        ).code
        == 0
    )
    assert Path("walk.gpsz").stat().st_size <= 300
    assert gpszip("decompress", "walk.gpsz", "-o", "-", "--samples", "--track", "0").out.startswith(
        "track_id,t,x,y\n0,0,"
    )
    assert gpszip("verify", "walk.gpsz").code == 0


def test_bound_that_cannot_be_met_ends_with_6_and_no_file(gpszip, log):
    keep_rows(log, 30)
    done = gpszip("compress", log, "-o", "walk.gpsz", "--rmse", "1e-9", "--effort", "1")
    assert done.code == 6
    assert "can't be held" in done.err
    assert len(done.err.splitlines()) == 1
    assert not Path("walk.gpsz").exists()


def test_losses_come_first_and_end_with_3(gpszip, log):
    rows = log.read_text().splitlines()
    log.write_text(
        "\n".join(
            [
                rows[0],
                *(f"{int(row.split(',')[0]) // 2},{row.split(',', 1)[1]}" for row in rows[1:]),
            ]
        )
        + "\n"
    )
    done = gpszip("compress", log, "-o", "walk.gpsz", "--rmse", "1m", "--effort", "1")
    assert (done.code, done.out) == (3, "")
    assert (
        done.err.splitlines()[0]
        == f"gpszip: lost 100 of 200 points of track '0' of {log}, up to 2 at one time"
    )
    done = gpszip(
        "compress", log, "-o", "walk.gpsz", "--rmse", "1m", "--effort", "1", "--force", "--json"
    )
    assert done.code == 3
    assert (done.json["points"], done.json["points_read"], done.json["points_lost"]) == (
        100,
        200,
        100,
    )
    assert done.json["losses"] == [
        {"track": "0", "where": str(log), "lost": 100, "points": 200, "shared": 2}
    ]


def test_the_order_of_dates_and_the_unit_of_numbers_can_be_given(gpszip, log):
    rows = log.read_text().splitlines()
    log.write_text(
        "\n".join(
            [
                rows[0],
                *(
                    f"03/04/2024 08:{number:02d},{row.split(',', 1)[1]}"
                    for number, row in enumerate(rows[1:50])
                ),
            ]
        )
    )
    done = gpszip("compress", log, "-o", "walk.gpsz", "--rmse", "1m", "--effort", "1")
    assert done.code == 1
    assert "can be 3 Apr 2024 or 4 Mar 2024; say which: --dates dmy or --dates mdy" in done.err
    assert (
        gpszip(
            f"compress {log} -o walk.gpsz --rmse 1m --effort 1 --dates dmy --time-unit excel"
        ).code
        == 0
    )
    for option, known in (("--time-unit", TIME_UNITS), ("--dates", DATE_ORDERS)):
        done = gpszip("compress", log, "-o", "walk.gpsz", option, "unknown")
        assert done.code == 2
        assert ", ".join(f"'{one}'" for one in known) in done.err


def read_until(terminal, word):
    """Output of a program on a terminal up to a word, or up to its end."""
    output = b""
    # At the end of the program, Linux raises an error.
    with contextlib.suppress(OSError):
        while (word is None or word not in output) and (more := os.read(terminal, 4096)):
            output += more
    return output


@pytest.mark.skipif(sys.platform == "win32", reason="terminals and signals of POSIX")
def test_interruption_ends_with_130_and_leaves_nothing(tmp_path):
    track = patrol(3000)
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack([track.times, track.positions]),
        "%.3f",
        ",",
        header="t,x,y",
        comments="",
    )
    # A process in the background of a shell ignores SIGINT.
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    script = f"{listen}\nfrom gpszip.cli.main import run; run()"
    command = [
        sys.executable,
        "-c",
        script,
        "compress",
        "log.csv",
        "-o",
        "log.gpsz",
        "--max-error",
        "2cm",
        "--effort",
        "9",
    ]
    # On a terminal, the progress says when a first step of learning is done; many follow.
    terminal, stderr = os.openpty()
    process = subprocess.Popen(command, cwd=tmp_path, stderr=stderr)
    os.close(stderr)
    assert b"learn" in read_until(terminal, b"learn")
    process.send_signal(signal.SIGINT)
    told = read_until(terminal, None)
    os.close(terminal)
    assert process.wait(60) == 130
    assert told.decode().splitlines()[-1].endswith("gpszip: interrupted; nothing was written")
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]
