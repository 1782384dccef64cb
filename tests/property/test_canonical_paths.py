import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.graph.road_graph import UNITS_PER_METRE
from gpszip.graph.trees import build_tree, find_distances, new_search_on
from oracle.paths import all_simple_paths, canonical_paths, random_maps
from random_tests import examples


@given(random_maps())
@examples(200)
def test_trees_contain_the_canonical_path_to_each_node(graph):
    for source in range(len(graph)):
        tree, plain = build_tree(graph, source), canonical_paths(graph, source)
        assert tree.nodes.tolist() == sorted(plain)
        for node, (length, nodes, edges) in plain.items():
            route = tree.route(node)
            assert route is not None
            assert tree.distance(node) == length / UNITS_PER_METRE
            assert (tuple(route.nodes.tolist()), tuple(route.edges.tolist())) == (nodes, edges)


@given(random_maps(max_nodes=6))
@examples(100)
def test_canonical_path_is_the_lexicographically_first_of_the_shortest(graph):
    tree = build_tree(graph, 0)
    for node in range(len(graph)):
        candidates = [path for path in all_simple_paths(graph, 0) if path[3][-1] == node]
        route = tree.route(node)
        assert (route is None) == (not candidates)
        if route is not None:
            assert tuple(route.edges.tolist()) == min(candidates)[2]


@given(random_maps())
@examples(200)
def test_subpaths_of_canonical_paths_are_canonical(graph):
    trees = [build_tree(graph, source) for source in range(len(graph))]
    for tree in trees:
        for target in tree.nodes:
            path = tree.route(target)
            for first in range(len(path.nodes)):
                subpath = trees[path.nodes[first]].route(target)
                assert subpath.nodes.tolist() == path.nodes[first:].tolist()
                assert subpath.edges.tolist() == path.edges[first:].tolist()


@given(random_maps())
@examples(100)
def test_radius_only_bounds_the_tree(graph):
    for radius in (0.0, 1.0, 2.5):
        full, bounded = build_tree(graph, 0), build_tree(graph, 0, radius=radius)
        is_near = full.distances <= radius
        assert bounded.nodes.tolist() == full.nodes[is_near].tolist()
        assert bounded.parents.tolist() == full.parents[is_near].tolist()
        nodes = np.arange(len(graph))
        expected = [d if d <= radius else np.inf for d in map(full.distance, nodes)]
        assert find_distances(graph, 0, nodes, radius=radius).tolist() == expected


@given(random_maps(), st.integers(1, 6))
@examples(200)
def test_breadth_keeps_the_nearest_nodes_and_ties_with_the_last(graph, breadth):
    full = build_tree(graph, 0)
    bounded = build_tree(graph, 0, search=new_search_on(graph, breadth))
    last = np.sort(full.distances)[min(breadth, len(full.distances)) - 1]
    assert bounded.nodes.tolist() == full.nodes[full.distances <= last].tolist()
