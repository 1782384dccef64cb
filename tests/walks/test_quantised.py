import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import GridWalk, GridWalks, Plane, QuantisationGrid, Walk
from gpszip.model.grid import step_size
from gpszip.walks.quantised import (
    choose_grid,
    dequantise_road_map,
    dequantise_walks,
    knot_times,
    mark_piece_ends,
    node_positions,
    quantise_walks,
)


@st.composite
def grid_walks_of_archives(draw, timed=True):
    """Grid walks as an archive holds them: nodes in first-visit order, time steps from 0 up."""
    dimension = draw(st.integers(1, 4))
    count, walks = 0, []
    for _ in range(draw(st.integers(1, 4))):
        k = draw(st.integers(0, 12))
        nodes = []
        for _ in range(k + 1):
            nodes.append(draw(st.integers(0, count)))
            count = max(count, nodes[-1] + 1)
        gaps = np.array(draw(st.lists(st.booleans(), min_size=k, max_size=k)), bool)
        steps = draw(st.lists(st.integers(1, 1 << 40), min_size=k + 1, max_size=k + 1))
        cells = np.cumsum(steps, dtype=np.int64) if timed else np.zeros(k + 1, np.int64)
        walks.append(GridWalk(np.array(nodes, np.int32), cells, gaps))
    coordinate = st.integers(-(1 << 30), 1 << 30)
    nodes = draw(
        st.lists(
            st.lists(coordinate, min_size=dimension, max_size=dimension),
            min_size=count,
            max_size=count,
        )
    )
    return GridWalks(np.array(nodes, np.int64).reshape(count, dimension), tuple(walks), timed)


@st.composite
def timed_walks(draw):
    """Walks in seconds with knots at any time, also closer than any time step."""
    count = draw(st.integers(1, 6))
    nodes = np.array(
        draw(
            st.lists(
                st.lists(st.floats(-1e4, 1e4), min_size=2, max_size=2),
                min_size=count,
                max_size=count,
            )
        )
    )
    walks = []
    for i in range(draw(st.integers(1, 3))):
        k = draw(st.integers(0, 15))
        start = draw(st.sampled_from([0.0, 3.25, 1.4e9]))
        steps = draw(
            st.lists(
                st.sampled_from([0.001, 0.01, 0.5, 1.0, 1.7, 30.0, 1e5]),
                min_size=k + 1,
                max_size=k + 1,
            )
        )
        visits = draw(st.lists(st.integers(0, count - 1), min_size=k + 1, max_size=k + 1))
        gaps = np.array(draw(st.lists(st.booleans(), min_size=k, max_size=k)), bool)
        walks.append(Walk(str(i), np.array(visits, np.int32), start + np.cumsum(steps), gaps))
    return nodes, walks


def in_metres(grid_walks, grid):
    return node_positions(grid_walks, grid), dequantise_walks(
        grid_walks, grid, [str(i) for i in range(len(grid_walks.walks))]
    )


def assert_same(first, second):
    np.testing.assert_array_equal(first.nodes, second.nodes)
    assert first.timed == second.timed
    for a, b in zip(first.walks, second.walks, strict=True):
        np.testing.assert_array_equal(a.nodes, b.nodes)
        np.testing.assert_array_equal(a.time_steps, b.time_steps)
        np.testing.assert_array_equal(a.gaps, b.gaps)


@given(grid_walks_of_archives(), st.integers(60, 160), st.sampled_from([0, 1_400_000_000_123]))
def test_grid_walks_survive_a_round_trip(grid_walks, time, epoch):
    largest = max(int(walk.time_steps.max()) for walk in grid_walks.walks)
    if largest * step_size(time) > 1e9:  # float64 seconds are too coarse for such steps
        time = 60
        grid_walks = GridWalks(
            grid_walks.nodes,
            tuple(
                GridWalk(w.nodes, w.time_steps % 1 + np.arange(len(w.time_steps)), w.gaps)
                for w in grid_walks.walks
            ),
        )
    grid = QuantisationGrid((12,) * grid_walks.nodes.shape[1], epoch, 100, time)
    assert_same(quantise_walks(*in_metres(grid_walks, grid), grid), grid_walks)


@given(grid_walks_of_archives(timed=False))
def test_grid_walks_without_times_survive_a_round_trip(grid_walks):
    grid = QuantisationGrid((0,) * grid_walks.nodes.shape[1], 0, 128, 128)
    nodes, walks = in_metres(grid_walks, grid)
    assert all(walk.times is None for walk in walks)
    assert_same(quantise_walks(nodes, walks, grid), grid_walks)


