import numpy as np
import pytest

from gpszip.graph.road_graph import UNITS_PER_METRE, build_road_graph


def test_arcs_are_sorted_by_source_target_and_edge():
    graph = build_road_graph(np.zeros((4, 2)), [[2, 1], [1, 0], [2, 0], [0, 1], [3, 3]])
    assert graph.offsets.tolist() == [0, 3, 6, 8, 9]
    assert graph.targets.tolist() == [1, 1, 2, 0, 0, 2, 0, 1, 3]
    assert graph.edges.tolist() == [1, 3, 2, 1, 3, 0, 2, 0, 4]


def test_one_way_edges_have_one_arc():
    graph = build_road_graph(np.zeros((2, 2)), [[1, 0], [0, 1]], oneway=[True, False])
    assert graph.targets.tolist() == [1, 0, 0]
    assert graph.edges.tolist() == [1, 0, 1]


def test_edges_without_length_have_positive_weight():
    graph = build_road_graph([[5, 5], [5, 5], [5, 6]], [[0, 1], [1, 2], [2, 2]])
    assert sorted(graph.weights.tolist()) == [1, 1, 1, UNITS_PER_METRE, UNITS_PER_METRE]


def test_longest_path_of_longest_edges_does_not_overflow():
    graph = build_road_graph(np.zeros((1000, 2)), [[0, 1]], lengths=[1e300])
    assert 0 < int(graph.weights[0]) * 1000 < 2**62


def test_given_lengths_replace_distances():
    graph = build_road_graph([[0, 0], [3, 4]], [[0, 1]], lengths=[7.5])
    assert (graph.weights / UNITS_PER_METRE).tolist() == [7.5, 7.5]


def test_nodes_rank_by_coordinates_then_index():
    assert build_road_graph([[1, 0], [0, 5], [0, 2], [1, 0]], []).ranks.tolist() == [2, 1, 0, 3]


def test_shifted_grid_coordinates_give_the_same_graph():
    rng = np.random.default_rng(0)
    nodes, edges = rng.integers(0, 5000, (50, 2)), rng.integers(0, 50, (80, 2))
    graph, shifted = build_road_graph(nodes, edges), build_road_graph(nodes + 10**9, edges)
    assert graph.weights.tolist() == shifted.weights.tolist()
    assert graph.ranks.tolist() == shifted.ranks.tolist()


@pytest.mark.parametrize("edge", [[0, 2], [-1, 0]])
def test_edge_to_a_missing_node_is_refused(edge):
    with pytest.raises(ValueError, match="2 nodes"):
        build_road_graph(np.zeros((2, 2)), [[0, 1], edge])


def test_graph_may_be_empty():
    graph = build_road_graph(np.zeros((0, 2)), np.zeros((0, 2)))
    assert (len(graph), graph.offsets.tolist(), len(graph.targets)) == (0, [0], 0)
