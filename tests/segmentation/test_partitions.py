"""Initial partitions: Douglas-Peucker and bottom-up, against references."""

from __future__ import annotations

import numpy as np
import pytest

from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.segmentation.bottom_up import bottom_up, relax_boundaries
from gpszip.segmentation.douglas_peucker import douglas_peucker
from gpszip.segmentation.kernels.bottom_up import bottom_up as merge_blocks
from oracle import segmentation as oracle


def random_track(seed, n=24, d=2, *, weighted=False):
    rng = np.random.default_rng(seed)
    weights = rng.uniform(0.5, 2.0, n) if weighted else None
    return Track(
        "t",
        np.cumsum(rng.uniform(0.5, 2.0, n)).round(3),
        rng.normal(0, 3, (n, d)).cumsum(axis=0).round(3),
        weights=weights,
    )


def free_cost(track, boundaries):
    return sum(
        oracle.pooled_cost(track, [part])
        for part in zip(boundaries[:-1], boundaries[1:], strict=True)
    )


@pytest.mark.parametrize("seed", range(10))
def test_douglas_peucker_equals_the_reference(seed):
    track = random_track(seed, d=1 + seed % 3)
    sums = track_sums(track)
    for k in (1, 2, 3, 7, 23):
        assert douglas_peucker(sums, k).tolist() == oracle.douglas_peucker(track, k)


@pytest.mark.parametrize("seed", range(6))
def test_bottom_up_equals_the_reference(seed):
    track = random_track(seed, 39, d=1 + seed % 3, weighted=seed % 2 == 1)
    firsts = np.arange(0, 39, 3)
    # blocks of three samples: merging single samples costs nothing, in any order
    for k in (1, 3, 9, 13):
        boundaries = merge_blocks(track_sums(track), firsts, firsts == 0, k).tolist()
        assert boundaries == oracle.bottom_up(track, k, 3)


@pytest.mark.parametrize("partition", [bottom_up, douglas_peucker])
@pytest.mark.parametrize("n", [1, 2, 3, 40])
def test_exactly_k_intervals_for_every_k(partition, n):
    for track in (
        random_track(0, n),
        Track("straight", np.arange(n), np.arange(n)[:, None]),
        Track("still", np.arange(n), np.zeros((n, 2))),
    ):
        sums = track_sums(track)
        for k in range(1, n + 1):
            boundaries = partition(sums, k)
            assert len(boundaries) == k + 1
            assert (boundaries[0], boundaries[-1]) == (0, n)
            assert (np.diff(boundaries) >= 1).all()


@pytest.mark.parametrize("min_samples", [2, 5])
def test_bottom_up_keeps_min_samples(min_samples):
    sums = track_sums(random_track(1, 60))
    for k in (1, 4, 60 // min_samples):
        assert np.diff(bottom_up(sums, k, min_samples=min_samples)).min() >= min_samples


@pytest.mark.parametrize("seed", range(8))
def test_relaxation_ends_at_a_local_optimum(seed):
    track = random_track(seed, 30)
    sums = track_sums(track)
    start = np.linspace(0, 30, 6).astype(np.int64)
    end = relax_boundaries(sums, start, sweeps=100)
    assert free_cost(track, end) < free_cost(track, start)
    for j in range(1, 5):
        for c in range(end[j - 1] + 1, end[j + 1]):
            changed = [*end[:j], c, *end[j + 1 :]]
            assert free_cost(track, changed) >= free_cost(track, end) - 1e-9


def test_bottom_up_finds_the_bends_of_a_long_track():
    corners = np.array([[0, 0], [100, 0], [100, 80], [0, 80], [0, 0]], dtype=float)
    positions = np.concatenate(
        [
            np.linspace(a, b, 250, endpoint=False)
            for a, b in zip(corners[:-1], corners[1:], strict=True)
        ]
    )
    noise = np.random.default_rng(0).normal(0, 0.05, positions.shape)
    boundaries = bottom_up(track_sums(Track("loop", np.arange(1000.0), positions + noise)), 4)
    assert np.abs(boundaries - [0, 250, 500, 750, 1000]).max() <= 2
