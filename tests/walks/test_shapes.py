from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import GridWalks, Track, Walk
from gpszip.walks.shapes import (
    assign_times_by_distance,
    drop_time_steps,
    shape_error,
    shape_slice_error,
    with_synthetic_times,
)
from oracle.walks import walk
from random_tests import examples


def positions_at_fractions(line, fractions):
    """Positions at fractions of a line's length, by walking along it step by step."""
    steps = [float(np.linalg.norm(b - a)) for a, b in zip(line, line[1:], strict=False)]
    positions = []
    for fraction in fractions:
        remaining, position = fraction * sum(steps), line[-1]
        for a, b, step in zip(line, line[1:], steps, strict=False):
            if remaining <= step:
                position = a + (b - a) * (remaining / step if step else 0.0)
                break
            remaining -= step
        positions.append(position)
    return np.array(positions)


@examples(30)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(2, 12))
def test_shape_errors_match_many_points_at_equal_fractions(seed, n, k):
    rng = np.random.default_rng(seed)
    samples, knots = rng.normal(0, 50, (n, 2)), rng.normal(0, 50, (k, 2))
    mean_square, largest = shape_error(samples, knots)

    fractions = (np.arange(2000) + 0.5) / 2000
    distance = np.linalg.norm(
        positions_at_fractions(samples, fractions) - positions_at_fractions(knots, fractions),
        axis=1,
    )
    assert mean_square == pytest.approx((distance**2).mean(), rel=2e-2, abs=1e-6)
    assert largest >= distance.max() - 1e-9
    assert largest == pytest.approx(distance.max(), rel=2e-2, abs=1.0)


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(1, 12), st.data())
def test_errors_of_slices_add_up_to_that_of_the_shape(seed, n, k, data):
    rng = np.random.default_rng(seed)
    samples, nodes = rng.normal(0, 50, (n, 2)), rng.normal(0, 50, (k, 2))
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(samples, axis=0), axis=1)))
    whole = Walk("a", np.arange(k, dtype=np.int32), None, np.zeros(k - 1, bool))
    whole = assign_times_by_distance(whole, nodes, 0.0, along[-1])

    # Neighbouring slices share a sample.
    cuts = sorted({0, n - 1, *data.draw(st.sets(st.integers(0, n - 1)))})
    errors = [
        shape_slice_error(
            Track("a", along[a : b + 1], samples[a : b + 1], timed=False), whole, nodes
        )
        for a, b in pairwise(cuts)
    ]
    shares = np.diff(along[cuts]) / along[-1]
    mean_square, largest = shape_error(samples, nodes)
    assert sum(shares * [square for square, _ in errors]) == pytest.approx(mean_square)
    assert max(distance for _, distance in errors) == pytest.approx(largest)


def test_sampling_does_not_change_a_shape():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 30.0]])
    dense = np.array([[0.0, 0.0], [4.0, 0.0], [10.0, 0.0], [10.0, 1.0], [10.0, 29.0], [10.0, 30.0]])
    assert shape_error(line, dense) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_shapes_without_length_are_compared_as_positions():
    assert shape_error(np.array([[3.0, 4.0]]), np.array([[0.0, 0.0]])) == (25.0, 5.0)
    assert shape_error(np.array([[3.0, 4.0]]), np.array([[0.0, 0.0], [0.0, 0.0]])) == (25.0, 5.0)
    assert shape_error(np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [6.0, 0.0]])) == (12.0, 6.0)


def test_shapes_get_the_mean_speed_of_tracks_with_times():
    drive = Track("a", [100.0, 110.0, 111.0, 500.0], [[0.0], [50.0], [55.0], [90.0]])
    shape = Track("b", [0.0, 30.0], [[0.0], [30.0]], timed=False)
    same, timed = with_synthetic_times(
        [drive, shape], [np.array([False, False, True]), np.zeros(1, bool)]
    )
    assert same is drive
    assert timed.timed
    assert timed.times == pytest.approx([100.0, 106.0])  # 55 m in 11 s


def test_shapes_start_with_the_earliest_track_even_if_it_is_parked():
    parked = Track("a", [100.0, 200.0], [[0.0], [0.0]])
    drive = Track("b", [150.0, 160.0], [[0.0], [50.0]])
    shape = Track("c", [0.0, 30.0], [[0.0], [30.0]], timed=False)
    for tracks in ([parked, drive, shape], [drive, parked, shape]):
        timed = with_synthetic_times(tracks, [np.zeros(1, bool)] * 3)
        assert timed[2].times == pytest.approx([100.0, 106.0])


def test_walk_gets_times_by_fractions_of_its_length():
    nodes = np.array([[0.0, 0.0], [30.0, 40.0], [30.0, 90.0]])
    timed = assign_times_by_distance(
        Walk("a", np.array([0, 1, 1, 2], np.int32), None, np.zeros(3, bool)), nodes, 10.0, 20.0
    )
    assert timed.times == pytest.approx([10.0, 15.0, 15.0, 20.0])


def test_shapes_lose_times_and_stops():
    shape, drive = walk([0, 1, 1, 2], [7, 9, 30, 31]), walk([2, 0], [50, 60])
    walks = GridWalks(np.array([[0], [5], [9]]), (shape, drive))
    alone = drop_time_steps(GridWalks(walks.nodes, (shape,)), frozenset({0}), others=False)
    assert (alone.timed, alone.walks[0].nodes.tolist(), alone.walks[0].time_steps.tolist()) == (
        False,
        [0, 1, 2],
        [0, 0, 0],
    )
    mixed = drop_time_steps(walks, frozenset({0}), others=True)
    assert (mixed.timed, mixed.untimed, mixed.walks[0].time_steps.tolist()) == (
        True,
        {0},
        [50, 51, 52],
    )
    assert mixed.walks[1] is drive
