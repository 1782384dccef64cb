"""Where a learned map ends: what lies beside all of its edges is off the map."""

import math
from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.matching.reach import choose_reach, log_noise
from gpszip.matching.viterbi import Observations
from gpszip.model.grid import step_size
from gpszip.pipeline.live import roads_and_scales

#: Metres between the street that was learned and the one beside it.
BESIDE = 90.0

#: Standard deviation of errors on each axis in metres.
NOISE = 3.0


def bus(name, y, rng, trips=6, metres=1500):
    """A bus along the street at y, there and back at 10 m/s with a sample each second."""
    times = np.arange(trips * metres / 10)
    x = metres / 2 * (1 + np.cos(np.pi * (times * 10 / metres)))
    line = np.stack([x, np.full(len(x), y)], axis=1)
    return gpszip.Track(name, times, line + rng.normal(0, NOISE, line.shape))


@pytest.fixture(scope="module")
def street():
    return gpszip.compress(bus("a", 0.0, np.random.default_rng(1)), rmse=5.0, effort=1)


def test_a_log_beside_all_edges_is_off_the_map_and_not_one_of_large_errors(street):
    rng = np.random.default_rng(2)
    on, beside = bus("a", 0.0, rng, trips=2), bus("a", BESIDE, rng, trips=2)
    assert (gpszip.match(on, street)[0].piece >= 0).mean() > 0.99
    assert (gpszip.match(beside, street)[0].piece < 0).all()
    # Whoever says that errors are so large is believed.
    assert gpszip.match(beside, street, sigma=BESIDE).scales.reach == math.inf

    # The same in the ranking of trips, and live.
    usual, odd = (gpszip.unusual(log, street).trips for log in (on, beside))
    assert {part.kind for trip in usual for part in trip.anomalies}.isdisjoint({"off the map"})
    (trip,) = odd
    assert trip.reason.startswith("off the map for 3,")
    assert trip.score > usual[0].score + 14
    matcher = gpszip.Matcher(street)
    positions = [matcher.push(t, xy) for t, xy in zip(beside.times, beside.positions, strict=True)]
    assert all(position.off_map for position in positions)


def test_a_stretch_beside_all_edges_is_off_the_map(street):
    rng = np.random.default_rng(3)
    log = bus("a", 0.0, rng, trips=2)
    shift = np.where((np.arange(300) >= 100) & (np.arange(300) < 160), BESIDE, 0.0)
    log = replace(log, positions=log.positions + np.stack([0 * shift, shift], axis=1))
    (trip,) = gpszip.unusual(log, street).trips
    (part,) = [each for each in trip.anomalies if each.kind == "off the map"]
    assert part.start == pytest.approx(100, abs=5)
    assert part.end == pytest.approx(160, abs=5)


def test_reach_is_that_of_the_errors_of_map_and_log(street):
    network, _ = roads_and_scales(street, None)
    assert 1 < network.error < 5
    assert choose_reach(network, 40.0) == pytest.approx(6 * math.hypot(network.error, 40.0))
    assert choose_reach(replace(network, error=None)) == math.inf


def test_a_map_rounded_to_lines_is_as_good_as_its_grid():
    # A mower with a precise receiver on straight lanes: all knots lie on the lines of the map.
    times = np.arange(400.0)
    x = np.abs(times % 100 - 50)
    exact = gpszip.Track("mower", times, np.stack([x, 0.3 * np.sin(x / 9)], axis=1))
    lanes = gpszip.compress(exact, rmse=1.0, effort=1)
    network, _ = roads_and_scales(lanes, None)
    assert network.error == pytest.approx(step_size(lanes.grid.space))
    assert gpszip.match(exact, lanes).share == 1


def test_noise_is_that_of_positions():
    rng = np.random.default_rng(4)
    dense = np.cumsum(rng.normal(1.0, 0.01, (900, 2)), axis=0) + rng.normal(0, 8, (900, 2))
    observed = Observations(dense, np.arange(900.0), np.zeros(899, bool), 0 * dense)
    assert log_noise([observed]) == pytest.approx(8 * math.sqrt(2), rel=0.1)
