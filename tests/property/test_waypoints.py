from hypothesis import given

from gpszip.codec.waypoints import expand_waypoints, find_waypoints, find_waypoints_by_bisection
from oracle.paths import fewest_waypoints, maps_with_walks
from random_tests import examples


@given(maps_with_walks())
@examples(150)
def test_walks_round_trip(case):
    graph, route = case
    for compress in (find_waypoints, find_waypoints_by_bisection):
        for breadth in (None, 1, 3):
            back = expand_waypoints(
                graph, compress(graph, route, breadth=breadth), len(route.edges), breadth=breadth
            )
            assert back.nodes.tolist() == route.nodes.tolist()
            assert back.edges.tolist() == route.edges.tolist()


@given(maps_with_walks())
@examples(120)
def test_greedy_waypoints_are_as_few_as_any(case):
    graph, route = case
    assert len(find_waypoints(graph, route)) == fewest_waypoints(graph, route)


@given(maps_with_walks(max_segments=60))
@examples(120)
def test_bisection_never_beats_greedy(case):
    graph, route = case
    assert (
        len(find_waypoints(graph, route))
        <= len(find_waypoints_by_bisection(graph, route))
        <= len(route.nodes)
    )
