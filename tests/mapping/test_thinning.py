"""Thinned logs: the moments of all samples, the ends of every piece, and the same archive's bound."""

import numpy as np
import pytest

import gpszip
from gpszip import OptionError, Track
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import QuantisationGrid
from gpszip.testing.patrol import patrol


def log():
    walk = patrol(900, seed=3)
    gaps = [np.zeros(899, bool), np.zeros(1, bool), np.zeros(0, bool)]
    gaps[0][[200, 201, 700]] = True
    return [walk, Track("two", [5, 6], np.zeros((2, 2))), Track("one", [7], np.ones((1, 2)))], gaps


@pytest.mark.parametrize("size", [1, 30, 2000])
def test_every_piece_keeps_its_ends_and_all_weight(size):
    tracks, gaps = log()
    few, flags = reduce_to_coreset(tracks, gaps, size)
    for track, gap, thin, flag in zip(tracks, gaps, few, flags, strict=True):
        assert flag.sum() == gap.sum()
        assert thin.id == track.id
        assert thin.weights.sum() == pytest.approx(len(track))
        at = np.flatnonzero(flag)
        before = np.flatnonzero(gap)
        assert thin.times[[0, *at, -1]].tolist() == track.times[[0, *before, -1]].tolist()
        assert thin.times[at + 1].tolist() == track.times[before + 1].tolist()
        assert np.isin(thin.times, track.times).all()
    assert sum(map(len, few)) <= max(size, 4) * 8 + 11


def test_slots_count_weights_in_sixteenths():
    track = Track("a", range(3), np.zeros((3, 2)), [1.0, 2.5, 0.01])
    slots = build_time_grid([track], [np.zeros(2, bool)], QuantisationGrid((0, 0), 0, 128, 128))
    assert slots.weights.tolist() == [16, 40, 1]
    assert slots.samples == slots.sums[-1, 0] == 57
    plain = Track("b", range(3), np.zeros((3, 2)))
    assert (
        build_time_grid([plain], [np.zeros(2, bool)], QuantisationGrid((0, 0), 0, 128, 128)).samples
        == 3
    )


@pytest.mark.parametrize("bound", [{"rmse": 0.3}, {"max_error": 0.9}])
def test_the_bound_holds_at_all_samples(bound):
    track = patrol(3000, seed=8)
    archive = gpszip.compress(track, coreset=60, effort=1, **bound)
    off = np.linalg.norm(
        archive.position(track.id, track.times, metres=True) - track.positions, axis=1
    )
    assert np.sqrt((off**2).mean()) <= bound.get("rmse", np.inf)
    assert off.max() <= bound.get("max_error", np.inf)
    assert len(archive.to_bytes()) < 1.3 * len(gpszip.compress(track, effort=1, **bound).to_bytes())


def test_the_thesis_model_is_learnt_from_a_coreset_too():
    track = patrol(2000, seed=8)
    archive = gpszip.compress(track, coreset=100, k=12, m=8)
    assert np.isfinite(archive.position(track.id, track.times)).all()


def test_a_coreset_of_nothing_is_refused():
    with pytest.raises(OptionError, match="at least 1 block"):
        gpszip.compress(patrol(100), rmse=1, coreset=0)
