"""Stretches cover every sample once, and their walks become one that is where either was."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import GridWalk, QuantisationGrid, Track, Walk
from gpszip.pipeline.slices import batch_slices, join_at_cut, slice_tracks
from gpszip.walks.error import synchronised_errors
from gpszip.walks.quantised import knot_times

FRAME = QuantisationGrid((0,), 0, 128, 128)
PLACES = np.arange(100.0)[:, None]


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=9), st.integers(1, 900))
def test_every_sample_counts_once_and_batches_hold_all_slices(counts, length):
    slices = slice_tracks(counts, length)
    seen = [np.zeros(count, int) for count in counts]
    for one in slices:
        assert 0 <= one.first <= one.begin < one.end <= one.last <= counts[one.track]
        assert one.end - one.begin <= length
        seen[one.track][one.begin : one.end] += 1
    assert all((times == 1).all() for times in seen)
    batches = batch_slices(slices, length)
    assert [one for batch in batches for one in batch] == slices
    assert all(len(batch) == 1 or sum(one.samples for one in batch) <= length for batch in batches)


def walk(*knots, gaps=None):
    nodes, cells = zip(*knots, strict=True)
    return GridWalk(
        np.array(nodes, np.int32),
        np.array(cells),
        np.zeros(len(cells) - 1, bool) if gaps is None else np.array(gaps),
    )


def along(*times):
    return Track("a", times, [[float(t)] for t in times])


def test_a_knot_that_both_have_is_the_seam():
    before, after = (
        walk((0, 0), (10, 10), (20, 20), (33, 33)),
        walk((8, 8), (10, 10), (20, 20), (40, 40), (60, 60)),
    )
    joined, met = join_at_cut(before, after, along(12, 15, 18, 21, 24), 18.0, FRAME, PLACES)
    assert met
    assert joined.time_steps.tolist() == [0, 10, 20, 40, 60]
    assert joined.nodes.tolist() == joined.time_steps.tolist()


def test_gaps_stay_where_they_are():
    before = walk((0, 0), (10, 10), (20, 20), (33, 33), gaps=[True, False, False])
    after = walk((10, 10), (20, 20), (40, 40), (60, 60), gaps=[False, True, False])
    joined, _ = join_at_cut(before, after, along(12, 18, 24), 18.0, FRAME, PLACES)
    assert joined.gaps.tolist() == [True, False, True, False]


def test_walks_that_do_not_meet_are_joined_where_the_way_is_nearest_to_the_samples():
    before, after = (
        walk((0, 0), (11, 10), (16, 16), (33, 31)),
        walk((8, 9), (14, 14), (22, 22), (60, 60)),
    )
    joined, met = join_at_cut(before, after, along(12, 15, 18, 21, 24), 18.0, FRAME, PLACES)
    assert not met
    assert (np.diff(joined.time_steps) > 0).all()
    assert joined.time_steps[0] == 0
    assert joined.time_steps[-1] == 60
    decoded = Walk("a", joined.nodes, knot_times(joined.time_steps, FRAME), joined.gaps)
    assert synchronised_errors(along(12, 15, 18, 21, 24), decoded, PLACES).max() == pytest.approx(
        0, abs=0.9
    )


@pytest.mark.parametrize("shift", [0, 1, 5])
def test_walks_of_few_knots_are_joined_somehow(shift):
    before, after = walk((0, 0), (30, 30)), walk((20, 20 + shift), (90, 90))
    joined, _ = join_at_cut(before, after, along(22, 26), 24.0, FRAME, PLACES)
    assert joined.time_steps[0] == 0
    assert joined.time_steps[-1] == 90
    assert (np.diff(joined.time_steps) > 0).all()
