"""What compress can do of logs larger than the memory given, as it is asked for on the command line."""

import csv

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import gpszip as package
from gpszip.pipeline import large
from gpszip.testing.patrol import patrol

N = 6000


@pytest.fixture(autouse=True)
def little_memory(monkeypatch):
    """Batches so small that little logs have several, and memory in which these don't fit."""
    monkeypatch.setattr(large, "_BATCH", 1500)
    monkeypatch.setattr(large, "_EXCERPT", 3000)
    monkeypatch.setattr(large, "_IN_MEMORY", 1 << 20)


@pytest.fixture
def log(tmp_path):
    """Two robots whose rows are interleaved and spread over files, with further columns."""
    room = tmp_path / "logs"
    room.mkdir()
    rng = np.random.default_rng(3)
    tables = []
    for one in (patrol(N - 2000, seed=5, id="one"), patrol(2000, seed=5, id="two")):
        n = len(one.times)
        tables.append(
            pa.table(
                {
                    "track_id": [one.id] * n, "t": one.times, "x": one.positions[:, 0], "y": one.positions[:, 1],
                    "speed": np.where(rng.random(n) < 0.1, np.nan, rng.normal(1, 0.3, n).round(2)), "gear": rng.integers(1, 6, n),
                    "note": rng.choice(["", "stop", "wall, near"], n),
                }
            )
        )  # fmt: skip
    rows = pa.concat_tables(tables).sort_by("t")
    for number, first in enumerate(range(0, N, N // 3)):
        pq.write_table(rows.slice(first, N // 3), room / f"{9 - number}.parquet")
    return room


def rows_of(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def batches(*arguments):
    return ("--rmse", "0.4m", "--effort", "1", "--memory", "420MiB", *arguments)


@pytest.mark.parametrize("keep", ["speed,gear,note", "note", None])
def test_columns_and_times_come_back_as_from_a_log_in_memory(gpszip, log, keep):
    choice = ("--keep-times",) if keep is None else ("--keep", keep)
    assert gpszip("compress", log, "-o", "large.gpsz", *batches(*choice)).code == 0
    assert gpszip("compress", log, "-o", "small.gpsz", "--rmse", "0.4m", "--effort", "1", *choice).code == 0
    for name in ("large", "small"):
        assert gpszip("decompress", f"{name}.gpsz", "-o", f"{name}.csv", "--samples").code == 0
    found, wanted = rows_of("large.csv"), rows_of("small.csv")
    assert len(found) == len(wanted) == N
    exact = [column for column in wanted[0] if column not in ("x", "y")]
    assert {tuple(row[column] for column in exact) for row in found} == {tuple(row[column] for column in exact) for row in wanted}
    assert gpszip("verify", "large.gpsz").code == 0


def test_a_column_that_is_not_there_or_has_a_name_of_ours_is_refused(gpszip, log):
    for keep, says in (("fuel", "fuel"), ("x", "can't be kept besides")):
        done = gpszip("compress", log, "-o", "a.gpsz", *batches("--keep", keep))
        assert done.code in (1, 2)
        assert says in done.err


def test_without_times_the_shape_is_left(gpszip, log):
    done = gpszip("compress", log, "-o", "a.gpsz", *batches("--no-times"))
    assert done.code == 0, done.err
    assert "times were left out" in done.err
    archive = package.open("a.gpsz")
    assert not archive.timed
    assert len(archive.paths()) == 2


def test_the_bz2_layer_and_a_coreset_go_with_batches(gpszip, log):
    done = gpszip("compress", log, "-o", "a.gpsz", *batches("--layer", "bz2", "--coreset", "200", "--json"))
    assert done.code == 0, done.err
    assert done.json["rmse"] <= 0.4
    assert gpszip("info", "a.gpsz", "--json").json["layer"] == "bz2"
