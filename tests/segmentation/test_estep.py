"""Expectation and maximisation steps and exact partitions, against references and each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.run import Threads
from gpszip.segmentation import estep
from gpszip.segmentation import partition as partitions
from gpszip.segmentation.mstep import maximize
from gpszip.segmentation.partition import exact_partition, penalised_partition
from gpszip.segmentation.state import (
    EMState,
    interval_costs,
    to_metres,
    total_cost,
)
from gpszip.segmentation.two_segment_mean import two_segment_mean
from oracle import segmentation as oracle


def random_problem(seed, n=None, k=None, m=None, d=None):
    """A track, its sums and a random state, often with one-sample intervals and unused labels."""
    rng = np.random.default_rng(seed)
    n, d = n or int(rng.integers(2, 40)), d or int(rng.integers(1, 4))
    k = k or int(rng.integers(1, n + 1))
    m = m or int(rng.integers(1, k + 1))
    weights = rng.uniform(0.2, 3.0, n) if rng.random() < 0.5 else None
    times = np.cumsum(rng.uniform(0.5, 2.0, n)).round(3)
    track = Track("t", times, rng.normal(0, 3, (n, d)).cumsum(axis=0).round(3), weights=weights)
    boundaries = np.array(
        [0, *np.sort(rng.choice(np.arange(1, n), k - 1, replace=False)), n], dtype=np.int64
    )
    sums = track_sums(track)
    points = rng.normal(0, 5, (2, m, d)).round(3) / sums.position_tick
    return track, sums, EMState(boundaries, rng.integers(0, m, k).astype(np.int32), *points)


def in_metres(sums, state):
    return to_metres(sums, state.starts), to_metres(sums, state.ends)


def cost_of(track, sums, state):
    return oracle.cost(track, state.boundaries, state.labels, *in_metres(sums, state))


@pytest.mark.parametrize("seed", range(40))
def test_the_cost_is_the_sum_of_squared_residuals(seed):
    track, sums, state = random_problem(seed)
    assert total_cost(sums, state) * sums.position_tick**2 == pytest.approx(
        cost_of(track, sums, state), rel=1e-8, abs=1e-8
    )


def test_naive_and_linear_are_identical_on_hundreds_of_problems():
    changed = 0
    for seed in range(400):
        _, sums, state = random_problem(seed)
        naive, linear = estep.naive(sums, state), estep.linear(sums, state)
        assert naive.boundaries.tolist() == linear.boundaries.tolist(), seed
        assert naive.labels.tolist() == linear.labels.tolist(), seed
        changed += naive.boundaries.tolist() != state.boundaries.tolist()
    assert changed > 200


@pytest.mark.parametrize("seed", range(40))
def test_every_form_equals_the_reference(seed):
    track, sums, state = random_problem(seed, d=2)
    k = len(state.labels)
    segments = in_metres(sums, state)
    in_turn = oracle.shift_boundaries(track, state.boundaries, state.labels, *segments, range(1, k))
    even = oracle.shift_boundaries(track, state.boundaries, state.labels, *segments, range(2, k, 2))
    both = oracle.shift_boundaries(track, *even, *segments, range(1, k, 2))
    for form, (boundaries, labels) in ((estep.linear, in_turn), (estep.odd_even, both)):
        # labels may differ where a single sample costs the same
        expected = oracle.cost(track, boundaries, labels, *segments)
        assert cost_of(track, sums, form(sums, state)) == pytest.approx(expected, rel=1e-9)


def test_no_form_raises_the_cost():
    for seed in range(200):
        _, sums, state = random_problem(seed)
        before = total_cost(sums, state)
        for form in (estep.naive, estep.linear, estep.odd_even, estep.exact):
            after = form(sums, state)
            assert total_cost(sums, after) <= before * (1 + 1e-12), (seed, form)
            assert (len(after.boundaries), after.boundaries[0], after.boundaries[-1]) == (
                len(state.labels) + 1,
                0,
                len(sums.t),
            )
            assert np.diff(after.boundaries).min() >= 1


@pytest.mark.parametrize("min_samples", [2, 4])
def test_no_interval_becomes_shorter_than_min_samples(min_samples):
    for seed in range(30):
        _, sums, state = random_problem(seed, n=40, k=8)
        state = replace(state, boundaries=np.arange(0, 41, 5))
        for form in (estep.linear, estep.odd_even, estep.exact):
            assert (
                np.diff(form(sums, state, min_samples=min_samples).boundaries).min() >= min_samples
            )


def test_threads_change_nothing(monkeypatch):
    monkeypatch.setattr(estep, "_BATCH", 3)
    for seed in range(20):
        _, sums, state = random_problem(seed, n=120, k=41 + seed % 2, m=6)
        serial, threaded = (
            estep.odd_even(sums, state),
            estep.odd_even(sums, state, executor=Threads(2)),
        )
        assert serial.boundaries.tolist() == threaded.boundaries.tolist()
        assert serial.labels.tolist() == threaded.labels.tolist()


def test_maximize_is_pooled_least_squares_and_never_raises_the_cost():
    for seed in range(200):
        track, sums, state = random_problem(seed)
        after = maximize(sums, state)
        assert total_cost(sums, after) <= total_cost(sums, state) * (1 + 1e-12), seed
        parts = list(zip(state.boundaries[:-1], state.boundaries[1:], strict=True))
        least = sum(
            oracle.pooled_cost(track, [parts[j] for j in np.flatnonzero(state.labels == label)])
            for label in set(state.labels)
        )
        assert total_cost(sums, after) * sums.position_tick**2 == pytest.approx(
            least, rel=1e-6, abs=1e-6
        ), seed


def test_an_unused_segment_gets_the_line_of_the_worst_interval():
    _, sums, state = random_problem(3, n=30, k=5, m=3)
    state = replace(state, labels=np.array([0, 0, 2, 0, 2], dtype=np.int32))
    after = maximize(sums, state)
    free = maximize(
        sums,
        EMState(
            state.boundaries,
            np.arange(5, dtype=np.int32),
            np.zeros((5, sums.p.shape[1])),
            np.zeros((5, sums.p.shape[1])),
        ),
    )
    gain = interval_costs(sums, after) - interval_costs(sums, free)
    worst = int(gain.argmax())
    assert gain[worst] > 0
    np.testing.assert_allclose(
        [after.starts[1], after.ends[1]], [free.starts[worst], free.ends[worst]]
    )


@pytest.mark.parametrize("seed", range(20))
def test_the_two_segment_mean_tries_every_cut_and_both_ends(seed):
    track, sums, state = random_problem(seed, d=2)
    segments = in_metres(sums, state)
    for min_samples in (0, 1):
        mean = two_segment_mean(track, *segments, min_samples=min_samples)
        expected = oracle.best_cut(track, 0, len(track), *segments, min_samples=min_samples)
        assert mean.cost == pytest.approx(expected[0], rel=1e-9)
    if len(track) > 4:
        mean = two_segment_mean(track, [track.positions[0]], [track.positions[-1]])
        assert mean.boundary in range(len(track) + 1)


def test_a_straight_track_uses_one_of_two_segments():
    track = Track("straight", np.arange(5), np.arange(5)[:, None])
    mean = two_segment_mean(track, [[9.0], [0.0]], [[9.0], [4.0]])
    assert mean.cost == pytest.approx(0, abs=1e-12)
    assert mean.boundary in {0, 5}


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize(("min_samples", "stride"), [(1, 1), (3, 1), (1, 3), (4, 2)])
def test_pruning_the_penalised_partition_loses_nothing(seed, min_samples, stride):
    track, sums, state = random_problem(seed, n=25, m=3)
    segments, tick = in_metres(sums, state), sums.position_tick**2
    for penalty in (0.0, 0.5, 20.0, 1e4):
        boundaries, labels = penalised_partition(
            sums, state.starts, state.ends, penalty / tick, min_samples=min_samples, stride=stride
        )
        cost = oracle.cost(track, boundaries, labels, *segments) + penalty * len(labels)
        assert cost == pytest.approx(
            oracle.penalised_cost(track, *segments, penalty, min_samples, stride),
            rel=1e-8,
            abs=1e-8,
        )
        assert np.diff(boundaries).min() >= min_samples


@pytest.mark.parametrize("seed", range(10))
def test_the_exact_partition_is_optimal(seed):
    track, sums, state = random_problem(seed, n=11, m=3)
    segments = in_metres(sums, state)
    for k in (1, 2, 4, 11):
        boundaries, labels = exact_partition(sums, state.starts, state.ends, k)
        assert len(labels) == k
        assert oracle.cost(track, boundaries, labels, *segments) == pytest.approx(
            oracle.best_partition(track, *segments, k), rel=1e-8
        )


def test_a_long_track_is_cut_into_exactly_k_intervals(monkeypatch):
    for seed in range(10):
        _, sums, state = random_problem(seed, n=60, k=12, m=4)
        boundaries, labels = exact_partition(sums, state.starts, state.ends, 12)
        optimum = total_cost(sums, replace(state, boundaries=boundaries, labels=labels))
        with monkeypatch.context() as patch:
            patch.setattr(partitions, "_MAX_TABLE_SAMPLES", 0)
            boundaries, labels = exact_partition(sums, state.starts, state.ends, 12)
        penalised = total_cost(sums, replace(state, boundaries=boundaries, labels=labels))
        assert len(labels) == 12
        assert optimum * (1 - 1e-9) <= penalised <= 1.2 * optimum
        assert optimum <= total_cost(sums, estep.odd_even(sums, state)) * (1 + 1e-9)


def test_intervals_below_min_samples_stay_if_no_allowed_cut_is_better():
    for seed in range(60):
        _, sums, state = random_problem(seed, n=24, k=3, m=3)
        state = maximize(
            sums,
            replace(
                state,
                boundaries=np.array([0, 2, 13, 24]),
                labels=np.array([0, 1, 2], dtype=np.int32),
            ),
        )
        for form in (estep.naive, estep.linear, estep.odd_even):
            after = form(sums, state, min_samples=6)
            assert total_cost(sums, after) <= total_cost(sums, state) * (1 + 1e-12), (seed, form)


@pytest.mark.parametrize("seed", range(12))
def test_segments_that_are_pruned_by_their_distance_are_not_missed(seed):
    """Many segments all over the place, most of them far from the samples."""
    rng = np.random.default_rng(seed)
    n, d, m = 60, 1 + seed % 3, 30
    weights = rng.uniform(0.2, 3.0, n) if seed % 2 else None
    positions = np.linspace(0, 50, n)[:, None] * rng.normal(size=d) + rng.normal(0, 0.3, (n, d))
    track = Track("t", np.arange(n), positions.round(3), weights=weights)
    sums = track_sums(track)
    points = rng.uniform(-60, 60, (2, m, d)) / sums.position_tick
    # some segments without a length, and one twice
    points[1, :3] = points[0, :3]
    points[:, 4] = points[:, 3]
    boundaries = np.array([0, 9, 20, 33, 47, n])
    state = EMState(boundaries, rng.integers(0, m, 5).astype(np.int32), *points)
    naive, linear = estep.naive(sums, state), estep.linear(sums, state)
    assert naive.boundaries.tolist() == linear.boundaries.tolist()
    assert naive.labels.tolist() == linear.labels.tolist()
    assert linear.boundaries.tolist() != state.boundaries.tolist()
