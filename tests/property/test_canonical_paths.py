import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.graph.road_graph import UNITS_PER_METRE
from gpszip.graph.trees import build_tree, find_distances, new_search_on
from oracle.paths import all_simple_paths, canonical_paths, random_maps


@given(random_maps())
@settings(max_examples=200, deadline=None)
def test_trees_hold_the_canonical_path_to_each_node(graph):
    for source in range(len(graph)):
        tree, plain = build_tree(graph, source), canonical_paths(graph, source)
        assert tree.nodes.tolist() == sorted(plain)
        for node, (length, nodes, edges) in plain.items():
            route = tree.route(node)
            assert route is not None
            assert tree.distance(node) == length / UNITS_PER_METRE
            assert (tuple(route.nodes.tolist()), tuple(route.edges.tolist())) == (nodes, edges)


@given(random_maps(most=6))
@settings(max_examples=100, deadline=None)
def test_canonical_is_the_first_of_the_shortest_in_lexicographic_order(graph):
    tree = build_tree(graph, 0)
    for node in range(len(graph)):
        candidates = [path for path in all_simple_paths(graph, 0) if path[3][-1] == node]
        route = tree.route(node)
        assert (route is None) == (not candidates)
        if route is not None:
            assert tuple(route.edges.tolist()) == min(candidates)[2]


@given(random_maps())
@settings(max_examples=200, deadline=None)
def test_every_part_of_a_canonical_path_is_canonical(graph):
    trees = [build_tree(graph, source) for source in range(len(graph))]
    for tree in trees:
        for target in tree.nodes:
            path = tree.route(target)
            for first in range(len(path.nodes)):
                part = trees[path.nodes[first]].route(target)
                assert part.nodes.tolist() == path.nodes[first:].tolist()
                assert part.edges.tolist() == path.edges[first:].tolist()


@given(random_maps())
@settings(max_examples=100, deadline=None)
def test_a_radius_cuts_the_tree_and_nothing_else(graph):
    for radius in (0.0, 1.0, 2.5):
        whole, cut = build_tree(graph, 0), build_tree(graph, 0, radius=radius)
        near = whole.distances <= radius
        assert cut.nodes.tolist() == whole.nodes[near].tolist()
        assert cut.parents.tolist() == whole.parents[near].tolist()
        everyone = np.arange(len(graph))
        expected = [
            distance if distance <= radius else np.inf for distance in map(whole.distance, everyone)
        ]
        assert find_distances(graph, 0, everyone, radius=radius).tolist() == expected


@given(random_maps(), st.integers(1, 6))
@settings(max_examples=200, deadline=None)
def test_a_breadth_takes_the_nearest_nodes_and_those_as_far_as_the_last(graph, breadth):
    whole, cut = build_tree(graph, 0), build_tree(graph, 0, search=new_search_on(graph, breadth))
    last = np.sort(whole.distances)[min(breadth, len(whole.distances)) - 1]
    assert cut.nodes.tolist() == whole.nodes[whole.distances <= last].tolist()
