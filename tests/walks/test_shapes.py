import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.model import GridWalks, Track, Walk
from gpszip.walks.shapes import (
    assign_times_by_distance,
    drop_time_steps,
    shape_error,
    with_synthetic_times,
)
from oracle.walks import walk


def at_shares(line, shares):
    """Places at shares of a line's length, by walking along it step by step."""
    steps = [float(np.linalg.norm(b - a)) for a, b in zip(line, line[1:], strict=False)]
    found = []
    for share in shares:
        left, place = share * sum(steps), line[-1]
        for a, b, step in zip(line, line[1:], steps, strict=False):
            if left <= step:
                place = a + (b - a) * (left / step if step else 0.0)
                break
            left -= step
        found.append(place)
    return np.array(found)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(2, 12))
def test_errors_of_shapes_are_those_of_many_points_at_equal_shares(seed, n, k):
    rng = np.random.default_rng(seed)
    ours, theirs = rng.normal(0, 50, (n, 2)), rng.normal(0, 50, (k, 2))
    mean, most = shape_error(ours, theirs)
    middles = (np.arange(4000) + 0.5) / 4000
    apart = np.linalg.norm(at_shares(ours, middles) - at_shares(theirs, middles), axis=1)
    assert mean == pytest.approx((apart**2).mean(), rel=2e-2, abs=1e-6)
    assert most >= apart.max() - 1e-9
    assert most == pytest.approx(apart.max(), rel=2e-2, abs=1.0)


def test_a_shape_is_no_distance_from_itself_however_it_is_sampled():
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 30.0]])
    dense = np.array([[0.0, 0.0], [4.0, 0.0], [10.0, 0.0], [10.0, 1.0], [10.0, 29.0], [10.0, 30.0]])
    assert shape_error(line, dense) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_shapes_without_length_are_compared_as_places():
    assert shape_error(np.array([[3.0, 4.0]]), np.array([[0.0, 0.0]])) == (25.0, 5.0)
    assert shape_error(np.array([[3.0, 4.0]]), np.array([[0.0, 0.0], [0.0, 0.0]])) == (25.0, 5.0)
    assert shape_error(np.array([[0.0, 0.0]]), np.array([[0.0, 0.0], [6.0, 0.0]])) == (12.0, 6.0)


def test_shapes_are_paced_like_the_tracks_that_have_times():
    drive = Track("a", [100.0, 110.0, 111.0, 500.0], [[0.0], [50.0], [55.0], [90.0]])
    shape = Track("b", [0.0, 30.0], [[0.0], [30.0]], timed=False)
    one, other = with_synthetic_times(
        [drive, shape], [np.array([False, False, True]), np.zeros(1, bool)]
    )
    assert one is drive
    assert other.timed
    assert other.times == pytest.approx([100.0, 106.0])  # 55 m in 11 s


def test_a_walk_gets_the_shares_of_its_way_as_times():
    nodes = np.array([[0.0, 0.0], [30.0, 40.0], [30.0, 90.0]])
    found = assign_times_by_distance(
        Walk("a", np.array([0, 1, 1, 2], np.int32), None, np.zeros(3, bool)), nodes, 10.0, 20.0
    )
    assert found.times == pytest.approx([10.0, 15.0, 15.0, 20.0])


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
