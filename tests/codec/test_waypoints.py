import numpy as np
import pytest

from gpszip.codec.waypoints import Hop, Waypoints, bisect, expand, shorten
from gpszip.errors import CorruptArchiveError
from gpszip.graph.road_graph import road_graph
from gpszip.graph.route import JUMP, STAY, Route, route_along
from gpszip.graph.trees import shortest_tree
from oracle.paths import fewest_waypoints, random_walk


def town(seed, jitter=0.2, side=7):
    """A grid of streets with some missing, and a fast road across."""
    rng = np.random.default_rng(seed)
    names = np.arange(side * side).reshape(side, side)
    edges = np.concatenate(
        (np.stack((names[:, :-1].ravel(), names[:, 1:].ravel()), 1), np.stack((names[:-1].ravel(), names[1:].ravel()), 1), [[0, 48]])
    )
    return road_graph(np.argwhere(names >= 0) + rng.normal(0, jitter, (side * side, 2)), edges[rng.random(len(edges)) < 0.85])


def tour(graph, rng, stops):
    nodes = [int(rng.integers(len(graph)))]
    for stop in rng.integers(0, len(graph), stops).tolist():
        path = shortest_tree(graph, nodes[-1]).route(stop)
        nodes += path.nodes[1:].tolist() if path is not None else []
    return route_along(graph, nodes)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_greedy_meets_the_optimum_on_tours_and_wanderings(seed, jitter):
    graph, rng = town(seed, jitter), np.random.default_rng(seed)
    for route in (tour(graph, rng, 12), random_walk(graph, rng.integers(0, 9999, 120).tolist())):
        few = shorten(graph, route)
        assert len(few) == fewest_waypoints(graph, route) <= len(bisect(graph, route))
        back = expand(graph, few, len(route.edges))
        assert (back.nodes.tolist(), back.edges.tolist()) == (route.nodes.tolist(), route.edges.tolist())


def test_a_tour_takes_no_more_waypoints_than_places():
    graph = town(3)
    route = tour(graph, np.random.default_rng(1), 10)
    assert len(shorten(graph, route)) <= 11 < len(route.nodes)


def test_hops_that_no_path_stands_for_are_spelled_out():
    graph = road_graph([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2], [0, 1], [1, 1], [0, 2]], lengths=[2, 1, 1, 5, 9])
    nodes = np.array([0, 1, 1, 1, 0, 2, 0, 1, 2], np.int32)
    route = Route(nodes, np.array([0, 3, STAY, 2, 4, JUMP, 2, 1], np.int32))
    few = shorten(graph, route)
    assert few.nodes.tolist() == [0, 1, 1, 1, 0, 2, 0, 2]
    assert few.hops.tolist() == [Hop.EDGE, Hop.EDGE, Hop.STAY, Hop.PATH, Hop.EDGE, Hop.JUMP, Hop.PATH]
    assert few.choices.tolist() == [0, 0, 0, 0, 0, 0, 0]
    assert expand(graph, few, 8).edges.tolist() == route.edges.tolist()


def test_parallel_edges_are_told_apart_by_their_place_among_them():
    graph = road_graph([[0, 0], [1, 0]], [[0, 1], [1, 0], [0, 1]], lengths=[5, 1, 7])
    route = Route(np.array([0, 1, 0, 1], np.int32), np.array([2, 0, 1], np.int32))
    few = shorten(graph, route)
    assert (few.hops.tolist(), few.choices.tolist()) == ([Hop.EDGE, Hop.EDGE, Hop.PATH], [2, 0, 0])
    assert expand(graph, few, 3).edges.tolist() == [2, 0, 1]


def test_bisection_keeps_the_middle_node_of_both_halves():
    graph = road_graph([[0, 0], [1, 0], [2, 0], [3, 0], [4, 0]], [[0, 1], [1, 2], [2, 3], [3, 4]])
    assert bisect(graph, route_along(graph, [0, 1, 2, 3, 4])).nodes.tolist() == [0, 4]
    assert bisect(graph, route_along(graph, [0, 1, 2, 3, 2, 1, 0])).nodes.tolist() == [0, 3, 0]
    assert bisect(graph, route_along(graph, [0, 1, 2, 1, 0, 1])).nodes.tolist() == [0, 2, 1, 0, 1]
    assert bisect(graph, route_along(graph, [0, 1, 2, 1])).nodes.tolist() == [0, 1, 2, 1]


@pytest.mark.parametrize("compress", [shorten, bisect])
def test_walks_of_one_node_and_of_none(compress):
    graph = road_graph([[0, 0], [1, 0]], [[0, 1]])
    one = compress(graph, route_along(graph, [1]))
    assert (one.nodes.tolist(), len(one.hops)) == ([1], 0)
    assert expand(graph, one, 0).nodes.tolist() == [1]
    none = compress(graph, route_along(graph, []))
    assert len(none) == len(expand(graph, none, 0).nodes) == 0


def test_a_breadth_bounds_the_search_for_each_path():
    graph = town(5, jitter=0.0)
    route = tour(graph, np.random.default_rng(2), 10)
    narrow = shorten(graph, route, breadth=12)
    assert len(shorten(graph, route)) < len(narrow)
    assert expand(graph, narrow, len(route.edges), breadth=12).nodes.tolist() == route.nodes.tolist()
    with pytest.raises(CorruptArchiveError, match="no path leads to waypoint"):
        expand(graph, shorten(graph, route), len(route.edges), breadth=12)


def test_a_route_that_is_none_is_refused():
    graph = road_graph([[0, 0], [1, 0], [2, 0]], [[0, 1], [1, 2]])
    with pytest.raises(ValueError, match="hop 1 of the route"):
        shorten(graph, Route(np.array([0, 1, 2], np.int32), np.array([0, 0], np.int32)))


@pytest.mark.parametrize(
    ("nodes", "hops", "choices", "limit", "message"),
    [
        ([0, 3], [Hop.PATH], [0], 9, "no path leads to waypoint 1"),
        ([0, 1, 1], [Hop.PATH, Hop.PATH], [0, 0], 9, "no path leads to waypoint 2"),
        ([0, 2], [Hop.PATH], [0], 1, "more than the 1 hops"),
        ([0, 0, 0], [Hop.STAY, Hop.STAY], [0, 0], 1, "more than the 1 hops"),
        ([0, 1], [Hop.EDGE], [1], 9, "not on the map"),
        ([0, 1], [Hop.EDGE], [-1], 9, "not on the map"),
        ([0, 2], [Hop.EDGE], [0], 9, "not on the map"),
        ([0, 1], [Hop.STAY], [0], 9, "stays moves"),
        ([0, 4], [Hop.JUMP], [0], 9, "none of the 4 nodes"),
        ([-1, 1], [Hop.JUMP], [0], 9, "none of the 4 nodes"),
        ([0, 1], [4], [0], 9, "no hop is of kind 4"),
        ([0, 1], [], [], 9, "2 waypoints can't have 0 hops"),
        ([0, 1], [0], [], 9, "0 choices"),
    ],
)
def test_forged_waypoints_are_refused(nodes, hops, choices, limit, message):
    graph = road_graph([[0, 0], [1, 0], [2, 0], [9, 9]], [[0, 1], [1, 2]])
    forged = Waypoints(np.array(nodes, np.int32), np.array(hops, np.uint8), np.array(choices, np.int32))
    with pytest.raises(CorruptArchiveError, match=message):
        expand(graph, forged, limit)
