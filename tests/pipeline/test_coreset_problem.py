"""Segment means that are learned from coresets, checked at all samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.pipeline.coreset_problem import CoresetProblem
from gpszip.segmentation.evaluate import distances, rmse
from gpszip.segmentation.runs import join_tracks
from gpszip.testing import patrol


@pytest.fixture(scope="module")
def track():
    return patrol(3000)


@pytest.fixture(scope="module")
def small(track):
    return gpszip.coreset(track, size=120)


@pytest.mark.parametrize(("k", "m"), [(1, 1), (12, 5), (30, 30)])
def test_the_true_cost_is_within_the_bounds(track, small, k, m):
    problem = CoresetProblem(small)
    mean = problem.solve(k, m)
    assert (mean.k, mean.m, mean.boundaries[-1]) == (k, m, len(track))
    cost = problem.cost(mean)
    true = float(np.square(distances(mean, track)).sum())
    assert cost.lower <= true * (1 + 1e-9)
    assert true * (1 - 1e-9) <= cost.upper
    assert mean.cost == cost.estimate == pytest.approx(true, rel=0.02)
    assert small.least_cost(k) <= true


def test_an_rmse_is_held_at_samples_that_are_not_at_hand(track, small):
    for options in ({"k": 20}, {}, {"m": 12}):
        mean = gpszip.segment_mean(small, rmse=0.6, **options)
        assert rmse(mean, track) <= 0.6


def test_a_stream_gives_what_its_coreset_gives(track):
    stream = gpszip.CoresetStream(120)
    for first in range(0, len(track), 700):
        rows = slice(first, first + 700)
        stream.push(track.times[rows], track.positions[rows])
    mean = gpszip.segment_mean(stream, k=20, m=8)
    assert mean.boundaries[-1] == len(track)
    same = gpszip.segment_mean(stream.coreset(), k=20, m=8)
    assert mean.starts.tolist() == same.starts.tolist()
    model = gpszip.markov_model(mean, stream)
    assert model.counts.sum() == 19
    assert model.sigma == pytest.approx(np.sqrt(mean.cost / (2 * len(track))))


def test_bounds_are_checked_at_samples_that_are_at_hand(track):
    mean = gpszip.segment_mean(track, rmse=0.6, max_error=2.5, coreset=120)
    assert rmse(mean, track) <= 0.6
    assert distances(mean, track).max() <= 2.5


def test_tracks_of_a_coreset_are_runs(track):
    tracks = [track[:60.0], replace(track[60.0:130.0], id="b")]
    small = gpszip.coreset(tracks, size=60)
    mean = gpszip.segment_mean(small, k=14, m=6)
    assert mean.boundaries[mean.heads].tolist() == [0, len(tracks[0])]
    joined, _ = join_tracks(tracks)
    problem = CoresetProblem(small)
    cost = problem.cost(mean)
    assert cost.lower <= np.square(distances(mean, joined)).sum() <= cost.upper


def test_gaps_of_samples_at_hand_are_no_blocks(track):
    times = track.times + np.where(np.arange(len(track)) < 1500, 0.0, 1e4)
    broken = gpszip.Track("broken", times, track.positions)
    mean = gpszip.segment_mean(broken, k=20, m=8, gap=60.0, coreset=80)
    assert mean.boundaries[mean.heads].tolist() == [0, 1500]


def test_the_elbow_is_found_on_a_coreset(track, small):
    mean = gpszip.segment_mean(small, (2, 30), (1, 12))
    assert 2 <= mean.k <= 30
    assert mean.cost == pytest.approx(np.square(distances(mean, track)).sum(), rel=0.02)


def test_what_a_coreset_cannot_tell_is_refused(track, small):
    with pytest.raises(OptionError, match="no samples whose maximum"):
        gpszip.segment_mean(small, k=5, max_error=3.0)
    with pytest.raises(OptionError, match="leave it out"):
        gpszip.segment_mean(small, k=5, m=2, coreset=20)
