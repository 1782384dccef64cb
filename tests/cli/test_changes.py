"""gpszip changes, as a user runs it."""

import csv
import json

import pytest

import gpszip as package
from gpszip.testing import close_road, fleet


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """An archive in which a road is closed halfway, and one in which it is not."""
    folder = tmp_path_factory.mktemp("town")
    base = fleet(4, lines=2, points=1500, blocks=4, seed=5)
    closed = close_road(base, 8, since=3800.0)
    package.compress(closed.tracks, rmse=6, effort=1).save(folder / "closed.gpsz")
    package.compress(base.tracks, rmse=6, effort=1).save(folder / "base.gpsz")
    return folder


def test_closures_are_told_and_written(gpszip, files, tmp_path):
    done = gpszip(f"changes {files / 'closed.gpsz'} --since 3800 -o c.csv")
    assert done.code == 0, done.err
    assert "closed: edge" in done.out
    rows = list(csv.DictReader((tmp_path / "c.csv").read_text().splitlines()))
    assert {"kind", "edge", "forward", "since", "evidence", "x", "y"} <= set(rows[0])
    closed = [row for row in rows if row["kind"] == "closed"]
    assert len(closed) == 2
    assert all(float(row["detected"]) >= float(row["since"]) >= 3800 for row in closed)

    gpszip(f"changes {files / 'closed.gpsz'} --since 3800 --kinds closed -o c.geojson")
    features = json.loads((tmp_path / "c.geojson").read_text())["features"]
    assert [f["properties"]["edge"] for f in features] == [int(row["edge"]) for row in closed]


def test_two_archives_and_none(gpszip, files, tmp_path):
    facts = gpszip(f"changes {files / 'base.gpsz'} {files / 'closed.gpsz'} --json").json
    assert facts["threshold"] >= 7
    none = gpszip(f"changes {files / 'base.gpsz'} --since 3800 -o c.csv --threshold 9.2")
    assert "0 changes" in none.out
    assert none.out.splitlines()[0].endswith("from 9.2 nats of evidence on")
    assert len((tmp_path / "c.csv").read_text().splitlines()) == 1


def test_mistakes_are_told(gpszip, files):
    base = files / "base.gpsz"
    assert "--since" in gpszip(f"changes {base}").err
    assert "--since" in gpszip(f"changes {base} {base} --since 10").err
    assert (
        "leave out one"
        in gpszip(f"changes {base} --since 3800 --threshold 9.2 --false-alarms 0.1").err
    )
    assert "outside" in gpszip(f"changes {base} --since 2024-05-01").err
    assert "no change" in gpszip(f"changes {base} --since 3800 --kinds gone").err
    assert "not as .txt" in gpszip(f"changes {base} --since 3800 -o c.txt").err
