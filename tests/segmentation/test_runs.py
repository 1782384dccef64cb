"""Several tracks, and pieces between gaps, in one segment mean."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from gpszip.errors import OptionError
from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.segmentation.bottom_up import bottom_up
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.evaluate import distances
from gpszip.segmentation.runs import join_tracks


def lanes(count, samples=24, seed=0):
    """Tracks that each go up a lane of 10 m and back, with noise."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([np.linspace(0, 10, samples // 2), np.linspace(10, 0, samples // 2)])
    return [
        Track(
            f"{number}",
            100.0 * number + np.arange(samples),
            np.stack([x, np.full(samples, 0.0)], axis=1) + rng.normal(0, 0.05, (samples, 2)),
        )
        for number in range(count)
    ]


def test_joined_tracks_keep_their_steps():
    tracks = lanes(3)
    joined, begins = join_tracks(tracks)
    assert begins.tolist() == [0, 24, 48]
    for begin, track in zip(begins, tracks, strict=True):
        rows = slice(begin, begin + len(track))
        assert np.diff(joined.times[rows]).tolist() == np.diff(track.times).tolist()
        assert joined.positions[rows].tolist() == track.positions.tolist()
    assert join_tracks(tracks[:1])[0] is tracks[0]


def test_weights_of_some_tracks_are_those_of_all():
    plain, weighted = lanes(2)
    weighted = Track("w", weighted.times, weighted.positions, np.full(24, 3.0))
    joined, _ = join_tracks([plain, weighted])
    assert joined.weights.tolist() == [1.0] * 24 + [3.0] * 24


@pytest.mark.parametrize("k", [5, 6, 9, 30, 60])
def test_no_interval_leaves_its_run(k):
    joined, begins = join_tracks(lanes(5, samples=12))
    boundaries = bottom_up(track_sums(joined), k, begins=begins)
    assert len(boundaries) == k + 1
    assert (np.diff(boundaries) >= 1).all()
    assert set(begins.tolist()) <= set(boundaries.tolist())


@pytest.mark.parametrize("expectation", ["odd-even", "linear", "naive"])
@pytest.mark.parametrize(("k", "m"), [(8, 2), (9, 3), (8, 8)])
def test_tracks_share_segments_and_keep_their_ends(expectation, k, m):
    joined, begins = join_tracks(lanes(4))
    mean = segment_mean(joined, k, m, begins, expectation=expectation)
    assert mean.boundaries[mean.heads].tolist() == begins.tolist()
    assert np.square(distances(mean, joined)).sum() == pytest.approx(mean.cost, rel=1e-6)
    assert all(later <= cost * (1 + 1e-9) for cost, later in pairwise(mean.costs))
    assert mean.cost < 2.0


def test_one_run_is_a_track_as_ever():
    track = lanes(1)[0]
    plain, same = segment_mean(track, 4, 2), segment_mean(track, 4, 2, np.zeros(1, np.int64))
    assert plain.costs == same.costs
    assert plain.heads.tolist() == [0]


@pytest.mark.parametrize(
    ("k", "options", "words"),
    [
        (2, {}, "choose k >= 3"),
        (6, {"expectation": "exact"}, "one track without gaps"),
        (6, {"initial": "douglas-peucker"}, "one track without gaps"),
    ],
)
def test_what_runs_do_not_allow_is_refused(k, options, words):
    joined, begins = join_tracks(lanes(3))
    with pytest.raises(OptionError, match=words):
        segment_mean(joined, k, 2, begins, **options)
