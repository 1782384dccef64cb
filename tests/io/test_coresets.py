"""Coresets as files: they are read as written; damaged and other files are refused."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gpszip
from gpszip import InputError, OutputError, Track, coreset
from gpszip.io.coresets import read_coreset, write_coreset
from gpszip.sketches.partition import max_file_size
from gpszip.testing.patrol import patrol


def test_a_saved_coreset_comes_back(tmp_path):
    small = coreset([patrol(500), Track("z ü", range(3), np.zeros((3, 2)), [1, 2, 1])], size=9)
    gpszip.save_coreset(small, tmp_path / "c.parquet")
    again = gpszip.open_coreset(tmp_path / "c.parquet")
    assert again.tracks == small.tracks
    assert np.array_equal(again.rows, small.rows)
    assert np.array_equal(again.owners, small.owners)
    with pytest.raises(OutputError, match="exists already"):
        gpszip.save_coreset(small, tmp_path / "c.parquet")
    gpszip.save_coreset(small, tmp_path / "c.parquet", force=True)


def test_the_plane_is_kept(tmp_path):
    from gpszip.io.logs.read import read_logs

    log = tmp_path / "log.csv"
    log.write_text("t,lat,lon\n" + "".join(f"{i},{52 + i / 1e4},13\n" for i in range(50)))
    small = coreset(read_logs(str(log)).tracks, size=3)
    gpszip.save_coreset(small, tmp_path / "c.parquet")
    assert gpszip.open_coreset(tmp_path / "c.parquet").plane == small.plane is not None


@pytest.mark.parametrize("dimension", [1, 3])
@pytest.mark.parametrize("max_bytes", [10_000, 60_000, 400_000])
def test_the_file_is_not_larger_than_max_bytes(dimension, max_bytes):
    n = 20_000
    small = coreset(
        Track("0", np.arange(n), np.random.default_rng(1).normal(0, 1, (n, dimension))),
        max_bytes=max_bytes,
    )
    file = io.BytesIO()
    write_coreset(small, file)
    assert len(file.getvalue()) <= max_file_size(len(small), 1, dimension) <= max_bytes
    assert len(file.getvalue()) > 0.15 * max_bytes


def changed(small, **columns):
    file = io.BytesIO()
    write_coreset(small, file)
    table = pq.read_table(file)
    for name, values in columns.items():
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    out = io.BytesIO()
    pq.write_table(table, out)
    return out


@pytest.mark.parametrize(
    "columns",
    [
        {"weight": [1.0, -1.0]},
        {"spread": [np.nan, 1.0]},
        {"jitter": [-1.0, 0.0]},
        {"track": ["0", "?"]},
        {"first": [0.0, 0.0]},
        {"weight": ["a", "b"]},
        {"depth": [-9e18, 1.0]},
        {"reach": [1e300, 1.0]},
        {"drift_0": [1e200, 1.0]},
    ],
)
def test_damaged_blocks_are_refused(columns):
    small = coreset(patrol(100), size=2)
    assert len(small) == 2
    assert np.array_equal(read_coreset(changed(small)).rows, small.rows)
    with pytest.raises(InputError):
        read_coreset(changed(small, **columns))


def test_other_files_are_no_coresets(tmp_path):
    with pytest.raises(InputError, match="can't be read"):
        gpszip.open_coreset(tmp_path / "none.parquet")
    (tmp_path / "text.parquet").write_text("text")
    with pytest.raises(InputError, match="can't be read"):
        gpszip.open_coreset(tmp_path / "text.parquet")
    pq.write_table(pa.table({"t": [1.0]}), tmp_path / "log.parquet")
    with pytest.raises(InputError, match="is no coreset"):
        gpszip.open_coreset(tmp_path / "log.parquet")
