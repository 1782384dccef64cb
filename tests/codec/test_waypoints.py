import numpy as np
import pytest

from gpszip.codec.waypoints import (
    Connection,
    Waypoints,
    expand_waypoints,
    find_waypoints,
    find_waypoints_by_bisection,
)
from gpszip.errors import CorruptArchiveError
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.route import GAP, STOP, Route, build_route
from gpszip.graph.trees import build_tree
from oracle.paths import fewest_waypoints, random_walk


def town(seed, jitter=0.2, side=7):
    """A grid of streets with some missing, and a fast road across."""
    rng = np.random.default_rng(seed)
    names = np.arange(side * side).reshape(side, side)
    edges = np.concatenate(
        (
            np.stack((names[:, :-1].ravel(), names[:, 1:].ravel()), 1),
            np.stack((names[:-1].ravel(), names[1:].ravel()), 1),
            [[0, 48]],
        )
    )
    return build_road_graph(
        np.argwhere(names >= 0) + rng.normal(0, jitter, (side * side, 2)),
        edges[rng.random(len(edges)) < 0.85],
    )


def tour(graph, rng, stops):
    nodes = [int(rng.integers(len(graph)))]
    for stop in rng.integers(0, len(graph), stops).tolist():
        path = build_tree(graph, nodes[-1]).route(stop)
        nodes += path.nodes[1:].tolist() if path is not None else []
    return build_route(graph, nodes)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_greedy_waypoints_are_optimal_on_tours_and_random_walks(seed, jitter):
    graph, rng = town(seed, jitter), np.random.default_rng(seed)
    for route in (tour(graph, rng, 12), random_walk(graph, rng.integers(0, 9999, 120).tolist())):
        few = find_waypoints(graph, route)
        assert (
            len(few)
            == fewest_waypoints(graph, route)
            <= len(find_waypoints_by_bisection(graph, route))
        )
        back = expand_waypoints(graph, few, len(route.edges))
        assert (back.nodes.tolist(), back.edges.tolist()) == (
            route.nodes.tolist(),
            route.edges.tolist(),
        )


def test_a_tour_takes_no_more_waypoints_than_stops():
    graph = town(3)
    route = tour(graph, np.random.default_rng(1), 10)
    assert len(find_waypoints(graph, route)) <= 11 < len(route.nodes)


def test_steps_on_no_shortest_path_have_connections_of_their_own():
    graph = build_road_graph(
        [[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2], [0, 1], [1, 1], [0, 2]], lengths=[2, 1, 1, 5, 9]
    )
    nodes = np.array([0, 1, 1, 1, 0, 2, 0, 1, 2], np.int32)
    route = Route(nodes, np.array([0, 3, STOP, 2, 4, GAP, 2, 1], np.int32))
    few = find_waypoints(graph, route)
    assert few.nodes.tolist() == [0, 1, 1, 1, 0, 2, 0, 2]
    assert few.connections.tolist() == [
        Connection.EDGE,
        Connection.EDGE,
        Connection.STOP,
        Connection.PATH,
        Connection.EDGE,
        Connection.GAP,
        Connection.PATH,
    ]
    assert few.parallel_indices.tolist() == [0, 0, 0, 0, 0, 0, 0]
    assert expand_waypoints(graph, few, 8).edges.tolist() == route.edges.tolist()


def test_parallel_edges_are_numbered():
    graph = build_road_graph([[0, 0], [1, 0]], [[0, 1], [1, 0], [0, 1]], lengths=[5, 1, 7])
    route = Route(np.array([0, 1, 0, 1], np.int32), np.array([2, 0, 1], np.int32))
    few = find_waypoints(graph, route)
    assert (few.connections.tolist(), few.parallel_indices.tolist()) == (
        [Connection.EDGE, Connection.EDGE, Connection.PATH],
        [2, 0, 0],
    )
    assert expand_waypoints(graph, few, 3).edges.tolist() == [2, 0, 1]


