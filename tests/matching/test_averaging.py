"""Moving averages: the noise they are chosen by, and matching with them."""

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
from gpszip.model import Track
from gpszip.testing.city import drives
from matching.streets import town


def plain_moving_average(positions, is_gap, window):
    """Widen the window about each sample until it meets a gap or an end."""
    means = []
    for i in range(len(positions)):
        side = 0
        while (
            side < window // 2
            and i - side > 0
            and i + side + 1 < len(positions)
            and not is_gap[i - side - 1]
            and not is_gap[i + side]
        ):
            side += 1
        means.append(positions[i - side : i + side + 1].mean(axis=0))
    return np.array(means)


@pytest.mark.parametrize("window", [1, 3, 7, 31])
@pytest.mark.parametrize("seed", range(4))
def test_moving_and_running_averages_equal_the_oracle(window, seed):
    rng = np.random.default_rng(seed)
    positions, is_gap = rng.normal(0, 10, (60, 2)), rng.random(59) < 0.08
    means = moving_average(positions, is_gap, window)
    np.testing.assert_allclose(means, plain_moving_average(positions, is_gap, window), atol=1e-12)

    running, samples = RunningAverage(window), []
    for i, position in enumerate(positions):
        if i and is_gap[i - 1]:
            samples += running.finish()
        samples += running.push((float(i), position, np.zeros(2)))
        assert i - len(samples) < window // 2 + 1
    samples += running.finish()
    assert [time for time, _, _ in samples] == list(range(60))
    np.testing.assert_array_equal([position for _, position, _ in samples], means)


@pytest.mark.parametrize("noise", [0.5, 4.0, 25.0])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_noise_is_estimated_beside_travel(noise, dimension):
    line = 9.0 * np.arange(2000.0)[:, None] * np.eye(dimension)[0]
    positions = line + np.random.default_rng(1).normal(0, noise, line.shape)
    assert estimate_noise(positions, np.zeros(1999, bool)) == pytest.approx(noise, rel=0.1)


def test_stride_shows_the_speed_of_an_agent_that_mostly_stands():
    rng, is_gap = np.random.default_rng(2), np.zeros(9999, bool)
    is_moving = np.arange(10_000) % 1000 < 100
    line = 9.0 * np.cumsum(is_moving)[:, None] * [1.0, 0.0]
    positions = line + rng.normal(0, 5, line.shape)
    stride, length = find_stride(positions, is_gap, estimate_noise(positions, is_gap))
    assert length / stride == pytest.approx(9, rel=0.25)
    assert choose_window(positions, is_gap) == 1


@pytest.mark.parametrize("period", [1.0, 10.0, 60.0])
def test_sparse_samples_are_not_averaged(period):
    (bus,) = drives(blocks=6, vehicles=1, period=period, duration=400 * period, noise=4.0).values()
    assert choose_window(bus[1][:5], np.zeros(4, bool)) == 1
    assert match(Track("bus", *bus), town()).scales.averaging_window == 1


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_does_not_send_routes_to_and_fro(seed):
    blocks, block = 8, 90.0
    options = {"blocks": blocks, "block": block, "vehicles": 2, "duration": 900.0, "seed": seed}
    noisy, exact = drives(noise=25.0, **options), drives(noise=0.0, **options)
    streets = town(blocks, block)
    matching = match([Track(name, *bus) for name, bus in noisy.items()], streets)
    assert matching.scales.averaging_window in {3, 5}

    # near the true positions, and about as long as the true drive
    exact_positions = np.concatenate([bus[1] for bus in exact.values()])
    snapped = np.concatenate([matched.snapped_positions(streets) for matched in matching])
    assert np.mean(np.linalg.norm(snapped - exact_positions, axis=1) < 40) > 0.95
    driven = sum(np.linalg.norm(np.diff(bus[1], axis=0), axis=1).sum() for bus in exact.values())
    matched_length = sum(piece.length for matched in matching for piece in matched.pieces)
    assert matched_length / driven == pytest.approx(0.97, abs=0.06)

    # distances are those of the samples, not of their means
    noisy_positions = np.concatenate([bus[1] for bus in noisy.values()])
    np.testing.assert_allclose(
        np.concatenate([matched.distance for matched in matching]),
        np.linalg.norm(noisy_positions - snapped, axis=1),
        atol=1e-6,
    )


@pytest.mark.parametrize("period", [30.0, 60.0])
@pytest.mark.parametrize("seed", range(3))
def test_sparse_routes_are_as_long_as_shortest_paths(period, seed):
    """Not as the drives: a car that turned at its destination between two samples was not seen."""
    blocks, block = 12, 120.0
    options = {
        "blocks": blocks,
        "block": block,
        "vehicles": 3,
        "duration": 3600.0,
        "seed": seed,
        "period": period,
    }
    noisy, exact = drives(noise=8.0, **options), drives(noise=0.0, **options)
    matching = match([Track(name, *bus) for name, bus in noisy.items()], town(blocks, block))
    # on a grid; a little more where a path goes round a block
    shortest = sum(np.abs(np.diff(bus[1], axis=0)).sum() for bus in exact.values())
    matched_length = sum(piece.length for matched in matching for piece in matched.pieces)
    assert matched_length / shortest == pytest.approx(1.02, abs=0.04)
