"""gpszip usage, as a user runs it."""

import csv
import json

import pytest

from gpszip.testing import fleet


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """A log of two vehicles on the Earth with dates."""
    rows = ["track_id,t,lat,lon"]
    for track in fleet(2, lines=1, points=400, blocks=3, seed=2).tracks:
        for time, (x, y) in zip(track.times, track.positions, strict=True):
            lat, lon = 52.5 + y / 111_000, 13.4 + x / 67_600
            rows.append(f"{track.id},{1_704_090_000 + time:.0f},{lat:.7f},{lon:.7f}")
    folder = tmp_path_factory.mktemp("town")
    (folder / "town.csv").write_text("\n".join(rows))
    return folder


@pytest.fixture(autouse=True)
def archive(gpszip, town, tmp_path):
    """The archive of the log, compressed once, in the folder of each test."""
    if not (town / "town.gpsz").exists():
        done = gpszip(f"compress {town / 'town.csv'} -o {town / 'town.gpsz'} --rmse 6m --effort 1")
        assert done.code == 0
    for name in ("town.csv", "town.gpsz"):
        (tmp_path / name).write_bytes((town / name).read_bytes())


def test_table_has_hours_and_speeds(gpszip, tmp_path):
    done = gpszip("usage town.gpsz -o u.csv --timezone Europe/Berlin")
    assert done.code == 0
    assert "Europe/Berlin" in done.out
    rows = list(csv.DictReader((tmp_path / "u.csv").read_text().splitlines()))
    wanted = ["edge", "forward", "hour", "weekday", "traversals", "speed", "speed_q1", "speed_q3"]
    assert set(wanted) <= set(rows[0])
    assert {row["hour"] for row in rows} == {"7"}
    assert {row["weekday"] for row in rows} == {"0"}
    assert sum(int(row["traversals"]) for row in rows) > 20
    for row in rows:
        if row["speed"]:
            assert float(row["speed_q1"]) <= float(row["speed"]) <= float(row["speed_q3"])


def test_lines_lie_in_the_town(gpszip, tmp_path):
    assert gpszip("usage town.gpsz -o u.geojson --by none").code == 0
    features = json.loads((tmp_path / "u.geojson").read_text())["features"]
    for feature in features:
        lon, lat = feature["geometry"]["coordinates"][0]
        assert abs(lat - 52.5) < 0.02
        assert abs(lon - 13.4) < 0.02
        assert feature["properties"]["traversals"] >= 0
    keys = [(f["properties"]["edge"], f["properties"]["forward"]) for f in features]
    assert len(set(keys)) == len(keys)


def test_formats_agree(gpszip, tmp_path):
    import pyarrow.parquet as pq

    for name in ("u.json", "u.parquet", "u.csv"):
        assert gpszip(f"usage town.gpsz -o {name} --by hour").code == 0
    rows = json.loads((tmp_path / "u.json").read_text())["rows"]
    assert pq.read_table(tmp_path / "u.parquet").to_pylist() == rows
    assert len((tmp_path / "u.csv").read_text().splitlines()) == len(rows) + 1


def test_facts_and_likelihood(gpszip, tmp_path):
    done = gpszip("usage town.gpsz --json --likelihood town.csv --transitions m.csv")
    facts = done.json
    assert facts["tracks"] == 2
    assert facts["timezone"] == "UTC" or facts["timezone_from"] == "place"
    assert facts["likelihood"]["bits_per_transition"] < 2
    transitions = list(csv.DictReader((tmp_path / "m.csv").read_text().splitlines()))
    assert sum(int(row["count"]) for row in transitions) == facts["transitions"]


def test_mistakes_are_told(gpszip):
    assert "no part of time" in gpszip("usage town.gpsz --by minute").err
    assert "not as .txt" in gpszip("usage town.gpsz -o u.txt").err
    assert "no time zone" in gpszip("usage town.gpsz --timezone Nowhere").err
    assert "no lines" in gpszip("usage town.gpsz --transitions m.geojson").err
    assert "name one archive" in gpszip("usage town.gpsz town.csv").err
