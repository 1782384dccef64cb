import numpy as np

from gpszip.graph.kernels.shortest_paths import SETTLED
from gpszip.graph.road_graph import UNITS_PER_METRE, build_road_graph
from gpszip.graph.trees import TreeCache, build_tree, find_distances, new_search_on
from oracle.paths import canonical_paths


def grid(side):
    """A square grid of streets of equal length."""
    names = np.arange(side * side).reshape(side, side)
    across = np.stack((names[:, :-1].ravel(), names[:, 1:].ravel()), axis=1)
    down = np.stack((names[:-1].ravel(), names[1:].ravel()), axis=1)
    return build_road_graph(np.argwhere(names >= 0), np.concatenate((across, down)))


def test_paths_of_a_grid_are_the_lexicographically_first():
    graph = grid(9)
    for source in (0, 40, 71):
        tree = build_tree(graph, source)
        for node, (length, nodes, _) in canonical_paths(graph, source).items():
            assert tuple(tree.route(node).nodes.tolist()) == nodes
            assert tree.distance(node) == length / UNITS_PER_METRE


def test_work_arrays_can_be_reused():
    graph = grid(5)
    search = new_search_on(graph)
    for source in range(25):
        tree, fresh = build_tree(graph, source, search=search), build_tree(graph, source)
        assert tree.parents.tolist() == fresh.parents.tolist()
        assert find_distances(graph, source, [3, 20], search=search).tolist() == [
            fresh.distance(3),
            fresh.distance(20),
        ]


def test_unreached_nodes_have_no_route():
    tree = build_tree(build_road_graph([[0, 0], [1, 0], [5, 5]], [[0, 1]], oneway=[True]), 1)
    assert tree.route(0) is None
    assert tree.distance(2) == np.inf
    assert tree.route(1).nodes.tolist() == [1]


def test_search_stops_once_all_targets_are_settled():
    graph = grid(20)
    search = new_search_on(graph)
    find_distances(graph, 0, [1, 20, 21], search=search)
    assert search.state[SETTLED] < 10


def test_cache_evicts_the_least_recently_used_tree():
    graph = grid(4)
    size = 2 * sum(array.nbytes for array in vars(build_tree(graph, 0)).values())
    cache = TreeCache(graph, size=size)
    first, second = cache.tree(0), cache.tree(1)
    assert cache.tree(0) is first
    third = cache.tree(2)
    assert cache.tree(0) is first
    assert cache.tree(2) is third
    assert cache.tree(1) is not second


def test_cache_without_space_still_answers():
    cache = TreeCache(grid(3), radius=1.0, size=0)
    assert cache.tree(4).nodes.tolist() == [1, 3, 4, 5, 7]
    assert cache.tree(0).nodes.tolist() == [0, 1, 3]