@given(timed_walks(), st.integers(90, 150))
def test_knots_stay_in_their_piece_and_near_their_position(log, time):
    nodes, walks = log
    grid = choose_grid(nodes, walks, space=120, time=time)
    grid_walks = quantise_walks(nodes, walks, grid)
    assert (grid_walks.nodes >= 0).all()
    rounded = node_positions(grid_walks, grid)
    for walk, out in zip(walks, grid_walks.walks, strict=True):
        assert (np.diff(out.time_steps) > 0).all()
        assert (out.time_steps >= 0).all()
        assert len(out.gaps) == len(out.nodes) - 1
        kept = np.repeat(walk.nodes, copies_of(walk, grid))
        assert np.abs(rounded[out.nodes] - nodes[kept]).max() <= step_size(120) / 2 + 1e-9
        first, last = mark_piece_ends(out.gaps)
        starts, ends = (
            knot_times(out.time_steps[first], grid),
            knot_times(out.time_steps[last], grid),
        )
        for a, b in pieces_of(walk):
            assert any(s - 1e-3 <= a and b <= e + 1e-3 for s, e in zip(starts, ends, strict=True))


def copies_of(walk, grid):
    """How often each knot is written: twice for a single knot between two time steps."""
    first, last = mark_piece_ends(walk.gaps)
    exact = (walk.times - grid.epoch / 1000) / step_size(grid.time)
    off = np.abs(exact - np.rint(exact)) * step_size(grid.time) > 5e-4
    return 1 + (first & last & off)


def pieces_of(walk):
    starts = np.flatnonzero(walk.gaps) + 1
    return [(piece[0], piece[-1]) for piece in np.split(walk.times, starts)]


@pytest.mark.parametrize("times", [[0.0, 0.4, 5.3], [1.4e9, 1.4e9 + 0.7, 1.4e9 + 1000.1]])
def test_inner_knots_round_to_the_nearest_step_and_ends_outwards(times):
    walk = Walk("a", np.array([0, 1, 0], np.int32), np.array(times), np.zeros(2, bool))
    grid = QuantisationGrid((0,), int(times[0]) * 1000 - 500, 128, 128)
    time_steps = quantise_walks(np.array([[0.0], [1.0]]), [walk], grid).walks[0].time_steps
    exact = np.array(times) - (int(times[0]) - 0.5)
    assert time_steps.tolist() == [np.floor(exact[0]), np.rint(exact[1]), np.ceil(exact[2])]


def test_a_gap_shorter_than_a_time_step_is_dropped():
    walk = Walk(
        "a",
        np.zeros(4, np.int32),
        np.array([0.0, 10.2, 10.4, 20.0]),
        np.array([False, True, False]),
    )
    fine, coarse = (
        quantise_walks(np.zeros((1, 1)), [walk], QuantisationGrid((0,), 0, 128, time)).walks[0]
        for time in (64, 128)
    )
    assert fine.gaps.tolist() == [False, True, False]
    assert coarse.gaps.tolist() == [False, False, False]
    assert coarse.time_steps.tolist() == [0, 11, 12, 20]


def test_a_single_knot_between_time_steps_becomes_a_stop():
    walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 10.5]), np.array([True]))
    out = quantise_walks(
        np.array([[0.0], [1.0]]), [walk], QuantisationGrid((0,), 0, 128, 128)
    ).walks[0]
    assert (out.nodes.tolist(), out.time_steps.tolist(), out.gaps.tolist()) == (
        [0, 1, 1],
        [0, 10, 11],
        [True, False],
    )


@pytest.mark.parametrize("off", [-4e-4, 4e-4])
def test_a_single_knot_close_to_a_time_step_is_on_it(off):
    walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 10 + off]), np.array([True]))
    out = quantise_walks(
        np.array([[0.0], [1.0]]), [walk], QuantisationGrid((0,), 0, 128, 128)
    ).walks[0]
    assert (out.nodes.tolist(), out.time_steps.tolist(), out.gaps.tolist()) == (
        [0, 1],
        [0, 10],
        [True],
    )


def test_the_grid_starts_at_the_lowest_corner_and_the_first_knot():
    walks = [
        Walk(str(t), np.array([0], np.int32), np.array([t]), np.zeros(0, bool))
        for t in (5.0004, 2.0009)
    ]
    plane = Plane(((1, 2),))
    grid = choose_grid(np.array([[1.5, -2.0004], [0.25, 9.0]]), walks, space=3, time=4, plane=plane)
    assert grid == QuantisationGrid((250, -2001), 2000, 3, 4, plane)


def test_road_map_counts_both_directions_and_no_gaps():
    walk = GridWalk(
        np.array([0, 1, 0, 0, 2], np.int32), np.arange(5), np.array([False, False, False, True])
    )
    road_map = dequantise_road_map(
        GridWalks(np.array([[0], [3], [4]]), (walk,)), QuantisationGrid((1000,), 0, 136, 128)
    )
    assert road_map.nodes.tolist() == [[1.0], [7.0], [9.0]]
    travelled = {
        tuple(e): (f, b)
        for e, f, b in zip(
            road_map.edges.tolist(), road_map.forward, road_map.backward, strict=True
        )
    }
    assert travelled[0, 1] == (1, 1)
    assert (0, 2) not in travelled
