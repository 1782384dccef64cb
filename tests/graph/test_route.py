import numpy as np
import pytest

from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.route import GAP, STOP, Route, build_route, find_arcs, find_route_arcs

GRAPH = build_road_graph(
    [[0, 0], [1, 0], [2, 0], [9, 9]],
    [[1, 0], [1, 2], [0, 1], [2, 2], [1, 0]],
    lengths=[3, 1, 2, 1, 2],
    oneway=[0, 0, 0, 0, 1],
)


def test_route_by_nodes_takes_the_shortest_parallel_edge_then_the_first():
    assert build_route(GRAPH, [0, 1, 0, 1, 2]).edges.tolist() == [2, 2, 2, 1]


def test_repeated_node_is_a_stop_unless_it_is_a_gap():
    route = build_route(GRAPH, [2, 2, 3, 3], [False, True, True])
    assert route.edges.tolist() == [STOP, GAP, GAP]
    assert route.gaps.tolist() == [False, True, True]


def test_walk_of_one_node_has_no_edges():
    assert len(build_route(GRAPH, [1]).edges) == 0


def test_nodes_without_an_edge_are_refused():
    with pytest.raises(ValueError, match="from node 2 to node 0"):
        build_route(GRAPH, [0, 1, 2, 0])


def test_parallel_arcs_are_consecutive():
    first, count = find_arcs(GRAPH, [1, 0, 2, 0, 3], [0, 1, 2, 2, 3])
    assert count.tolist() == [3, 2, 1, 0, 0]
    assert [GRAPH.edges[f : f + c].tolist() for f, c in zip(first, count, strict=True)] == [
        [0, 2, 4],
        [0, 2],
        [3],
        [],
        [],
    ]


def test_arcs_of_a_route_have_its_sources_targets_and_edges():
    route = Route(
        np.array([0, 1, 0, 0, 1, 2, 2, 3], np.int32), np.array([0, 4, STOP, 2, 1, 3, GAP], np.int32)
    )
    arcs = find_route_arcs(GRAPH, route)
    moving = route.edges >= 0
    assert arcs[~moving].tolist() == [-1, -1]
    assert GRAPH.edges[arcs[moving]].tolist() == route.edges[moving].tolist()
    assert GRAPH.targets[arcs[moving]].tolist() == route.nodes[1:][moving].tolist()
    sources = np.searchsorted(GRAPH.offsets, arcs[moving], side="right") - 1
    assert sources.tolist() == route.nodes[:-1][moving].tolist()


@pytest.mark.parametrize(
    ("nodes", "edges"),
    [
        ([0, 1], [4]),  # against a one-way edge
        ([0, 1], [1]),  # an edge elsewhere
        ([2, 0], [0]),  # arrives, but leaves from another node
        ([0, 2], [0]),  # leaves, but arrives at another node
        ([0, 1], [STOP]),
    ],
)
def test_edge_that_leads_elsewhere_is_refused(nodes, edges):
    with pytest.raises(ValueError, match="segment 0 of the route"):
        find_route_arcs(GRAPH, Route(np.array(nodes, np.int32), np.array(edges, np.int32)))
