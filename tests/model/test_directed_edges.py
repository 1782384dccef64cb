import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import CleanMap, RoadMap
from gpszip.walks.counting import build_road_map_from_counts

COUNTS = st.dictionaries(
    st.tuples(st.integers(0, 5), st.integers(0, 5)).filter(lambda pair: pair[0] != pair[1]),
    st.integers(1, 1000),
    min_size=1,
)


@given(COUNTS)
def test_the_directed_graph_is_the_one_that_was_counted(counts):
    pairs = np.array(list(counts), np.int32)
    traversals = np.array(list(counts.values()), np.int64)
    road_map = build_road_map_from_counts(np.zeros((6, 2)), pairs, traversals)
    directed = road_map.directed()
    assert {(start, end): count for start, end, count in directed} == counts
    assert len(directed) == len(counts)
    for start, end, edge, forward in zip(
        directed.starts, directed.ends, directed.edges, directed.forward, strict=True
    ):
        along = road_map.edges[edge] if forward else road_map.edges[edge][::-1]
        assert (start, end) == tuple(along)


def test_directions_that_nobody_travelled_are_left_out():
    nodes = np.array([[0.0, 0.0], [9.0, 0.0]])
    road_map = RoadMap(nodes, np.array([[0, 1]], np.int32), np.array([0]), np.array([2]))
    assert list(road_map.directed()) == [(1, 0, 2)]


def test_clean_maps_keep_the_order_of_their_junctions():
    nan = np.full((1, 3), np.nan)
    clean = CleanMap(
        junctions=np.array([[9.0, 0.0], [0.0, 0.0]]),
        ends=np.array([[1, 0]], np.int32),
        offsets=np.array([0, 2]),
        points=np.array([[0.0, 0.0], [9.0, 0.0]]),
        length=np.array([9.0]),
        forward=np.array([4]),
        backward=np.array([1]),
        speed=nan,
        hourly=nan[:, :0],
        width=nan[:, 0],
    )
    assert list(clean.directed()) == [(1, 0, 4), (0, 1, 1)]
    assert repr(clean) == "CleanMap(2 junctions, 1 edge, 9 m, x, y)"
