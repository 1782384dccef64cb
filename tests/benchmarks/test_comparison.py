"""What the comparison of GPSZip and its peers keeps, says and draws."""

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks.comparing import figure
from benchmarks.comparing.codecs import Codec
from benchmarks.comparing.logs import Case, round_track
from benchmarks.comparing.report import leading_rate, write_verdict
from benchmarks.comparing.results import Results, missing, read_results

from gpszip import Track

GPSZIP = Codec("gpszip", "GPSZip", ("1", "5"))
PEER = Codec("td-tr", "TD-TR", ("quick",))


def result(size, seconds):
    return {"bytes": size, "seconds": seconds, "startup": 1.0, "error": 1.9, "sizes": {}}


def case(stamp):
    return Case("Walk", Path("walk.csv"), 2.0, 1000, 1, stamp)


@pytest.mark.parametrize(
    ("ours", "peers", "leading"),
    [
        # ours are smaller as far as they are as fast as 100
        ([(100, 10), (10, 5)], [(1000, 20)], 100),
        # at 100 and 50, the peer's are smaller; at 10, ours
        ([(100, 10), (10, 5)], [(50, 8), (200, 9)], 10),
        # a peer is faster and smaller
        ([(100, 10)], [(200, 5)], 0),
        # the same size counts for the peer
        ([(100, 10)], [(100, 10)], 0),
    ],
)
def test_gpszip_leads_from_a_speed_down(ours, peers, leading):
    named = [[(*entry, "name") for entry in side] for side in (ours, peers)]
    assert leading_rate(*named) == leading


def test_the_verdict_names_who_is_faster_and_smaller(tmp_path):
    results = Results(tmp_path / "results.json")
    results.open_log(case(1))
    results.add("Walk", "gpszip 1", result(100, 1.0))
    results.add("Walk", "gpszip 5", result(50, 2.0))
    results.add("Walk", "td-tr quick", result(80, 0.5))
    assert list(write_verdict(results, "Walk", [GPSZIP, PEER])) == [
        "Walk: GPSZip's files are smallest from 500 points/s down.",
        "Walk: faster and smaller than GPSZip 1: TD-TR quick.",
    ]


def test_only_what_is_missing_is_measured(tmp_path):
    path = tmp_path / "results.json"
    results = Results(path)
    results.open_log(case(1))
    results.add("Walk", "gpszip 1", result(100, 1.0))
    results.add("Walk", "td-tr quick", result(80, 0.5))

    def left(again, stamp):
        known = read_results(path, again)
        known.open_log(case(stamp))
        wanted = missing(known, [case(stamp)], [GPSZIP, PEER])
        return [f"{codec.name} {level}" for _, codec, level in wanted]

    assert left([], 1) == ["gpszip 5"]
    assert left(["td-tr"], 1) == ["gpszip 5", "td-tr quick"]
    assert left(["all"], 1) == ["gpszip 1", "gpszip 5", "td-tr quick"]
    # another log of that name
    assert left([], 2) == ["gpszip 1", "gpszip 5", "td-tr quick"]


def test_times_that_become_the_same_are_left_out():
    track = round_track(Track("a", [0.0, 0.0004, 1.00049], [[0, 0], [1, 1], [2.00049, 3]]))
    assert track.times.tolist() == [0.0, 1.0]
    assert track.positions.tolist() == [[0, 0], [2, 3]]


def test_labels_move_apart_by_as_little_as_it_takes():
    pitch = figure.LABEL_PITCH
    heights = [0.0, 100.0, 100.0, 100.0 + 3 * pitch]
    np.testing.assert_allclose(
        figure.spread(heights), [0, 100 - pitch / 2, 100 + pitch / 2, 100 + 3 * pitch]
    )


def test_a_figure_is_drawn(tmp_path):
    results = Results(tmp_path / "results.json")
    results.open_log(case(1))
    for key, size, seconds in (("gpszip 1", 100, 1.0), ("td-tr quick", 80, 0.5)):
        results.add("Walk", key, result(size, seconds))
    figure.draw(results, [GPSZIP, PEER], tmp_path / "figure.svg")
    assert "</svg>" in (tmp_path / "figure.svg").read_text()
    assert json.loads((tmp_path / "results.json").read_text()) == results.logs
