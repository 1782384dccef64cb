import numpy as np
import pytest

from gpszip.graph.road_graph import UNITS_PER_METRE, build_road_graph


def test_arcs_are_sorted_by_source_target_and_edge():
    graph = build_road_graph(np.zeros((4, 2)), [[2, 1], [1, 0], [2, 0], [0, 1], [3, 3]])
    assert graph.offsets.tolist() == [0, 3, 6, 8, 9]
    assert graph.targets.tolist() == [1, 1, 2, 0, 0, 2, 0, 1, 3]
    assert graph.edges.tolist() == [1, 3, 2, 1, 3, 0, 2, 0, 4]


def test_oneway_edges_have_one_arc():
    graph = build_road_graph(np.zeros((2, 2)), [[1, 0], [0, 1]], oneway=[True, False])
    assert graph.targets.tolist() == [1, 0, 0]
    assert graph.edges.tolist() == [1, 0, 1]


def test_weights_are_positive_even_of_edges_without_length():
    graph = build_road_graph([[5, 5], [5, 5], [5, 6]], [[0, 1], [1, 2], [2, 2]])
    assert sorted(graph.weights.tolist()) == [1, 1, 1, UNITS_PER_METRE, UNITS_PER_METRE]


def test_the_longest_path_of_the_longest_edges_does_not_overflow():
    graph = build_road_graph(np.zeros((1000, 2)), [[0, 1]], lengths=[1e300])
    assert 0 < int(graph.weights[0]) * 1000 < 2**62


def test_lengths_given_replace_the_distance():
    assert (
        build_road_graph([[0, 0], [3, 4]], [[0, 1]], lengths=[7.5]).weights / UNITS_PER_METRE
    ).tolist() == [7.5, 7.5]


def test_nodes_rank_by_their_first_coordinate_then_the_next_then_their_index():
    assert build_road_graph([[1, 0], [0, 5], [0, 2], [1, 0]], []).ranks.tolist() == [2, 1, 0, 3]


def test_lattice_coordinates_give_the_same_graph_wherever_they_lie():
    rng = np.random.default_rng(0)
    nodes, edges = rng.integers(0, 5000, (50, 2)), rng.integers(0, 50, (80, 2))
    here, there = build_road_graph(nodes, edges), build_road_graph(nodes + 10**9, edges)
    assert here.weights.tolist() == there.weights.tolist()
    assert here.ranks.tolist() == there.ranks.tolist()


@pytest.mark.parametrize("edge", [[0, 2], [-1, 0]])
def test_an_edge_to_a_node_that_is_not_there_is_refused(edge):
    with pytest.raises(ValueError, match="2 nodes"):
        build_road_graph(np.zeros((2, 2)), [[0, 1], edge])


def test_a_graph_may_be_empty():
    graph = build_road_graph(np.zeros((0, 2)), np.zeros((0, 2)))
    assert (len(graph), graph.offsets.tolist(), len(graph.targets)) == (0, [0], 0)
