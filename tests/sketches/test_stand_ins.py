from __future__ import annotations

import numpy as np
import pytest

from gpszip import coreset
from gpszip.model import Track
from gpszip.sketches.stand_ins import stand_ins


def wander(n, seed, d=2):
    rng = np.random.default_rng(seed)
    return Track(f"{seed}", 5.0 * np.arange(n), rng.normal(0, 1, (n, d)).cumsum(axis=0))


@pytest.mark.parametrize("size", [1, 3, 12, 40])
@pytest.mark.parametrize("most", [2, 3, 8])
def test_costs_of_lines_differ_by_the_free_costs_only(size, most):
    track = wander(40, size)
    blocks = coreset(track, size=size)
    found = stand_ins(blocks, most)
    (small,) = found.tracks
    assert small.weights.sum() == pytest.approx(40)
    firsts = np.searchsorted(found.numbers, np.cumsum([0, *blocks.counts]))
    for j, (first, after) in enumerate(zip(firsts[:-1], firsts[1:], strict=True)):
        begin, end = np.cumsum([0, *blocks.counts])[[j, j + 1]]
        own, true = slice(first, after), slice(begin, end)
        assert small.times[first] == track.times[begin]
        assert small.times[after - 1] == track.times[end - 1]
        # their mean and drift are those of the samples, so the line that costs least is, too
        centred = small.times[own] - small.times[own].mean()
        mean = np.average(small.positions[own], axis=0, weights=small.weights[own])
        assert mean == pytest.approx(track.positions[true].mean(axis=0))
        assert centred @ small.weights[own] == pytest.approx(0, abs=1e-6)
        if after - first > 1:
            fit = np.polyfit(track.times[true], track.positions[true], 1)
            again = np.polyfit(small.times[own], small.positions[own], 1)
            assert again == pytest.approx(fit, abs=1e-6)


def test_numbers_are_those_of_the_samples_of_all_tracks():
    tracks = [wander(30, 0), wander(17, 1)]
    blocks = coreset(tracks, size=9)
    found = stand_ins(blocks, 100)
    assert found.numbers.tolist() == list(range(47))
    times = np.concatenate([track.times for track in found.tracks])
    assert times == pytest.approx(np.concatenate([track.times for track in tracks]))
    assert [track.id for track in found.tracks] == ["0", "1"]
    few = stand_ins(blocks, 2)
    assert (np.diff(few.numbers) > 0).all()


def test_a_block_at_one_time_has_one():
    found = stand_ins(coreset(Track("dot", [3.0], [[1.0, 2.0]]), size=1), 8)
    assert found.tracks[0].positions.tolist() == [[1.0, 2.0]]
