import numpy as np

from gpszip.graph.road_graph import UNITS_PER_METRE, build_road_graph
from gpszip.graph.trees import TreeCache, build_tree, find_distances, new_search_on
from oracle.paths import canonical_paths


def grid(side):
    names = np.arange(side * side).reshape(side, side)
    across = np.stack((names[:, :-1].ravel(), names[:, 1:].ravel()), axis=1)
    down = np.stack((names[:-1].ravel(), names[1:].ravel()), axis=1)
    return build_road_graph(np.argwhere(names >= 0), np.concatenate((across, down)))


def test_among_the_many_equal_paths_of_a_grid_the_first_is_taken():
    graph = grid(9)
    for source in (0, 40, 71):
        tree = build_tree(graph, source)
        for node, (length, nodes, _) in canonical_paths(graph, source).items():
            assert tuple(tree.route(node).nodes.tolist()) == nodes
            assert tree.distance(node) == length / UNITS_PER_METRE


def test_work_arrays_can_be_used_again():
    graph = grid(5)
    search = new_search_on(graph)
    for source in range(25):
        again, fresh = build_tree(graph, source, search=search), build_tree(graph, source)
        assert again.parents.tolist() == fresh.parents.tolist()
        assert find_distances(graph, source, [3, 20], search=search).tolist() == [
            fresh.distance(3),
            fresh.distance(20),
        ]


def test_what_is_not_reached_has_no_route():
    tree = build_tree(build_road_graph([[0, 0], [1, 0], [5, 5]], [[0, 1]], oneway=[True]), 1)
    assert tree.route(0) is None
    assert tree.distance(2) == np.inf
    assert tree.route(1).nodes.tolist() == [1]


def test_the_search_stops_once_all_targets_are_settled():
    graph = grid(20)
    search = new_search_on(graph)
    find_distances(graph, 0, [1, 20, 21], search=search)
    assert search.state[2] < 10


def test_a_store_forgets_the_tree_not_asked_for_longest():
    graph = grid(4)
    size = 2 * sum(array.nbytes for array in vars(build_tree(graph, 0)).values())
    store = TreeCache(graph, size=size)
    first, second = store.tree(0), store.tree(1)
    assert store.tree(0) is first
    third = store.tree(2)
    assert store.tree(0) is first
    assert store.tree(2) is third
    assert store.tree(1) is not second


def test_a_store_without_room_still_answers():
    store = TreeCache(grid(3), radius=1.0, size=0)
    assert store.tree(4).nodes.tolist() == [1, 3, 4, 5, 7]
    assert store.tree(0).nodes.tolist() == [0, 1, 3]
