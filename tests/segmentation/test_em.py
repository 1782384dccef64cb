from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from gpszip.errors import OptionError
from gpszip.model import SegmentMean, Track
from gpszip.run import Threads
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.evaluate import distances, positions_at, rmse
from oracle import segmentation as oracle


def random_track(seed, n, d=2, *, weighted=False):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.3, 2.0, n) if weighted else None
    times = np.cumsum(rng.uniform(0.5, 2.0, n)).round(3)
    return Track("walk", times, rng.normal(0, 3, (n, d)).cumsum(axis=0).round(3), weights=weights)


def rounds(laps, noise=0.05, seed=0):
    """Laps of a square, 20 samples a side."""
    corners = np.array([[0, 0], [50, 0], [50, 50], [0, 50]], dtype=float)
    u = np.linspace(0, 1, 20)[:, None]
    sides = [corners[j] * (1 - u) + corners[(j + 1) % 4] * u for j in range(4)]
    positions = np.concatenate(sides * laps)
    positions = positions + np.random.default_rng(seed).normal(0, noise, positions.shape)
    return Track("rounds", np.arange(len(positions)), positions.round(3))


CHOICES = list(
    product(
        ["bottom-up", "douglas-peucker"],
        ["ward", "k-means++"],
        ["odd-even", "linear", "naive", "exact"],
    )
)


@pytest.mark.parametrize(("initial", "clustering", "expectation"), CHOICES)
def test_tau_never_rises_and_equals_the_reference(initial, clustering, expectation):
    for seed in range(14):
        rng = np.random.default_rng(seed)
        track = random_track(
            seed, int(rng.integers(3, 60)), int(rng.integers(1, 4)), weighted=seed % 2 == 1
        )
        k = int(rng.integers(1, min(len(track), 15) + 1))
        m = int(rng.integers(1, k + 1))
        mean = segment_mean(
            track, k, m, initial=initial, clustering=clustering, expectation=expectation, rng=rng
        )
        assert (mean.k, mean.m) == (k, m)
        assert (np.diff(mean.costs) <= 0).all()
        assert mean.cost == mean.costs[-1]
        assert mean.boundaries[[0, -1]].tolist() == [0, len(track)]
        assert np.diff(mean.boundaries).min() >= 1
        assert set(mean.labels) <= set(range(m))
        expected = oracle.cost(track, mean.boundaries, mean.labels, mean.starts, mean.ends)
        assert mean.cost == pytest.approx(expected, rel=1e-5, abs=1e-9)


def test_ten_laps_of_a_square_are_four_segments():
    track = rounds(10)
    for expectation in ("odd-even", "linear", "exact"):
        mean = segment_mean(track, 40, 4, expectation=expectation)
        assert rmse(mean, track) < 0.09
        assert mean.labels.tolist() == [0, 1, 2, 3] * 10
        assert mean.boundaries.tolist() == list(range(0, 801, 20))
        np.testing.assert_allclose(mean.starts, [[0, 0], [50, 0], [50, 50], [0, 50]], atol=0.1)


def test_the_origin_of_times_and_positions_changes_no_bit():
    track = rounds(6, noise=2.0)
    shifted = Track("rounds", track.times + 1e9, track.positions + 1e7)
    a, b = segment_mean(track, 30, 5), segment_mean(shifted, 30, 5)
    assert len(a.costs) > 2
    assert a.costs == b.costs
    assert a.boundaries.tolist() == b.boundaries.tolist()
    assert a.labels.tolist() == b.labels.tolist()
    np.testing.assert_allclose(b.starts - 1e7, a.starts, atol=1e-8)
    np.testing.assert_allclose(b.ends - 1e7, a.ends, atol=1e-8)


def test_threads_change_no_bit():
    track = rounds(40, noise=4.0)
    serial, threaded = (
        segment_mean(track, 150, 7, iterations=5),
        segment_mean(track, 150, 7, iterations=5, executor=Threads(3)),
    )
    assert serial.costs == threaded.costs
    assert serial.boundaries.tolist() == threaded.boundaries.tolist()
    assert serial.starts.tolist() == threaded.starts.tolist()


