"""compress with --memory, on logs larger than that."""

import csv
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gpszip as package
from batches import force_batches
from gpszip.testing.patrol import patrol

N = 2400


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """Make batches so small that small logs have several, and don't fit in memory."""
    force_batches(monkeypatch, batch=1000, subsample=1200)


@pytest.fixture
def log(tmp_path):
    """Two robots whose rows are interleaved and spread over files, with columns to keep."""
    folder = tmp_path / "logs"
    folder.mkdir()
    rng = np.random.default_rng(3)
    tables = []
    for track in (patrol(N - 800, seed=5, id="one"), patrol(800, seed=5, id="two")):
        n = len(track.times)
        columns = {
            "track_id": [track.id] * n,
            "t": track.times,
            "x": track.positions[:, 0],
            "y": track.positions[:, 1],
            "speed": np.where(rng.random(n) < 0.1, np.nan, rng.normal(1, 0.3, n).round(2)),
            "gear": rng.integers(1, 6, n),
            "note": rng.choice(["", "stop", "wall, near"], n),
        }
        tables.append(pa.table(columns))
    rows = pa.concat_tables(tables).sort_by("t")
    for number, first in enumerate(range(0, N, N // 3)):
        pq.write_table(rows.slice(first, N // 3), folder / f"{9 - number}.parquet")
    return folder


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def batches(*arguments):
    return ("--rmse", "0.4m", "--effort", "1", "--memory", "420MiB", *arguments)


@pytest.mark.parametrize("keep", ["speed,gear,note", "note", None])
def test_columns_and_times_are_kept_as_from_a_log_in_memory(gpszip, log, keep):
    choice = ("--keep-times",) if keep is None else ("--keep", keep)
    assert gpszip("compress", log, "-o", "large.gpsz", *batches(*choice)).code == 0
    assert (
        gpszip("compress", log, "-o", "small.gpsz", "--rmse", "0.4m", "--effort", "1", *choice).code
        == 0
    )
    for name in ("large", "small"):
        assert gpszip("decompress", f"{name}.gpsz", "-o", f"{name}.csv", "--samples").code == 0
    found, wanted = rows_of("large.csv"), rows_of("small.csv")
    assert len(found) == len(wanted) == N
    exact = [column for column in wanted[0] if column not in ("x", "y")]
    assert {tuple(row[column] for column in exact) for row in found} == {
        tuple(row[column] for column in exact) for row in wanted
    }
    assert gpszip("verify", "large.gpsz").code == 0


def test_a_missing_column_and_a_reserved_name_are_refused(gpszip, log):
    for keep, says in (("fuel", "fuel"), ("x", "can't be kept: positions have")):
        done = gpszip("compress", log, "-o", "a.gpsz", *batches("--keep", keep))
        assert done.code in (1, 2)
        assert says in done.err


def test_without_times_the_shape_is_kept(gpszip, log):
    done = gpszip("compress", log, "-o", "a.gpsz", *batches("--no-times"))
    assert done.code == 0, done.err
    assert "times were left out" in done.err
    archive = package.open("a.gpsz")
    assert not archive.timed
    assert len(archive.shapes()) == 2


def test_the_bz2_layer_and_a_coreset_go_with_batches(gpszip, log):
    done = gpszip(
        "compress", log, "-o", "a.gpsz", *batches("--layer", "bz2", "--coreset", "200", "--json")
    )
    assert done.code == 0, done.err
    assert done.json["rmse"] <= 0.4
    assert gpszip("info", "a.gpsz", "--json").json["layer"] == "bz2"


def halves(log):
    """The log in two folders, split at the median time."""
    rows = pa.concat_tables([pq.read_table(path) for path in log.glob("*.parquet")]).sort_by("t")
    middle = float(np.median(rows["t"].to_numpy()))
    early = rows["t"].to_numpy() < middle
    for name, which in (("early", early), ("late", ~early)):
        (log.parent / name).mkdir()
        pq.write_table(rows.filter(pa.array(which)), log.parent / name / "a.parquet")
    return log.parent / "early", log.parent / "late"


def rmse_of(archive, log):
    errors = [
        np.linalg.norm(archive.position(one.id, one.times, metres=True) - one.positions, axis=1)
        for one in package.read(str(log))
    ]
    return float(np.sqrt((np.concatenate(errors) ** 2).mean()))


@pytest.mark.parametrize("keep", [(), ("--keep", "note,gear,speed")])
def test_logs_are_appended_in_batches(gpszip, log, keep):
    early, late = halves(log)
    for first in ((), ("--memory", "420MiB")):
        assert (
            gpszip(
                f"compress {early} -o a.gpsz --rmse 0.4m --effort 1 --append",
                *keep,
                *first,
                "--force",
            ).code
            == 0
        )
        done = gpszip(
            f"compress {late} -o a.gpsz --effort 1 --append --memory 420MiB", *keep, "--json"
        )
        assert done.code == 0, done.err
        archive = package.open("a.gpsz")
        assert done.json["rmse"] <= 0.4
        assert rmse_of(archive, early) <= 0.4
        assert rmse_of(archive, late) == pytest.approx(done.json["rmse"], rel=1e-6)
        assert archive.error_bound.metres == 0.4
        if keep:
            for track in package.read(str(log), keep=["note", "gear", "speed"], sort=True):
                assert np.array_equal(archive.sample_times(track.id), track.times)
                for name, values in archive.attributes(track.id).items():
                    assert np.array_equal(values, track.attributes[name], equal_nan=name == "speed")
        (log.parent / "a.gpsz").unlink()


def test_appended_tracks_continue_those_of_the_archive(gpszip, log):
    early, late = halves(log)
    assert gpszip("compress", early, "-o", "a.gpsz", "--rmse", "0.4m", "--effort", "1").code == 0
    assert (
        gpszip(
            "compress", late, "-o", "a.gpsz", "--effort", "1", "--append", "--memory", "420MiB"
        ).code
        == 0
    )
    assert not package.open("a.gpsz").walk("one").gaps.any()
    before = (log.parent / "a.gpsz").read_bytes()
    done = gpszip(
        "compress", early, "-o", "a.gpsz", "--effort", "1", "--append", "--memory", "420MiB"
    )
    assert done.code == 2
    assert "overlaps in time with the one in the archive" in done.err
    assert (log.parent / "a.gpsz").read_bytes() == before


def test_batches_are_encoded_on_a_known_map_which_is_updated(gpszip, log):
    early, late = halves(log)
    assert gpszip("compress", early, "-o", "map.gpsz", "--rmse", "0.4m", "--effort", "1").code == 0
    done = gpszip(
        f"compress {late} -o on.gpsz --map map.gpsz --update-map new.gpsz",
        *batches("--json", "--keep", "gear"),
    )
    assert done.code == 0, done.err
    archive = package.open("on.gpsz")
    assert archive.contents.map is not None
    assert rmse_of(archive, late) == pytest.approx(done.json["rmse"], rel=1e-6)
    assert archive.kept_columns == ("gear",)
    alone = gpszip("compress", late, "-o", "alone.gpsz", *batches("--json", "--keep", "gear"))
    assert done.json["bytes_out"] < alone.json["bytes_out"]
    assert rmse_of(package.open("new.gpsz"), late) <= 0.4


def test_a_map_too_coarse_for_the_bound_is_not_used(gpszip, log):
    assert gpszip("compress", log, "-o", "map.gpsz", "--rmse", "20m", "--effort", "1").code == 0
    done = gpszip("compress", log, "-o", "on.gpsz", "--map", "map.gpsz", *batches())
    assert done.code == 0, done.err
    assert "the map's grid is too coarse for the bound" in done.err
    assert rmse_of(package.open("on.gpsz"), log) <= 0.4


@pytest.mark.parametrize("choice", [("--no-times",), ("--layer", "bz2")])
def test_options_that_contradict_a_map_are_refused(gpszip, log, choice):
    assert gpszip("compress", log, "-o", "map.gpsz", "--rmse", "0.4m", "--effort", "1").code == 0
    done = gpszip("compress", log, "-o", "on.gpsz", "--map", "map.gpsz", *batches(*choice))
    assert done.code == 2
    assert "a known map (--map, --append) doesn't go with" in done.err


def test_a_log_far_from_the_map(gpszip, log, tmp_path):
    assert gpszip("compress", log, "-o", "map.gpsz", "--rmse", "0.4m", "--effort", "1").code == 0
    rows = "".join(f"{t},{48 + t / 1e5},{11 + t / 1e5}\n" for t in range(900))
    (tmp_path / "earth.csv").write_text("t,lat,lon\n" + rows)
    done = gpszip(
        "compress", tmp_path / "earth.csv", "-o", "on.gpsz", "--map", "map.gpsz", *batches()
    )
    assert done.code == 2
    assert "the log latitude and longitude" in done.err


def test_a_size_with_columns_kept(gpszip, log, monkeypatch):
    force_batches(monkeypatch, batch=450, subsample=650)
    early = log.parent / "early.parquet"
    pq.write_table(pq.read_table(log / "9.parquet"), early)
    how = ("--effort", "1", "--memory", "420MiB", "--keep", "gear")
    done = gpszip("compress", early, "-o", "a.gpsz", *how, "--bytes", "1kB")
    assert done.code == 6
    kept = int(done.err.split("exactly takes ")[1].split(";")[0].replace(",", ""))
    done = gpszip("compress", early, "-o", "a.gpsz", *how, "--bytes", kept + 150, "--json")
    assert done.code == 0, done.err
    assert (
        kept + 130 < done.json["bytes_out"] == (log.parent / "a.gpsz").stat().st_size <= kept + 150
    )


def test_a_table_without_times_is_compressed_in_batches(gpszip, tmp_path):
    x = np.arange(N) / 2
    rows = "".join(f"{a:.1f},{40 * np.sin(a / 90):.3f}\n" for a in x)
    (tmp_path / "route.csv").write_text("x,y\n" + rows)
    done = gpszip("compress", "route.csv", "-o", "a.gpsz", *batches())
    assert "--no-times" in done.err
    done = gpszip("compress", "route.csv", "-o", "a.gpsz", *batches("--no-times", "--json"))
    assert done.code == 0, done.err
    assert (done.json["points"], done.json["rmse"] <= 0.4) == (N, True)
    assert not package.open("a.gpsz").timed


def test_outliers_are_dropped_and_counted(gpszip, log):
    rows = pq.read_table(log / "9.parquet")
    xs = rows["x"].to_numpy().copy()
    xs[[100, 700]] += 5000
    pq.write_table(rows.set_column(2, "x", pa.array(xs)), log / "9.parquet")
    done = gpszip("compress", log, "-o", "a.gpsz", *batches("--clean", "--json"))
    assert done.code == 0, done.err
    assert (
        sum(one["count"] for one in done.json["repairs"] if one["what"] == "outliers dropped") == 2
    )
    assert done.json["points"] == N - 2


def test_segment_means_of_large_logs_are_refused(gpszip, log):
    done = gpszip("compress", log, "-o", "a.gpsz", "--k", "20", "--m", "5", "--memory", "420MiB")
    assert done.code == 2
    assert "allow more with --memory" in done.err


#: Whoever runs the tests may have them ignore signals, and so would what they start.
COMPRESS_STDIN = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from gpszip.cli.main import main
sys.exit(main(["compress", "-", "-o", "a.gpsz", "--memory", "420MiB"]))
"""


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_run_that_gets_a_signal_leaves_no_temporary_file(tmp_path, number):
    """Standard input stays open, so that the run waits for more of it with a temporary file."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    run = subprocess.Popen(
        [sys.executable, "-c", COMPRESS_STDIN],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(folder)},
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with run:
        run.stdin.write(b"t,x,y\n" + b"0,0,0\n" * 1000)
        run.stdin.flush()
        while not list(folder.glob("gpszip-*/*")):
            assert run.poll() is None
            time.sleep(0.02)
        run.send_signal(getattr(signal, number))
        assert run.wait(60) == 130
        assert b"interrupted; nothing was written" in run.stderr.read()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["temporary"]
    assert not list(folder.iterdir())
