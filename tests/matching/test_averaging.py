"""Samples near each other for their noise are averaged, and white noise no longer sends routes to and fro."""

import numpy as np
import pytest

from gpszip.matching.averaging import (
    RunningAverage,
    choose_window,
    estimate_noise,
    find_stride,
    moving_average,
)
from gpszip.matching.match import match
from gpszip.model import Network, Track
from gpszip.testing.city import drives


def town(blocks, block):
    """The streets of :func:`gpszip.testing.city.drives`."""
    n = blocks + 1
    nodes = block * (np.array([(x, y) for x in range(n) for y in range(n)], float) - blocks / 2)
    pairs = [(x * n + y, (x + 1) * n + y) for x in range(blocks) for y in range(n)]
    pairs = np.array(
        pairs + [(x * n + y, x * n + y + 1) for x in range(n) for y in range(blocks)], np.int32
    )
    both = np.ones(len(pairs), bool)
    return Network(
        nodes,
        pairs[:, 0].copy(),
        pairs[:, 1].copy(),
        2 * np.arange(len(pairs) + 1),
        nodes[pairs.ravel()],
        both,
        both,
        0.0 * both + np.nan,
    )


def plain_means(positions, is_gap, size):
    out = []
    for i in range(len(positions)):
        reach = 0
        while (
            reach < size // 2
            and i - reach > 0
            and i + reach + 1 < len(positions)
            and not is_gap[i - reach - 1]
            and not is_gap[i + reach]
        ):
            reach += 1
        out.append(positions[i - reach : i + reach + 1].mean(axis=0))
    return np.array(out)


@pytest.mark.parametrize("size", [1, 3, 7, 31])
@pytest.mark.parametrize("seed", range(4))
def test_means_are_those_of_the_plain_twin_also_one_by_one(size, seed):
    rng = np.random.default_rng(seed)
    positions, is_gap = rng.normal(0, 10, (60, 2)), rng.random(59) < 0.08
    means = moving_average(positions, is_gap, size)
    np.testing.assert_allclose(means, plain_means(positions, is_gap, size), atol=1e-12)
    running, told = RunningAverage(size), []
    for i, place in enumerate(positions):
        if i and is_gap[i - 1]:
            told += running.finish()
        told += running.push((float(i), place, np.zeros(2)))
        assert i - len(told) < size // 2 + 1
    told += running.finish()
    assert [time for time, _, _ in told] == list(range(60))
    np.testing.assert_array_equal([place for _, place, _ in told], means)


@pytest.mark.parametrize("noise", [0.5, 4.0, 25.0])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_noise_is_told_from_travel(noise, dimension):
    way = 9.0 * np.arange(2000.0)[:, None] * np.eye(dimension)[0]
    seen = way + np.random.default_rng(1).normal(0, noise, way.shape)
    assert estimate_noise(seen, np.zeros(1999, bool)) == pytest.approx(noise, rel=0.1)


def test_speed_is_told_from_noise_and_from_standing():
    rng, is_gap = np.random.default_rng(2), np.zeros(9999, bool)
    moving = np.arange(10_000) % 1000 < 100  # stands nine tenths of the time
    way = 9.0 * np.cumsum(moving)[:, None] * [1.0, 0.0]
    seen = way + rng.normal(0, 5, way.shape)
    every, length = find_stride(seen, is_gap, estimate_noise(seen, is_gap))
    assert length / every == pytest.approx(9, rel=0.25)
    assert choose_window(seen, is_gap) == 1


@pytest.mark.parametrize("period", [1.0, 10.0, 60.0])
def test_sparse_samples_are_left_alone(period):
    (one,) = drives(blocks=6, vehicles=1, period=period, duration=400 * period, noise=4.0).values()
    assert choose_window(one[1][:5], np.zeros(4, bool)) == 1
    assert match(Track("bus", *one), town(6, 120.0)).scales.averaging_window == 1


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_sends_no_route_to_and_fro(seed):
    blocks, block = 8, 90.0
    options = {"blocks": blocks, "block": block, "vehicles": 2, "duration": 900.0, "seed": seed}
    seen, truth = drives(noise=25.0, **options), drives(noise=0.0, **options)
    streets = town(blocks, block)
    found = match([Track(name, *one) for name, one in seen.items()], streets)
    true = np.concatenate([one[1] for one in truth.values()])
    places = np.concatenate([one.snapped_positions(streets) for one in found])
    assert found.scales.averaging_window in {3, 5}
    assert np.mean(np.linalg.norm(places - true, axis=1) < 40) > 0.95
    driven = sum(np.linalg.norm(np.diff(one[1], axis=0), axis=1).sum() for one in truth.values())
    assert sum(piece.length for one in found for piece in one.pieces) / driven == pytest.approx(
        0.97, abs=0.06
    )
    raw = np.concatenate([one[1] for one in seen.values()])
    np.testing.assert_allclose(
        np.concatenate([one.distance for one in found]),
        np.linalg.norm(raw - places, axis=1),
        atol=1e-6,
    )


@pytest.mark.parametrize("period", [30.0, 60.0])
@pytest.mark.parametrize("seed", range(3))
def test_sparse_routes_are_as_long_as_the_shortest_ways(period, seed):
    """Not as the drives: a car that came to its goal and turned between two samples was not seen to."""
    blocks, block = 12, 120.0
    streets = town(blocks, block)
    options = {
        "blocks": blocks,
        "block": block,
        "vehicles": 3,
        "duration": 3600.0,
        "seed": seed,
        "period": period,
    }
    seen, truth = drives(noise=8.0, **options), drives(noise=0.0, **options)
    found = match([Track(name, *one) for name, one in seen.items()], streets)
    shortest = sum(
        np.abs(np.diff(one[1], axis=0)).sum() for one in truth.values()
    )  # on a grid; a little more round a block
    assert sum(piece.length for one in found for piece in one.pieces) / shortest == pytest.approx(
        1.02, abs=0.04
    )
