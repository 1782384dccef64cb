"""gpszip coreset, as a user runs it."""

import numpy as np
import pyarrow.parquet as pq
import pytest

import gpszip as package
from gpszip.sketches.pieces import polyline


def test_a_coreset_bounds_the_cost_of_a_function(gpszip, log):
    done = gpszip("coreset", log, "-o", "c.parquet", "--size", "20", "--k", "3", "--json")
    assert done.code == 0, done.err
    assert done.json["samples"] == 200
    assert done.json["blocks"] <= 20
    (track,) = package.read(log)
    small = package.open_coreset("c.parquet")
    f = polyline(track.times[[0, 90, 199]], track.positions[[0, 90, 199]])
    at = np.stack(
        [
            np.interp(track.times, track.times[[0, 90, 199]], axis[[0, 90, 199]])
            for axis in track.positions.T
        ],
        axis=1,
    )
    assert small.cost(f).lower <= ((at - track.positions) ** 2).sum() <= small.cost(f).upper


def test_the_summary_states_the_bounds(gpszip, log):
    done = gpszip("coreset", log, "-o", "c.parquet", "--k", "2", "--eps", "0.5")
    assert done.code == 0, done.err
    assert "c.parquet: 200 samples in" in done.err
    assert "any 2-segment costs" in done.err
    assert "(50 % asked for)" in done.err
    assert "uneven" not in done.err
    assert done.out == ""
    rows = log.read_text().splitlines()
    log.write_text("\n".join(rows[:50] + rows[60:]))
    done = gpszip("coreset", log, "-o", "c.parquet", "--k", "2", "--eps", "0.5", "--force")
    assert "for a break in a block of uneven times (1 of" in done.err


@pytest.mark.parametrize(("k", "eps"), [("2", "0.5"), ("20", "0.5"), ("90", "0.1")])
def test_the_relative_error_is_within_the_one_asked_for(gpszip, log, k, eps):
    done = gpszip("coreset", log, "-o", "c.parquet", "--k", k, "--eps", eps, "--json")
    assert done.code == 0, done.err
    assert done.json["eps_asked"] == float(eps)
    assert done.json["eps"] <= float(eps)
    assert package.open_coreset("c.parquet").eps(int(k)) == done.json["eps"]


def test_the_summary_of_a_small_coreset_states_no_bound(gpszip, log):
    done = gpszip("coreset", log, "-o", "c.parquet", "--size", "3", "--k", "20")
    assert done.code == 0, done.err
    assert "too few blocks for a bound on the error of its cost" in done.err


def test_points_are_rows_of_the_log_with_weights(gpszip, log):
    done = gpszip("coreset", log, "-o", "points.parquet", "--size", "4", "--points")
    assert done.code == 0, done.err
    table = pq.read_table("points.parquet")
    assert {"track_id", "t", "weight"} <= set(table.column_names)
    assert table.num_rows <= 4 * 8
    assert sum(table.column("weight").to_pylist()) == pytest.approx(200)
    assert "weighted points" in done.err


def test_the_file_is_as_small_as_asked(gpszip, log, tmp_path):
    assert gpszip("coreset", log, "-o", "c.parquet", "--max-bytes", "12kB").code == 0
    assert (tmp_path / "c.parquet").stat().st_size <= 12_000


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--eps", "0.5"],
        ["--size", "3", "--max-bytes", "9kB"],
        ["--size", "3", "--eps", "0.5", "--k", "2"],
        ["--eps", "2"],
    ],
)
def test_sizes_that_contradict_each_other_are_refused(gpszip, log, tmp_path, options):
    done = gpszip("coreset", log, "-o", "c.parquet", *options)
    assert done.code == 2
    assert done.err.startswith("gpszip: ")
    assert not (tmp_path / "c.parquet").exists()


def test_an_existing_file_is_kept_and_a_bad_log_is_left_out(gpszip, log, tmp_path):
    (tmp_path / "bad.csv").write_text("t,x,y\n")
    assert gpszip("coreset", log, "bad.csv", "-o", "c.parquet", "--size", "3").code == 1
    done = gpszip("coreset", log, "bad.csv", "-o", "c.parquet", "--size", "3", "--skip-bad")
    assert done.code == 3
    assert "bad.csv" in done.err
    assert gpszip("coreset", log, "-o", "c.parquet", "--size", "3").code == 1
    assert gpszip("coreset", log, "-o", "c.parquet", "--size", "3", "--force", "--quiet").err == ""


def test_standard_input_is_read_as_a_file_is(gpszip, log, tmp_path):
    done = gpszip("coreset", "-", "-o", "piped.parquet", "--size", "9", data=log.read_bytes())
    assert done.code == 0, done.err
    assert "200 samples in 9 blocks" in done.err
    named = f"coreset {log} -o named.parquet --size 9 --engine threads --workers 3"
    assert gpszip(named).code == 0
    assert (tmp_path / "piped.parquet").read_bytes() == (tmp_path / "named.parquet").read_bytes()


def test_tracks_are_split_where_time_goes_back(gpszip, tmp_path):
    (tmp_path / "laps.csv").write_text(
        "t,x,y\n" + "".join(f"{t},{t},{lap}\n" for lap in range(3) for t in range(50))
    )
    assert gpszip("coreset", "laps.csv", "-o", "c.parquet", "--size", "9").code == 1
    done = gpszip("coreset", "laps.csv", "-o", "c.parquet", "--size", "9", "--split")
    assert done.code == 0, done.err
    assert "2 tracks started where time goes back" in done.err
    assert package.open_coreset("c.parquet").tracks == ("0", "0-2", "0-3")


def test_compress_learns_from_a_coreset(gpszip, log):
    done = gpszip(f"compress {log} -o walk.gpsz --rmse 1m --coreset 12 --effort 1 --json")
    assert done.code == 0, done.err
    assert done.json["points"] == 200
    assert done.json["rmse"] <= 1


@pytest.mark.parametrize(
    ("options", "refused"),
    [
        ("--dry-run", "--dry-run takes a log"),
        ("--track other", "--bbox takes a log"),
        ("--since 5", "--bbox takes a log"),
        ("--sort", "--sort takes a log"),
        ("--memory 1GiB", "--memory takes a log"),
        ("--skip-bad", "--skip-bad takes a log"),
        ("--format parquet", "--format takes a log"),
        ("--topic /odom", "--topic takes a log"),
    ],
)
def test_what_needs_the_samples_is_refused_for_a_coreset(gpszip, log, tmp_path, options, refused):
    assert gpszip(f"coreset {log} -o blocks.parquet --size 12").code == 0
    run = gpszip(f"compress blocks.parquet -o walk.gpsz --rmse 5 {options}")
    assert run.code == 2
    assert refused in run.err
    assert not (tmp_path / "walk.gpsz").exists()


def test_a_coreset_is_told_from_a_log(gpszip, log, tmp_path, monkeypatch):
    assert gpszip(f"coreset {log} -o blocks.parquet --size 12").code == 0
    for arguments in (f"{log} blocks.parquet", "-"):
        data = (tmp_path / "blocks.parquet").read_bytes()
        run = gpszip(f"compress {arguments} -o walk.gpsz --rmse 5", data=data)
        assert run.code == 1
        name = "standard input" if arguments == "-" else "blocks.parquet"
        assert f"{name}: is the coreset of a log, not a log; give the log" in run.err

    # Memory for logs that the environment states is no mistake.
    monkeypatch.setenv("GPSZIP_MEMORY", "1GiB")
    assert gpszip("compress blocks.parquet -o walk.gpsz --rmse 5 --effort 1").code == 0
