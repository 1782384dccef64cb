import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gpszip.mapping.max_error import mend
from gpszip.mapping.verbatim import keep_samples
from gpszip.model import Frame, LatticeWalk, LatticeWalks, Track
from gpszip.walks.error import fit
from gpszip.walks.quantised import node_positions, walks_of


def coarse(track, gaps, keep, frame=None):
    """A walk over the ends of the pieces and some of the samples between them, on a fine lattice."""
    frame, lattice = keep_samples([track], [gaps], 0.01) if frame is None else frame
    walk = lattice.walks[0]
    first, last = np.append(True, gaps), np.append(gaps, True)
    kept = np.flatnonzero(first | last | keep)
    return frame, LatticeWalks(lattice.nodes, (LatticeWalk(walk.nodes[kept], walk.cells[kept], np.append(gaps, False)[kept[:-1]]),))


def errors(tracks, frame, lattice):
    return fit(tracks, walks_of(lattice, frame, [track.id for track in tracks]), node_positions(lattice, frame))


@given(st.integers(0, 10_000), st.integers(2, 120), st.integers(1, 3), st.sampled_from([0.1, 1.0, 8.0]))
@settings(max_examples=60, deadline=None)
def test_no_sample_stays_farther_than_the_maximum(seed, n, dimension, maximum):
    rng = np.random.default_rng(seed)
    track = Track("a", 1e6 + np.cumsum(rng.uniform(0.5, 3.0, n)), np.cumsum(rng.normal(0, 1, (n, dimension)), axis=0))
    gaps = rng.random(n - 1) < 0.05
    frame, lattice = coarse(track, gaps, rng.random(n) < 0.1)
    before = errors([track], frame, lattice)
    assume(not before.uncovered)  # a lone sample became a stop of two knots, which shifts those that this test keeps
    mended = mend([track], frame, lattice, maximum)
    assert mended is not None
    found = errors([track], *mended)
    assert found.max_error <= maximum
    assert found.uncovered == 0
    walk = mended[1].walks[0]
    assert (np.diff(walk.cells) > 0).all()
    assert walk.gaps.sum() == lattice.walks[0].gaps.sum()
    if before.max_error <= maximum:
        np.testing.assert_array_equal(walk.cells, lattice.walks[0].cells)


def test_a_detour_goes_by_nodes_that_are_there():
    x = np.concatenate([np.arange(10.0), np.arange(10.0, 0.0, -1), np.arange(11.0)])
    track = Track("a", np.arange(31.0), x[:, None])
    lattice = LatticeWalks(np.array([[0], [10]]), (LatticeWalk(np.array([0, 1], np.int32), np.array([0, 30]), np.array([False])),))
    _, mended = mend([track], Frame((0,), 0, 128, 128), lattice, 0.5)
    assert mended.nodes.tolist() == [[0], [10]]
    assert mended.walks[0].nodes.tolist() == [0, 1, 0, 1]


def test_a_lattice_too_coarse_is_made_finer_and_only_then():
    track = Track("a", np.arange(0.0, 40.0, 0.5), (np.arange(80)[:, None] // 2 % 2) * 5.0)
    lattice = LatticeWalks(np.array([[0]]), (LatticeWalk(np.array([0, 0], np.int32), np.array([0, 5]), np.array([False])),))
    frame, mended = mend([track], Frame((0,), 0, 100, 152), lattice, 1.0)
    assert frame.time < 152
    assert errors([track], frame, mended).max_error <= 1.0
    calm = Track("b", np.arange(0.0, 40.0, 0.5), np.zeros((80, 1)))
    assert mend([calm], Frame((0,), 0, 100, 152), lattice, 1.0)[0] == Frame((0,), 0, 100, 152)


def test_a_maximum_below_the_finest_lattice_is_missed():
    rng = np.random.default_rng(1)
    track = Track("a", np.arange(30.0), rng.normal(0, 1, (30, 2)))
    frame, lattice = coarse(track, np.zeros(29, bool), np.zeros(30, bool))
    assert mend([track], frame, lattice, 1e-7) is None


@pytest.mark.parametrize("count", [2, 3])
def test_tracks_share_the_nodes_that_mending_adds(count):
    one = Track("0", np.arange(20.0), np.where(np.arange(20)[:, None] == 9, 7.0, 0.0))
    tracks = [Track(str(i), one.times, one.positions) for i in range(count)]
    walk = LatticeWalk(np.array([0, 0], np.int32), np.array([0, 19]), np.array([False]))
    _, mended = mend(tracks, Frame((0,), 0, 128, 128), LatticeWalks(np.array([[0]]), (walk,) * count), 0.4)
    assert sorted(mended.nodes[:, 0].tolist()) == [0, 7]
