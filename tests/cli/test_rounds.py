"""gpszip rounds, as a user runs it."""

import csv
import json

import numpy as np
import pytest

#: Metres of the places of a building, and the usual round; a spur leads from 4 to 9 and back.
PLACES = {i: (100 * (i % 3), 100 * (i // 3)) for i in range(9)} | {9: (130, 140)}
USUAL = [0, 1, 4, 9, 4, 1, 2, 5, 8, 7, 6, 3, 0]
WITHOUT_SPUR = [0, 1, 4, 1, 2, 5, 8, 7, 6, 3, 0]

#: The round, counted from 0, in which the guard leaves out the spur.
SHORT = 4


@pytest.fixture(autouse=True)
def patrol(tmp_path):
    """A log of ten rounds at 1 m/s."""
    route = [0]
    for number in range(10):
        route += (WITHOUT_SPUR if number == SHORT else USUAL)[1:]
    corners = np.array([PLACES[place] for place in route], float)
    driven = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    times = np.arange(0.0, driven[-1], 5.0)
    x, y = (np.interp(times, driven, axis) for axis in corners.T)
    rows = [f"{t:.0f},{a:.2f},{b:.2f}" for t, a, b in zip(times, x, y, strict=True)]
    (tmp_path / "patrol.csv").write_text("\n".join(["t,x,y", *rows]))


def test_the_round_that_misses_a_spur_is_told(gpszip, tmp_path):
    done = gpszip("rounds patrol.csv -o r.csv --edges e.geojson")
    assert done.code == 0, done.err
    assert "usual round" in done.out
    rows = list(csv.DictReader((tmp_path / "r.csv").read_text().splitlines()))
    short = [row for row in rows if float(row["score"]) < 0.99]
    assert len(rows) >= 8
    assert len(short) == 1
    assert float(short[0]["score"]) == pytest.approx(1 - 100 / 1100, abs=0.02)
    assert float(short[0]["late_s"]) == pytest.approx(-100, abs=15)
    at_spur = 1100 * SHORT + 250
    assert float(short[0]["t_start"]) < at_spur < float(short[0]["t_end"])

    # The spur, as a line.
    features = json.loads((tmp_path / "e.geojson").read_text())["features"]
    missed = [feature for feature in features if feature["properties"]["missed"]]
    assert len(missed) == 1
    assert str(missed[0]["properties"]["edge"]) == short[0]["missed"]
    line = np.array(missed[0]["geometry"]["coordinates"])
    assert np.linalg.norm(line - [130, 140], axis=1).min() < 5


def test_an_archive_and_a_time(gpszip):
    assert gpszip("compress patrol.csv -o patrol.gpsz --rmse 1m --effort 1").code == 0
    every = gpszip("rounds patrol.gpsz --json").json
    late = gpszip("rounds patrol.gpsz --since 6000 --json").json
    assert late["usual"] == every["usual"]
    assert late["complete"] == late["rounds"] < every["rounds"]
    assert every["complete"] == every["rounds"] - 1


def test_what_is_refused(gpszip, tmp_path):
    assert "not as .txt" in gpszip("rounds patrol.csv -o r.txt").err
    assert "no lines" in gpszip("rounds patrol.csv -o r.geojson").err
    assert "standard output" in gpszip("rounds patrol.csv -o - --edges -").err
    (tmp_path / "once.csv").write_text("t,x,y\n0,0,0\n10,90,0\n20,90,90\n")
    done = gpszip("rounds once.csv")
    assert (done.code, "doesn't repeat" in done.err) == (1, True)
