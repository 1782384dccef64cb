import numpy as np

from gpszip.model import Walk
from gpszip.walks.counting import build_road_map, find_travelled_segments
from gpszip.walks.cut_ends import trim_walks

NODES = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 400.0]])


def one(spans, gaps=(False, False)):
    return Walk(
        "a",
        np.array([0, 1, 2], np.int32),
        np.array([0.0, 10.0, 20.0]),
        np.array(gaps),
        np.array(spans),
    )


def test_a_part_that_goes_on_beyond_its_track_is_drawn_to_where_that_ends():
    nodes, (cut,) = trim_walks(NODES, [one([[0.0, 15.0]])], 20.0)
    assert nodes[3:].tolist() == [[100.0, 200.0]]
    assert (cut.nodes.tolist(), cut.times.tolist()) == ([0, 1, 3], [0.0, 10.0, 15.0])
    assert build_road_map(nodes, [cut]).edges.tolist() == [[0, 1], [1, 3]]


def test_a_track_that_ends_near_a_node_is_drawn_to_it():
    walk = one([[0.1, 19.9]])
    nodes, (cut,) = trim_walks(NODES, [walk], 20.0)
    assert cut is walk
    assert len(nodes) == 3


def test_what_lies_outside_as_a_whole_is_not_drawn():
    walk = one([[0.0, 10.0]])
    assert find_travelled_segments(walk).tolist() == [True, False]
    nodes, (cut,) = trim_walks(NODES, [walk], 20.0)
    assert build_road_map(nodes, [cut]).edges.tolist() == [[0, 1]]


def test_both_ends_of_pieces_beside_a_gap_are_cut():
    walk = Walk(
        "a", np.array([0, 2, 2, 0], np.int32), np.array([0.0, 10.0, 20.0, 30.0]), np.array([False, True, False]),
        np.array([[0.0, 5.0], [25.0, 30.0]]),
    )  # fmt: skip
    nodes, (cut,) = trim_walks(NODES, [walk], 20.0)
    assert nodes[3:].tolist() == [[50.0, 200.0], [50.0, 200.0]]
    assert cut.nodes.tolist() == [0, 4, 3, 0] or cut.nodes.tolist() == [0, 3, 4, 0]
    assert cut.times.tolist() == [0.0, 5.0, 25.0, 30.0]


def test_one_part_may_be_cut_at_both_ends():
    walk = Walk(
        "a",
        np.array([0, 2], np.int32),
        np.array([0.0, 10.0]),
        np.array([False]),
        np.array([[4.0, 6.0]]),
    )
    nodes, (cut,) = trim_walks(NODES, [walk], 20.0)
    assert nodes[cut.nodes].tolist() == [[40.0, 160.0], [60.0, 240.0]]
    assert cut.times.tolist() == [4.0, 6.0]
