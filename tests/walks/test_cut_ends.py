import numpy as np

from gpszip.model import Walk
from gpszip.walks.counting import build_road_map, find_travelled_segments
from gpszip.walks.cut_ends import trim_walks

NODES = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 400.0]])


def walk_with_time_ranges(time_ranges, gaps=(False, False)):
    return Walk(
        "a",
        np.array([0, 1, 2], np.int32),
        np.array([0.0, 10.0, 20.0]),
        np.array(gaps),
        np.array(time_ranges),
    )


def test_a_segment_beyond_the_end_of_its_track_is_trimmed():
    nodes, (trimmed,) = trim_walks(NODES, [walk_with_time_ranges([[0.0, 15.0]])], 20.0)
    assert nodes[3:].tolist() == [[100.0, 200.0]]
    assert (trimmed.nodes.tolist(), trimmed.times.tolist()) == ([0, 1, 3], [0.0, 10.0, 15.0])
    assert build_road_map(nodes, [trimmed]).edges.tolist() == [[0, 1], [1, 3]]


def test_a_track_that_ends_near_a_node_keeps_it():
    walk = walk_with_time_ranges([[0.1, 19.9]])
    nodes, (trimmed,) = trim_walks(NODES, [walk], 20.0)
    assert trimmed is walk
    assert len(nodes) == 3


def test_a_segment_after_the_end_of_its_track_is_no_edge():
    walk = walk_with_time_ranges([[0.0, 10.0]])
    assert find_travelled_segments(walk).tolist() == [True, False]
    nodes, (trimmed,) = trim_walks(NODES, [walk], 20.0)
    assert build_road_map(nodes, [trimmed]).edges.tolist() == [[0, 1]]


def test_pieces_are_trimmed_on_both_sides_of_a_gap():
    walk = Walk(
        "a",
        np.array([0, 2, 2, 0], np.int32),
        np.array([0.0, 10.0, 20.0, 30.0]),
        np.array([False, True, False]),
        np.array([[0.0, 5.0], [25.0, 30.0]]),
    )
    nodes, (trimmed,) = trim_walks(NODES, [walk], 20.0)
    assert nodes[3:].tolist() == [[50.0, 200.0], [50.0, 200.0]]
    assert trimmed.nodes.tolist() == [0, 4, 3, 0] or trimmed.nodes.tolist() == [0, 3, 4, 0]
    assert trimmed.times.tolist() == [0.0, 5.0, 25.0, 30.0]


def test_a_single_segment_is_trimmed_at_both_ends():
    walk = Walk(
        "a",
        np.array([0, 2], np.int32),
        np.array([0.0, 10.0]),
        np.array([False]),
        np.array([[4.0, 6.0]]),
    )
    nodes, (trimmed,) = trim_walks(NODES, [walk], 20.0)
    assert nodes[trimmed.nodes].tolist() == [[40.0, 160.0], [60.0, 240.0]]
    assert trimmed.times.tolist() == [4.0, 6.0]
