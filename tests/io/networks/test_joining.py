import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.networks.joining import build_road_graph
from gpszip.io.networks.lines import RoadLines
from oracle import roads as oracle


def lines_of(
    shapes, forward=None, backward=None, speeds=None, geographic=False, directed=False, names=None
):
    points = [point for shape in shapes for point in shape]
    count = len(shapes)
    return RoadLines(
        "roads",
        np.array(points, float).reshape(-1, 2),
        np.append(0, np.cumsum([len(shape) for shape in shapes])).astype(np.int64),
        geographic,
        np.ones(count, bool) if forward is None else np.array(forward),
        np.ones(count, bool) if backward is None else np.array(backward),
        np.full(count, np.nan) if speeds is None else np.array(speeds, float),
        np.zeros(count, np.uint8),
        pa.array([str(i) for i in range(count)], pa.string()),
        pa.array([None] * count if names is None else names, pa.string()),
        directed,
    )


def as_shapes(roads, step=1e-3):
    answer = {}
    for i in range(len(roads)):
        shape = tuple(
            map(
                tuple,
                np.rint(roads.coordinates[roads.offsets[i] : roads.offsets[i + 1]] / step)
                .astype(int)
                .tolist(),
            )
        )
        forward, backward = bool(roads.forward[i]), bool(roads.backward[i])
        if shape[::-1] < shape:
            shape, forward, backward = shape[::-1], backward, forward
        assert shape not in answer or shape == shape[::-1]
        answer[shape] = (forward, backward)
    return answer


def counted(roads):
    return {repair.what: repair.count for repair in roads.repairs}


positions = st.tuples(st.integers(0, 4), st.integers(0, 4))
shapes = st.lists(
    st.tuples(
        st.lists(positions, min_size=1, max_size=6),
        st.sampled_from([(True, True), (True, False), (False, True)]),
    ),
    min_size=1,
    max_size=8,
)


@given(shapes)
def test_the_graph_is_that_of_the_oracle(case):
    lines = [(line, *directions) for line, directions in case]
    expected = oracle.build_road_graph(lines, 1.0)
    given_lines = lines_of(
        [line for line, _ in case],
        [directions[0] for _, directions in case],
        [directions[1] for _, directions in case],
    )
    if not expected:
        with pytest.raises(InputError, match="no road"):
            build_road_graph(given_lines)
        return
    found = as_shapes(build_road_graph(given_lines), 1.0)
    palindromes = {shape for shape in expected if shape == shape[::-1]}
    assert {s: w for s, w in found.items() if s not in palindromes} == {
        s: w for s, w in expected.items() if s not in palindromes
    }


def test_ends_of_roads_are_their_nodes():
    roads = build_road_graph(
        lines_of([[(0, 0), (5, 5), (10, 0)], [(10, 0), (20, 0)], [(5, 5), (5, 20)]])
    )
    np.testing.assert_array_equal(roads.nodes[roads.starts], roads.coordinates[roads.offsets[:-1]])
    np.testing.assert_array_equal(roads.nodes[roads.ends], roads.coordinates[roads.offsets[1:] - 1])
    assert len(roads) == 4
    assert len(roads.nodes) == 5
    assert roads.ids.to_pylist() == ["0", "0", "1", "2"]
    assert counted(roads) == {"roads split where others meet them": 1}


def test_crossing_without_a_shared_vertex_is_a_bridge():
    roads = build_road_graph(lines_of([[(0, 0), (10, 0)], [(5, -5), (5, 5)]]))
    assert len(roads) == 2
    assert len(roads.nodes) == 4


def test_two_lines_that_share_an_inner_vertex_cross_there():
    assert (
        len(build_road_graph(lines_of([[(0, 0), (5, 0), (10, 0)], [(5, -5), (5, 0), (5, 5)]]))) == 4
    )


def test_overlapping_extracts_are_one_network():
    street = [(0.0, 0.0), (3.0, 1.0), (7.0, 1.0), (9.0, 0.0)]
    roads = build_road_graph(
        lines_of(
            [street, street[1:], street[::-1], [(x + 1e-5, y) for x, y in street]],
            speeds=[np.nan, 5, 8, 6],
        )
    )
    assert as_shapes(roads, 1.0).keys() == {((0, 0), (3, 1)), ((3, 1), (7, 1)), ((7, 1), (9, 0))}
    assert counted(roads)["roads merged with another one of the same shape"] == 2
    assert roads.speeds.max() == 8


def test_lines_without_a_twin_are_one_way_if_most_have_one():
    streets = [[(i, 0), (i, 1)] for i in range(0, 60, 2)]
    twins = [street[::-1] for street in streets[:20]]
    roads = build_road_graph(lines_of(streets + twins, directed=None))
    assert len(roads) == 30
    assert roads.forward.all()
    assert roads.backward.sum() == 20
    assert next(count for what, count in counted(roads).items() if "one-way" in what) == 10


def test_a_few_twins_make_no_road_one_way():
    streets = [[(i, 0), (i, 1)] for i in range(0, 60, 2)]
    roads = build_road_graph(
        lines_of(streets + [street[::-1] for street in streets[:5]], directed=None)
    )
    assert roads.backward.all()


def test_roads_without_a_length_and_without_numbers_are_dropped_and_counted():
    roads = build_road_graph(
        lines_of([[(0, 0), (0, 0)], [(1, 1)], [(0, 0), (0, 0), (5, 0)], [(np.nan, 0), (1, 0)]])
    )
    assert len(roads) == 1
    assert len(roads.coordinates) == 2
    assert counted(roads) == {
        "roads with a vertex that is no position dropped": 1,
        "roads without a length dropped": 2,
    }


def test_metres_stated_as_degrees_are_refused():
    with pytest.raises(InputError, match="these are no degrees"):
        build_road_graph(lines_of([[(500000, 4000000), (500010, 4000000)]], geographic=True))


def test_roads_far_apart_keep_their_positions():
    roads = build_road_graph(lines_of([[(0, 0), (1, 0)], [(4e8, 4e8), (4e8 + 1, 4e8)]]))
    assert len(roads.nodes) == 4


def test_street_names_stay_with_their_roads():
    shapes = [
        [(0, 0), (5, 0), (9, 0)],
        [(5, 0), (5, 9)],
        [(9, 0), (5, 0), (0, 0)],
        [(9, 0), (9, 9)],
    ]
    roads = build_road_graph(lines_of(shapes, names=[None, "Side St", "Main St", None]))
    shapes = np.split(roads.coordinates.astype(int), roads.offsets[1:-1])
    named = {
        tuple(map(tuple, shape.tolist())): name
        for shape, name in zip(shapes, roads.names.to_pylist(), strict=True)
    }
    assert named == {
        ((0, 0), (5, 0)): "Main St",
        ((5, 0), (9, 0)): "Main St",
        ((5, 0), (5, 9)): "Side St",
        ((9, 0), (9, 9)): None,
    }
