"""Slices cover each sample once, and the walks of neighbouring slices are joined to one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import GridWalk, QuantisationGrid, Track, Walk
from gpszip.pipeline.slices import batch_slices, join_at_cut, slice_tracks
from gpszip.walks.error import synchronised_errors
from gpszip.walks.quantised import knot_times

GRID = QuantisationGrid((0,), 0, 128, 128)
NODE_POSITIONS = np.arange(100.0)[:, None]


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=9), st.integers(1, 900))
def test_slices_cover_each_sample_once_and_batches_hold_all_slices(counts, length):
    slices = slice_tracks(counts, length)
    seen = [np.zeros(count, int) for count in counts]
    for piece in slices:
        assert 0 <= piece.first <= piece.begin < piece.end <= piece.last <= counts[piece.track]
        assert piece.end - piece.begin <= length
        seen[piece.track][piece.begin : piece.end] += 1
    assert all((times == 1).all() for times in seen)
    batches = batch_slices(slices, length)
    assert [piece for batch in batches for piece in batch] == slices
    assert all(
        len(batch) == 1 or sum(piece.samples for piece in batch) <= length for batch in batches
    )


def walk(*knots, gaps=None):
    """A walk of knots, each a node and a time step."""
    nodes, time_steps = zip(*knots, strict=True)
    return GridWalk(
        np.array(nodes, np.int32),
        np.array(time_steps),
        np.zeros(len(time_steps) - 1, bool) if gaps is None else np.array(gaps),
    )


def track_at(*times):
    """A track on a line whose position is the time."""
    return Track("a", times, [[float(t)] for t in times])


def test_walks_are_joined_at_a_common_knot():
    before, after = (
        walk((0, 0), (10, 10), (20, 20), (33, 33)),
        walk((8, 8), (10, 10), (20, 20), (40, 40), (60, 60)),
    )
    joined, is_common = join_at_cut(
        before, after, track_at(12, 15, 18, 21, 24), 18.0, GRID, NODE_POSITIONS
    )
    assert is_common
    assert joined.time_steps.tolist() == [0, 10, 20, 40, 60]
    assert joined.nodes.tolist() == joined.time_steps.tolist()


def test_joining_keeps_gaps():
    before = walk((0, 0), (10, 10), (20, 20), (33, 33), gaps=[True, False, False])
    after = walk((10, 10), (20, 20), (40, 40), (60, 60), gaps=[False, True, False])
    joined, _ = join_at_cut(before, after, track_at(12, 18, 24), 18.0, GRID, NODE_POSITIONS)
    assert joined.gaps.tolist() == [True, False, True, False]


def test_walks_without_a_common_knot_are_joined_near_the_samples():
    before, after = (
        walk((0, 0), (11, 10), (16, 16), (33, 31)),
        walk((8, 9), (14, 14), (22, 22), (60, 60)),
    )
    joined, is_common = join_at_cut(
        before, after, track_at(12, 15, 18, 21, 24), 18.0, GRID, NODE_POSITIONS
    )
    assert not is_common
    assert (np.diff(joined.time_steps) > 0).all()
    assert joined.time_steps[0] == 0
    assert joined.time_steps[-1] == 60
    decoded = Walk("a", joined.nodes, knot_times(joined.time_steps, GRID), joined.gaps)
    assert synchronised_errors(
        track_at(12, 15, 18, 21, 24), decoded, NODE_POSITIONS
    ).max() == pytest.approx(0, abs=0.9)


@pytest.mark.parametrize("shift", [0, 1, 5])
def test_walks_of_two_knots_are_joined(shift):
    before, after = walk((0, 0), (30, 30)), walk((20, 20 + shift), (90, 90))
    joined, _ = join_at_cut(before, after, track_at(22, 26), 24.0, GRID, NODE_POSITIONS)
    assert joined.time_steps[0] == 0
    assert joined.time_steps[-1] == 90
    assert (np.diff(joined.time_steps) > 0).all()
