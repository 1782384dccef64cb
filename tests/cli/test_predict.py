"""gpszip predict and gpszip unusual, as a user runs them."""

import csv
import json
import shutil

import numpy as np
import pytest

from gpszip.testing import shuttles

#: Metres of a degree of latitude, and of longitude there.
NORTH, EAST = 111_200.0, 67_700.0


def write_log(path, tracks):
    """Write tracks in degrees."""
    rows = ["track_id,t,lat,lon"]
    for name, times, positions in tracks:
        rows += [
            f"{name},{time:.0f},{52.5 + y / NORTH:.7f},{13.4 + x / EAST:.7f}"
            for time, (x, y) in zip(times, positions, strict=True)
        ]
    path.write_text("\n".join(rows) + "\n")


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """Buses of a day, and of an hour of another day of which one leaves the map."""
    log = shuttles(2, lines=2, days=1, blocks=4, period=15.0, seed=4)
    folder = tmp_path_factory.mktemp("town")
    known, later = [], []
    for track in log.tracks:
        cut = track.times < track.times[0] + 9 * 3600
        known.append((track.id, track.times[cut], track.positions[cut]))
        rest = ~cut & (track.times < track.times[0] + 9.4 * 3600)
        later.append((track.id, track.times[rest], track.positions[rest]))
    name, times, positions = later[1]
    away = np.linspace(0, 900, 40)[:, None] * np.array([0.6, 0.8]) + positions[30]
    later[1] = (name, times, np.concatenate((positions[:30], away, positions[70:])))
    write_log(folder / "known.csv", known)
    write_log(folder / "later.csv", later)
    return folder


@pytest.fixture(autouse=True)
def files(gpszip, town, tmp_path):
    """The logs and the archive, compressed once, in the folder of each test."""
    if not (town / "known.gpsz").exists():
        words = f"compress {town / 'known.csv'} -o {town / 'known.gpsz'} --rmse 6m --effort 1"
        assert gpszip(words).code == 0
    for name in ("later.csv", "known.gpsz"):
        shutil.copy(town / name, tmp_path / name)


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_predictions_of_a_log_are_told_and_written(gpszip, tmp_path):
    done = gpszip("predict known.gpsz later.csv -o p.csv --destinations 2")
    assert done.code == 0, done.err
    assert "shuttle-0 at 2024-01-01 16:2" in done.out
    assert "next: edge" in done.out
    assert "destination: node" in done.out
    rows = rows_of(tmp_path / "p.csv")
    following = [row for row in rows if row["kind"] == "next" and row["track_id"] == "shuttle-0"]
    assert sum(float(row["probability"]) for row in following) == pytest.approx(1, abs=1e-4)
    for row in rows:
        if row["kind"] == "destination":
            assert float(row["low"]) <= float(row["seconds"]) <= float(row["high"])
            assert 52.4 < float(row["lat"]) < 52.6
    assert f"p.csv: {len(rows)} rows" in done.err


def test_the_archive_goes_on_by_itself(gpszip):
    done = gpszip("predict known.gpsz --json --edges 3 --track shuttle-1")
    (track,) = done.json["tracks"]
    assert track["track_id"] == "shuttle-1"
    assert {len(route["edges"]) for route in track["routes"]} == {3}
    best = [each["probability"] for each in track["next"]]
    assert best == sorted(best, reverse=True)


def test_unusual_trips_are_ranked_with_reasons(gpszip, tmp_path):
    done = gpszip("unusual later.csv --map known.gpsz -o u.csv")
    assert done.code == 0, done.err
    assert done.out.splitlines()[1].split()[2] == "shuttle-1"
    rows = rows_of(tmp_path / "u.csv")
    assert list(rows[0]) == ["track_id", "t_start", "t_end", "score", "reason"]
    scores = {}
    for row in rows:
        scores[row["track_id"]] = max(scores.get(row["track_id"], 0), float(row["score"]))
        assert float(row["t_start"]) <= float(row["t_end"])
    assert scores["shuttle-1"] > scores["shuttle-0"] + 10
    odd = max(rows, key=lambda row: float(row["score"]))
    assert odd["track_id"] == "shuttle-1"
    assert odd["reason"] in done.out
    assert odd["reason"] != "nothing unusual"


def test_unusual_parts_have_places_and_lines(gpszip, tmp_path):
    assert gpszip("unusual later.csv --map known.gpsz -o u.csv --stretches").code == 0
    rows = rows_of(tmp_path / "u.csv")
    scores = [float(row["score"]) for row in rows]
    assert scores == sorted(scores, reverse=True)
    off = next(row for row in rows if row["kind"] == "off the map")
    assert 52.45 < float(off["lat"]) < 52.55
    assert 13.35 < float(off["lon"]) < 13.45

    assert (
        "--stretches needs a table" in gpszip("unusual later.csv --map known.gpsz --stretches").err
    )
    assert gpszip("unusual later.csv --map known.gpsz -o u.geojson --stretches").code == 0
    features = json.loads((tmp_path / "u.geojson").read_text())["features"]
    assert len(features) == len(rows)
    for feature in features:
        assert 13.3 < feature["geometry"]["coordinates"][0][0] < 13.5


def test_bits_of_the_archives_coder_are_told(gpszip, tmp_path):
    facts = gpszip("unusual later.csv --map known.gpsz -o u.csv --coded --json").json
    rows = rows_of(tmp_path / "u.csv")
    assert list(rows[0])[-1] == "coded_bits"
    told = sorted(trip["coded_bits"] for trip in facts["trips"])
    assert sorted(float(row["coded_bits"]) for row in rows) == pytest.approx(told, abs=1e-3)

    # A minute off the map takes more than one of usual travel, and parts take less than trips.
    trips = {trip["track_id"]: trip for trip in facts["trips"]}
    odd, normal = trips["shuttle-1"], trips["shuttle-0"]
    off = next(part for part in odd["parts"] if part["kind"] == "off the map")
    assert off["coded_bits"] <= odd["coded_bits"]
    rates = [each["coded_bits"] / (each["t_end"] - each["t_start"]) for each in (off, normal)]
    assert rates[0] > 2 * rates[1] > 0


def test_alarms_are_counted(gpszip):
    facts = gpszip("unusual later.csv --map known.gpsz --json --alarm 1").json
    above = [trip for trip in facts["trips"] if trip["score"] >= 1]
    assert facts["alarms"] == len(above) > 0
    assert facts["alarms_per_agent_and_day"] == pytest.approx(len(above) / 2)
    assert facts["trips"] == sorted(facts["trips"], key=lambda trip: -trip["score"])


def test_mistakes_are_explained(gpszip, tmp_path):
    assert "Missing option '--map'" in gpszip("unusual later.csv").err
    assert "not as .txt" in gpszip("unusual later.csv --map known.gpsz -o u.txt").err
    assert "not as .txt" in gpszip("predict known.gpsz -o p.txt").err
    (tmp_path / "far.csv").write_text("t,lat,lon\n0,10.0,10.0\n9,10.1,10.1\n")
    done = gpszip("unusual far.csv --map known.gpsz")
    assert done.code == 1
    assert "Traceback" not in done.err
    (tmp_path / "shape.csv").write_text("lat,lon\n52.5,13.4\n52.501,13.4\n")
    done = gpszip("unusual shape.csv --map known.gpsz")
    assert done.code == 1
    assert "time" in done.err
