from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model.selection import BoundingBox
from gpszip.model.walk import Walk
from gpszip.walks.restrict import (
    find_intervals,
    restrict_knots,
    restrict_shape,
    segments_in_box,
)

SMALL = st.integers(-6, 6)
POINTS = st.lists(st.tuples(SMALL, SMALL), min_size=2, max_size=8)


def _walk(times, gaps=None, time_ranges=None):
    count = len(times)
    gaps = np.zeros(count - 1, bool) if gaps is None else np.array(gaps)
    return Walk("a", np.arange(count, dtype=np.int32), np.array(times, float), gaps, time_ranges)


@given(POINTS, SMALL, SMALL, st.integers(0, 6), st.integers(0, 6))
def test_shares_of_segments_are_those_of_points_tried_one_by_one(
    points, west, south, width, height
):
    line = np.array(points, float)
    box = BoundingBox(west, south, west + width, south + height)
    inside = segments_in_box(line, box, geographic=False)
    shares = np.linspace(0, 1, 241)
    for (start, stop), (enters, leaves) in zip(pairwise(line), inside, strict=True):
        x, y = (start + shares[:, None] * (stop - start)).T
        tolerance = 1e-9
        is_inside = (
            (x >= box.west - tolerance)
            & (x <= box.east + tolerance)
            & (y >= box.south - tolerance)
            & (y <= box.north + tolerance)
        )
        if np.isnan(enters):
            # Only the rounding of the shares tried may put one on a side.
            strictly = (x > box.west + tolerance) & (x < box.east - tolerance)
            assert not (strictly & (y > box.south + tolerance) & (y < box.north - tolerance)).any()
            continue
        claimed = (shares >= enters - tolerance) & (shares <= leaves + tolerance)
        np.testing.assert_array_equal(claimed, is_inside)


@given(POINTS, st.integers(-3, 3))
def test_turns_of_the_globe_change_nothing(points, turns):
    line = np.array(points, float) + np.array([0, 178])
    box = BoundingBox(176, -3, -179, 3)
    here = segments_in_box(line, box, geographic=True)
    there = segments_in_box(line + np.array([0, 360 * turns]), box, geographic=True)
    wrapped = line.copy()
    wrapped[:, 1] = (wrapped[:, 1] + 180) % 360 - 180
    np.testing.assert_allclose(here, there, atol=1e-9)
    np.testing.assert_allclose(here, segments_in_box(wrapped, box, geographic=True), atol=1e-9)


def test_the_whole_globe_is_no_empty_box():
    line = np.array([[0.0, -170.0], [10.0, 170.0]])
    assert segments_in_box(line, BoundingBox(-180, -90, 180, 90), geographic=True).tolist() == [
        [0.0, 1.0]
    ]


def test_travel_that_an_archive_does_not_claim_is_not_selected():
    walk = _walk([0, 10, 20, 30], [False, True, False], np.array([[2.0, 9.0], [20.0, 25.0]]))
    line = np.zeros((4, 2))
    found = find_intervals(walk, line, time_range=(1.0, 22.0), bbox=None, geographic=False)
    assert [of_piece.tolist() for of_piece in found] == [[[2.0, 9.0]], [[20.0, 22.0]]]


def test_a_walk_that_leaves_and_returns_has_a_gap():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]])
    walk = _walk([0, 10, 20])
    box = BoundingBox(-1, -1, 4, 1)
    found = find_intervals(walk, line, time_range=(-np.inf, np.inf), bbox=box, geographic=False)
    assert found[0].tolist() == [[0.0, 4.0], [16.0, 20.0]]
    kept = restrict_knots(walk, found)
    assert kept.knots.tolist() == [0, 1, 1, 2]
    assert kept.gaps.tolist() == [False, True, False]


def test_a_walk_outside_of_the_time_range_is_nothing():
    walk = _walk([0, 10])
    found = find_intervals(walk, np.zeros((2, 2)), time_range=(11, 12), bbox=None, geographic=False)
    assert restrict_knots(walk, found) is None


@pytest.mark.parametrize(("x", "knots"), [(0.5, [0, 1]), (1.5, [1, 2]), (9.0, None)])
def test_segments_of_a_shape_that_touch_the_area_remain_whole(x, knots):
    shape = Walk("a", np.arange(3, dtype=np.int32), None, np.zeros(2, bool))
    line = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    kept = restrict_shape(shape, line, BoundingBox(x, -1, x, 1), geographic=False)
    assert (None if kept is None else kept.knots.tolist()) == knots
