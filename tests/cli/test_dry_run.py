"""compress --dry-run says what would be read and written, and writes nothing."""

import gzip
import json
from pathlib import Path

import pytest

from gpszip.io.logs.write import write_tracks
from gpszip.testing import patrol


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def rounds(tmp_path):
    """A log of 24,000 points, of which parts are compressed for the estimate."""
    path = tmp_path / "patrol.csv"
    write_tracks([patrol(24_000, seed=3)], path)
    return path


def test_nothing_is_written_and_the_archive_would_be_as_large(gpszip, log, tmp_path):
    before = files_in(tmp_path)
    arguments = ("compress walk.csv --rmse 50cm --effort 1 --json",)
    dry = gpszip(*arguments, "--dry-run")
    assert dry.code == 0, dry.err
    assert files_in(tmp_path) == before
    done = gpszip(*arguments).json
    # 200 points are compressed as a whole.
    assert dry.json["estimated_bytes"] == done["bytes_out"]
    assert dry.json["sampled_points"] == done["points"] == 200
    for fact in ("output", "bytes_in", "tracks", "bound", "gap", "points_read", "repairs"):
        assert dry.json[fact] == done[fact], fact


def test_a_person_reads_files_rows_bound_and_estimate(gpszip, rounds):
    dry = gpszip("compress patrol.csv --rmse 24cm --effort 1 --dry-run")
    assert dry.code == 0, dry.err
    lines = dict(line.split("  ", 1) for line in dry.out.splitlines())
    lines = {label.strip(): text.strip() for label, text in lines.items()}
    assert lines["read"].startswith("patrol.csv (csv, ")
    assert lines["rows"] == "24,000"
    assert lines["tracks"] == "1"
    assert lines["coordinates"] == "x,y"
    assert lines["bound"] == "RMSE <= 0.24 m"
    assert lines["estimate"].startswith("about ")
    assert "points of 24,000" in lines["estimate"]
    assert "estimated" in lines["CPU time"]
    assert lines["written"].startswith("nothing")
    assert "patrol.gpsz" in lines["written"]


def test_an_estimated_bound_is_named(gpszip, log):
    dry = gpszip("compress walk.csv --effort 1 --dry-run")
    assert "no bound was given" in dry.out


def test_repairs_losses_and_columns_are_named(gpszip, log):
    rows = log.read_text().splitlines()
    rows = [f"{row},note" for row in rows]
    rows[5] = "nonsense,0,0,note"
    log.write_text("\n".join(rows))
    dry = gpszip("compress walk.csv --effort 1 --rmse 1 --dry-run")
    assert dry.code == 0
    assert "of which 1 are dropped" in dry.out
    assert "not kept" in dry.out
    assert "rows without" in dry.out or "row without" in dry.out

    # A log that is kept exactly has all columns.
    dry = gpszip("compress walk.csv --effort 1 --rmse 1 --lossless --dry-run")
    assert "of which 1 are dropped" in dry.out
    assert "not kept" not in dry.out


@pytest.mark.parametrize("packed", [False, True])
def test_standard_input_is_described_too(gpszip, log, tmp_path, packed):
    data = log.read_bytes()
    log.unlink()
    done = gpszip(
        "compress - -o walk.gpsz --rmse 1 --effort 1 --dry-run --json",
        data=gzip.compress(data) if packed else data,
    )
    assert done.code == 0, done.err
    found = done.json
    assert found["files"][0]["format"] == "csv"
    assert found["points"] == 200
    assert files_in(tmp_path) == []


def test_a_size_is_not_tried(gpszip, log):
    dry = gpszip("compress walk.csv --bytes 90 --dry-run --json")
    assert (dry.json["estimated_bytes"], dry.json["estimated_cpu_seconds"]) == (90, None)
    assert "at most" in gpszip("compress walk.csv --bytes 90 --dry-run").out
    assert "none" in gpszip("compress walk.csv --k 4 --m 2 --dry-run").out


def test_mistakes_are_those_of_the_real_run(gpszip, log, tmp_path):
    Path("walk.gpsz").write_bytes(b"old")
    assert gpszip("compress walk.csv --rmse 1 --dry-run").code == 1
    assert gpszip("compress walk.csv --rmse 1 --dry-run --force").code == 0
    assert Path("walk.gpsz").read_bytes() == b"old"
    assert gpszip("compress none.csv --rmse 1 --dry-run").code == 1
    assert gpszip("compress walk.csv --rmse 1 --bytes 9 --dry-run").code == 2


def test_logs_left_out_end_with_3(gpszip, log):
    Path("bad.gpx").write_text("<gpx><trk>")
    dry = gpszip("compress walk.csv bad.gpx -o all.gpsz --skip-bad --rmse 1 --effort 1 --dry-run")
    assert dry.code == 3
    assert "left out bad.gpx" in dry.err


def test_what_would_be_appended_is_estimated(gpszip, log, tmp_path):
    assert gpszip("compress walk.csv --rmse 1 --effort 1").code == 0
    first = Path("walk.gpsz").read_bytes()
    header, *rows = log.read_text().splitlines()
    log.write_text("\n".join([f"id,{header}", *(f"b,{row}" for row in rows)]))
    appended = gpszip("compress walk.csv -o walk.gpsz --append --effort 1 --dry-run --json")
    assert appended.code == 0, appended.err
    assert Path("walk.gpsz").read_bytes() == first
    done = gpszip("compress walk.csv -o walk.gpsz --append --effort 1 --json")
    assert appended.json["estimated_bytes"] == done.json["bytes_out"]


def test_logs_larger_than_memory_are_estimated_in_it(shell, tmp_path):
    # Two million rows of a robot that goes round in a circle take more than 400 MiB.
    pytest.importorskip("pyarrow")
    import numpy as np
    import pyarrow as pa
    from pyarrow import parquet

    n = 2_000_000
    angle = np.arange(n) / 300
    table = {"t": np.arange(n) / 10, "x": 40 * np.cos(angle), "y": 40 * np.sin(angle)}
    parquet.write_table(pa.table(table), tmp_path / "big.parquet")
    done = shell("compress big.parquet --rmse 1 --effort 1 --memory 400MiB --dry-run --json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["points"] == n
    assert found["t_end"] == (n - 1) / 10
    assert files_in(tmp_path) == ["big.parquet"]
