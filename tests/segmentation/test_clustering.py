from __future__ import annotations

import numpy as np
import pytest

from gpszip.model import Track
from gpszip.segmentation import clustering
from gpszip.segmentation.clustering import k_means, ward
from gpszip.segmentation.lines import best_lines, excess_costs, pooled_lines
from gpszip.segmentation.state import track_sums
from oracle import segmentation as oracle


def random_parts(seed, n=60, k=9, d=2, *, weighted=False):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.5, 2.0, n) if weighted else None
    track = Track(
        "t",
        np.cumsum(rng.uniform(0.5, 2.0, n)).round(3),
        rng.normal(0, 3, (n, d)).cumsum(axis=0),
        weights=weights,
    )
    return track, np.array([0, *np.sort(rng.choice(np.arange(1, n), k - 1, replace=False)), n])


def laps(k, seed=0, length=6, places=5, noise=0.1):
    """A track of k parts, each along one of a few lanes, and the lane of each."""
    rng = np.random.default_rng(seed)
    lanes = rng.uniform(0, 1000, (places, 2, 2))
    lane = rng.integers(0, places, k)
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
def test_ward_equals_its_twin(seed):
    track, boundaries = random_parts(seed, d=1 + seed % 3, weighted=seed % 2 == 1)
    for m in (2, 4, 7):
        labels = ward(track_sums(track), boundaries, m)
        groups = {frozenset(np.flatnonzero(labels == label).tolist()) for label in range(m)}
        assert groups == oracle.ward(track, boundaries.tolist(), m)


@pytest.mark.parametrize("seed", range(4))
def test_ward_equals_its_twin_on_single_samples(seed):
    track, _ = random_parts(seed, n=12, weighted=True)
    for m in (2, 5, 9):
        labels = ward(track_sums(track), np.arange(13), m)
        assert {
            frozenset(np.flatnonzero(labels == label).tolist()) for label in range(m)
        } == oracle.ward(track, list(range(13)), m)


def test_pooled_lines_are_least_squares_over_all_samples():
    track, boundaries = random_parts(3, weighted=True)
    labels = np.array([0, 1, 2, 0, 1, 2, 0, 1, 1], dtype=np.int32)
    sums = track_sums(track)
    _, starts, slopes = pooled_lines(sums, boundaries, labels, 3)
    parts = list(zip(boundaries[:-1], boundaries[1:], strict=True))
    for label in range(3):
        start, end = oracle.pooled_line(track, [parts[j] for j in np.flatnonzero(labels == label)])
        mine = sums.first_position + sums.position_tick * np.array(
            [starts[label], starts[label] + slopes[label]]
        )
        np.testing.assert_allclose(mine, [start, end], atol=1e-5)


def test_excess_is_the_cost_above_the_own_line():
    track, boundaries = random_parts(4)
    sums = track_sums(track)
    lines = best_lines(sums, boundaries)
    line = np.array([[3.0, -2.0]]), np.array([[5.0, 9.0]])
    above = (
        excess_costs(
            lines,
            (line[0] - sums.first_position) / sums.position_tick,
            line[1] / sums.position_tick,
        )[:, 0]
        * sums.position_tick**2
    )
    for j, (a, b) in enumerate(zip(boundaries[:-1], boundaries[1:], strict=True)):
        expected = oracle.part_cost(
            track, a, b, line[0][0], line[0][0] + line[1][0]
        ) - oracle.pooled_cost(track, [(a, b)])
        if b - a > 1:
            assert above[j] == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("places", [1, 2, 5])
def test_both_find_lanes_that_are_far_apart(places):
    track, boundaries, lane = laps(60, places=places)
    sums, m = track_sums(track), len(set(lane))
    assert same_groups(ward(sums, boundaries, m), lane)
    found = [k_means(sums, boundaries, m, np.random.default_rng(seed)) for seed in range(8)]
    assert any(same_groups(labels, lane) for labels in found)


def test_a_lane_travelled_backward_is_another_segment():
    there, back = np.linspace(0, 10, 6), np.linspace(10, 0, 6)
    track = Track("lane", np.arange(24), np.concatenate([there, back, there, back])[:, None])
    assert ward(track_sums(track), np.arange(0, 25, 6), 2).tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("m", [5, 40, 70])
def test_near_groups_first_gives_the_same_lanes(m, monkeypatch):
    track, boundaries, lane = laps(300, places=m)
    monkeypatch.setattr(clustering, "_ALL_PAIRS", 80)
    labels = ward(track_sums(track), boundaries, len(set(lane)))
    assert same_groups(labels, lane)


@pytest.mark.parametrize("method", ["ward", "k_means"])
@pytest.mark.parametrize("kind", ["random", "still", "points"])
def test_exactly_m_labels_in_the_order_of_their_parts(method, kind):
    track, boundaries = random_parts(5)
    if kind == "still":
        track = Track("still", track.times, np.zeros((len(track), 2)))
    if kind == "points":
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


def test_k_means_repeats_with_its_generator():
    track, boundaries = random_parts(6, n=200, k=40)
    first, second = (
        k_means(track_sums(track), boundaries, 7, np.random.default_rng(3)) for _ in range(2)
    )
    assert first.tolist() == second.tolist()
