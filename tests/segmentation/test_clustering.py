from __future__ import annotations

import numpy as np
import pytest

from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.segmentation import clustering
from gpszip.segmentation.clustering import k_means, ward
from gpszip.segmentation.lines import best_lines, excess_costs, pooled_lines
from oracle import segmentation as oracle


def random_partition(seed, n=60, k=9, d=2, *, weighted=False):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.5, 2.0, n) if weighted else None
    track = Track(
        "t",
        np.cumsum(rng.uniform(0.5, 2.0, n)).round(3),
        rng.normal(0, 3, (n, d)).cumsum(axis=0),
        weights=weights,
    )
    return track, np.array([0, *np.sort(rng.choice(np.arange(1, n), k - 1, replace=False)), n])


def laps(k, seed=0, length=6, lanes_count=5, noise=0.1):
    """A track of k intervals, each along one of a few lanes, with boundaries and lanes."""
    rng = np.random.default_rng(seed)
    lanes = rng.uniform(0, 1000, (lanes_count, 2, 2))
    lane = rng.integers(0, lanes_count, k)
    u = np.linspace(0, 1, length)[:, None]
    positions = np.concatenate([lanes[j, 0] * (1 - u) + lanes[j, 1] * u for j in lane])
    positions = positions + rng.normal(0, noise, positions.shape)
    return (
        Track("laps", np.arange(len(positions)), positions),
        np.arange(0, len(positions) + 1, length),
        lane,
    )


def same_groups(a, b):
    return len(set(zip(a, b, strict=True))) == len(set(a)) == len(set(b))


@pytest.mark.parametrize("seed", range(8))
def test_ward_equals_the_reference(seed):
    track, boundaries = random_partition(seed, d=1 + seed % 3, weighted=seed % 2 == 1)
    for m in (2, 4, 7):
        labels = ward(track_sums(track), boundaries, m)
        groups = {frozenset(np.flatnonzero(labels == label).tolist()) for label in range(m)}
        assert groups == oracle.ward(track, boundaries.tolist(), m)


@pytest.mark.parametrize("seed", range(4))
def test_ward_equals_the_reference_on_single_samples(seed):
    track, _ = random_partition(seed, n=12, weighted=True)
    for m in (2, 5, 9):
        labels = ward(track_sums(track), np.arange(13), m)
        assert {
            frozenset(np.flatnonzero(labels == label).tolist()) for label in range(m)
        } == oracle.ward(track, list(range(13)), m)


def test_pooled_lines_are_least_squares_over_all_samples():
    track, boundaries = random_partition(3, weighted=True)
    labels = np.array([0, 1, 2, 0, 1, 2, 0, 1, 1], dtype=np.int32)
    sums = track_sums(track)
    _, starts, slopes = pooled_lines(sums, boundaries, labels, 3)
    parts = list(zip(boundaries[:-1], boundaries[1:], strict=True))
    for label in range(3):
        start, end = oracle.pooled_line(track, [parts[j] for j in np.flatnonzero(labels == label)])
        fitted = sums.first_position + sums.position_tick * np.array(
            [starts[label], starts[label] + slopes[label]]
        )
        np.testing.assert_allclose(fitted, [start, end], atol=1e-5)


def test_excess_costs_are_costs_above_the_best_line():
    track, boundaries = random_partition(4)
    sums = track_sums(track)
    lines = best_lines(sums, boundaries)
    line = np.array([[3.0, -2.0]]), np.array([[5.0, 9.0]])
    excess = (
        excess_costs(
            lines,
            (line[0] - sums.first_position) / sums.position_tick,
            line[1] / sums.position_tick,
        )[:, 0]
        * sums.position_tick**2
    )
    for j, (a, b) in enumerate(zip(boundaries[:-1], boundaries[1:], strict=True)):
        expected = oracle.interval_cost(
            track, a, b, line[0][0], line[0][0] + line[1][0]
        ) - oracle.pooled_cost(track, [(a, b)])
        if b - a > 1:
            assert excess[j] == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("lanes_count", [1, 2, 5])
def test_both_methods_find_lanes_that_are_far_apart(lanes_count):
    track, boundaries, lane = laps(60, lanes_count=lanes_count)
    sums, m = track_sums(track), len(set(lane))
    assert same_groups(ward(sums, boundaries, m), lane)
    clusterings = [k_means(sums, boundaries, m, np.random.default_rng(seed)) for seed in range(8)]
    assert any(same_groups(labels, lane) for labels in clusterings)


def test_a_lane_in_the_opposite_direction_is_another_segment():
    forward, backward = np.linspace(0, 10, 6), np.linspace(10, 0, 6)
    x = np.concatenate([forward, backward, forward, backward])
    track = Track("lane", np.arange(24), x[:, None])
    assert ward(track_sums(track), np.arange(0, 25, 6), 2).tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("m", [5, 40, 70])
def test_merging_mutual_neighbours_first_gives_the_same_lanes(m, monkeypatch):
    track, boundaries, lane = laps(300, lanes_count=m)
    monkeypatch.setattr(clustering, "_MAX_ALL_PAIRS", 80)
    labels = ward(track_sums(track), boundaries, len(set(lane)))
    assert same_groups(labels, lane)


@pytest.mark.parametrize("method", ["ward", "k_means"])
@pytest.mark.parametrize("problem", ["random", "still", "points"])
def test_exactly_m_labels_in_the_order_of_their_intervals(method, problem):
    track, boundaries = random_partition(5)
    if problem == "still":
        track = Track("still", track.times, np.zeros((len(track), 2)))
    if problem == "points":
        boundaries = np.arange(len(track) + 1)
    k, sums = len(boundaries) - 1, track_sums(track)
    for m in (1, 2, k - 1, k):
        labels = (
            ward(sums, boundaries, m)
            if method == "ward"
            else k_means(sums, boundaries, m, np.random.default_rng(0))
        )
        assert labels.dtype == np.int32
        firsts = [int(np.flatnonzero(labels == label)[0]) for label in range(m)]
        assert firsts == sorted(firsts)
        assert set(labels) == set(range(m))


def test_k_means_is_the_same_for_the_same_generator():
    track, boundaries = random_partition(6, n=200, k=40)
    first, second = (
        k_means(track_sums(track), boundaries, 7, np.random.default_rng(3)) for _ in range(2)
    )
    assert first.tolist() == second.tolist()