def test_bisection_keeps_the_middle_node_of_both_halves():
    graph = build_road_graph(
        [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0]], [[0, 1], [1, 2], [2, 3], [3, 4]]
    )
    assert find_waypoints_by_bisection(
        graph, build_route(graph, [0, 1, 2, 3, 4])
    ).nodes.tolist() == [0, 4]
    assert find_waypoints_by_bisection(
        graph, build_route(graph, [0, 1, 2, 3, 2, 1, 0])
    ).nodes.tolist() == [0, 3, 0]
    assert find_waypoints_by_bisection(
        graph, build_route(graph, [0, 1, 2, 1, 0, 1])
    ).nodes.tolist() == [0, 2, 1, 0, 1]
    assert find_waypoints_by_bisection(graph, build_route(graph, [0, 1, 2, 1])).nodes.tolist() == [
        0,
        1,
        2,
        1,
    ]


@pytest.mark.parametrize("compress", [find_waypoints, find_waypoints_by_bisection])
def test_walks_of_one_node_and_of_none(compress):
    graph = build_road_graph([[0, 0], [1, 0]], [[0, 1]])
    one = compress(graph, build_route(graph, [1]))
    assert (one.nodes.tolist(), len(one.connections)) == ([1], 0)
    assert expand_waypoints(graph, one, 0).nodes.tolist() == [1]
    none = compress(graph, build_route(graph, []))
    assert len(none) == len(expand_waypoints(graph, none, 0).nodes) == 0


def test_breadth_bounds_the_search_for_each_path():
    graph = town(5, jitter=0.0)
    route = tour(graph, np.random.default_rng(2), 10)
    narrow = find_waypoints(graph, route, breadth=12)
    assert len(find_waypoints(graph, route)) < len(narrow)
    assert (
        expand_waypoints(graph, narrow, len(route.edges), breadth=12).nodes.tolist()
        == route.nodes.tolist()
    )
    with pytest.raises(CorruptArchiveError, match="no path leads to waypoint"):
        expand_waypoints(graph, find_waypoints(graph, route), len(route.edges), breadth=12)


def test_a_route_on_wrong_edges_is_refused():
    graph = build_road_graph([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]])
    with pytest.raises(ValueError, match="segment 1 of the route"):
        find_waypoints(graph, Route(np.array([0, 1, 2], np.int32), np.array([0, 0], np.int32)))


@pytest.mark.parametrize(
    ("nodes", "connections", "parallel_indices", "limit", "message"),
    [
        ([0, 3], [Connection.PATH], [0], 9, "no path leads to waypoint 1"),
        ([0, 1, 1], [Connection.PATH, Connection.PATH], [0, 0], 9, "no path leads to waypoint 2"),
        ([0, 2], [Connection.PATH], [0], 1, "more than the 1 steps"),
        ([0, 0, 0], [Connection.STOP, Connection.STOP], [0, 0], 1, "more than the 1 steps"),
        ([0, 1], [Connection.EDGE], [1], 9, "not on the map"),
        ([0, 1], [Connection.EDGE], [-1], 9, "not on the map"),
        ([0, 2], [Connection.EDGE], [0], 9, "not on the map"),
        ([0, 1], [Connection.STOP], [0], 9, "stays moves"),
        ([0, 4], [Connection.GAP], [0], 9, "none of the 4 nodes"),
        ([-1, 1], [Connection.GAP], [0], 9, "none of the 4 nodes"),
        ([0, 1], [4], [0], 9, "no connection is of kind 4"),
        ([0, 1], [], [], 9, "2 waypoints can't have 0 connections"),
        ([0, 1], [0], [], 9, "0 parallel indices"),
    ],
)
def test_forged_waypoints_are_refused(nodes, connections, parallel_indices, limit, message):
    graph = build_road_graph([[0, 0], [1, 0], [2, 0], [9, 9]], [[0, 1], [1, 2]])
    forged = Waypoints(
        np.array(nodes, np.int32),
        np.array(connections, np.uint8),
        np.array(parallel_indices, np.int32),
    )
    with pytest.raises(CorruptArchiveError, match=message):
        expand_waypoints(graph, forged, limit)