@pytest.mark.parametrize("d", [1, 2, 3])
def test_one_interval_for_each_sample_costs_nothing(d):
    track = random_track(d, 12, d)
    mean = segment_mean(track, 12, 12)
    assert mean.cost == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(positions_at(mean, track), track.positions, atol=1e-6)


def test_one_interval_and_one_segment_is_the_best_line():
    track = random_track(5, 30, weighted=True)
    mean = segment_mean(track, 1, 1)
    assert mean.cost == pytest.approx(oracle.pooled_cost(track, [(0, 30)]), rel=1e-8)
    np.testing.assert_allclose(
        [mean.starts[0], mean.ends[0]], oracle.pooled_line(track, [(0, 30)]), atol=1e-5
    )


@pytest.mark.parametrize(("k", "m"), [(8, 1), (8, 8), (30, 1), (30, 4)])
def test_extreme_k_and_m_reach_the_pooled_optimum(k, m):
    track = random_track(2, 30)
    mean = segment_mean(track, k, m)
    parts = list(zip(mean.boundaries[:-1], mean.boundaries[1:], strict=True))
    least = sum(
        oracle.pooled_cost(track, [parts[j] for j in np.flatnonzero(mean.labels == label)])
        for label in set(mean.labels)
    )
    assert mean.cost == pytest.approx(least, rel=1e-6, abs=1e-9)


def test_a_single_sample():
    mean = segment_mean(Track("dot", [3.0], [[1.0, 2.0]]), 1, 1)
    assert mean.starts.tolist() == mean.ends.tolist() == [[1.0, 2.0]]
    assert mean.cost == 0


def test_a_stationary_log():
    mean = segment_mean(Track("still", np.arange(20), np.full((20, 2), 7.0)), 5, 2)
    assert mean.cost == pytest.approx(0, abs=1e-12)
    assert mean.starts.tolist() == mean.ends.tolist() == [[7.0, 7.0]] * 2


def test_heavier_samples_draw_the_segment():
    track = Track("t", [0, 1, 2], [[0.0], [3.0], [0.0]], weights=[1e-6, 1.0, 1e-6])
    assert positions_at(segment_mean(track, 1, 1), track)[1] == pytest.approx(3.0, abs=1e-3)


def test_the_exact_expectation_is_better_on_hard_problems():
    ratios = []
    for seed in range(10):
        track = rounds(8, noise=6.0, seed=seed)
        local, exact = (
            segment_mean(track, 30, 5, expectation=form).cost for form in ("odd-even", "exact")
        )
        ratios.append(exact / local)
    assert np.mean(ratios) < 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"k": 3, "m": 4}, "1 <= m <= k"),
        ({"k": 3, "m": 0}, "1 <= m <= k"),
        ({"k": 11, "m": 1}, "choose k <= 10"),
        ({"k": 4, "m": 1, "min_samples": 3}, "choose k <= 3"),
        ({"k": 4, "m": 1, "min_samples": 0}, "too few"),
        ({"k": 3, "m": 2, "initial": "uniform"}, "bottom-up, douglas-peucker"),
        ({"k": 3, "m": 2, "expectation": "best"}, "odd-even, linear, naive, exact"),
        ({"k": 3, "m": 2, "clustering": "k-means++"}, "default_rng"),
    ],
)
def test_errors_of_options_name_the_remedy(options, message):
    with pytest.raises(OptionError, match=message):
        segment_mean(random_track(0, 10), **options)


def test_distances_are_synchronised():
    track = Track("t", [0, 1, 3, 4], [[0.0, 0], [1, 1], [3, 0], [9, 0]])
    mean = SegmentMean(
        np.array([0, 3, 4]),
        np.array([0, 1]),
        np.array([[0.0, 0], [9, 3]]),
        np.array([[3.0, 0], [8, 8]]),
        0.0,
    )
    assert distances(mean, track).tolist() == [0, 1, 0, 3]
    assert rmse(mean, track) == pytest.approx(np.sqrt(10 / 4))
