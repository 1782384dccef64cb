import numpy as np
import pytest

from gpszip.codec.waypoints import expand_waypoints, find_waypoints
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.route import build_route
from gpszip.mapping.segment_map import build_walk, make_map
from gpszip.model import SegmentMean, Track
from gpszip.walks.counting import build_road_map
from oracle.segment_map import fitted_positions, random_mean, segment_map

MEANS = [random_mean(np.random.default_rng(seed), dimension=2 + seed % 2) for seed in range(60)]


@pytest.mark.parametrize(("mean", "track"), MEANS)
def test_the_map_is_that_of_algorithm_5(mean, track):
    made = make_map(mean)
    edges, counts_expected = segment_map(mean)
    listed = made.segments.tolist() + made.transitions.tolist()
    assert sorted(map(tuple, listed)) == sorted(edges)
    counts = made.traversals.tolist() + made.passages.tolist()
    assert {
        tuple(edge): count for edge, count in zip(listed, counts, strict=True) if count
    } == counts_expected
    assert made.road_map.nodes.tolist() == mean.starts.tolist() + mean.ends.tolist()


@pytest.mark.parametrize(("mean", "track"), MEANS)
def test_the_road_map_counts_both_directions_of_each_pair(mean, track):
    road_map = make_map(mean).road_map
    _, counts_expected = segment_map(mean)
    for (u, v), forward, backward in zip(
        road_map.edges.tolist(), road_map.forward, road_map.backward, strict=True
    ):
        assert u < v
        assert (forward, backward) == (
            counts_expected.get((u, v), 0),
            counts_expected.get((v, u), 0),
        )
    assert road_map.edges.tolist() == sorted(road_map.edges.tolist())
    assert road_map.forward.sum() + road_map.backward.sum() == sum(counts_expected.values())


@pytest.mark.parametrize(("mean", "track"), MEANS)
def test_the_walk_is_where_the_segment_mean_is_at_every_sample(mean, track):
    walk, nodes = build_walk(mean, track), make_map(mean).road_map.nodes
    assert (np.diff(walk.times) > 0).all()
    assert not walk.gaps.any()
    interpolated = np.stack(
        [np.interp(track.times, walk.times, column) for column in nodes[walk.nodes].T], axis=1
    )
    np.testing.assert_allclose(
        interpolated, fitted_positions(mean, track), atol=1e-5
    )  # times of 1.7e9 s come in steps of 2.4e-7 s
    assert (walk.times[0], walk.times[-1]) == (track.times[0], track.times[-1])


@pytest.mark.parametrize(("mean", "track"), MEANS)
def test_the_walk_runs_on_the_map_and_comes_back_from_its_waypoints(mean, track):
    walk, road_map = build_walk(mean, track), make_map(mean).road_map
    graph = build_road_graph(road_map.nodes, road_map.edges)
    route = build_route(graph, walk.nodes, walk.gaps)
    assert (
        expand_waypoints(graph, find_waypoints(graph, route), len(route.edges)).nodes.tolist()
        == walk.nodes.tolist()
    )
    travelled = build_road_map(road_map.nodes, [walk])
    single = (
        mean.boundaries[-1] - mean.boundaries[-2] == 1
    )  # the last segment is entered and not travelled
    total = road_map.forward.sum() + road_map.backward.sum()
    assert travelled.forward.sum() + travelled.backward.sum() == total - single


def test_times_too_near_to_halve_are_a_gap_and_not_an_edge_that_is_not_there():
    times = np.array([1.0, np.nextafter(1.0, 2.0), 2.0])
    mean = SegmentMean(
        np.arange(4), np.array([0, 1, 0], np.int32), np.zeros((2, 2)), np.ones((2, 2)), cost=0.0
    )
    walk = build_walk(mean, Track("t", times, np.zeros((3, 2))))
    assert walk.nodes.tolist() == [0, 1, 3, 0]
    assert walk.gaps.tolist() == [True, False, False]
    assert (np.diff(walk.times) > 0).all()


def test_a_mean_of_another_track_is_refused():
    mean, track = MEANS[0]
    longer = Track("longer", np.arange(len(track) + 1), np.zeros((len(track) + 1, 2)))
    with pytest.raises(ValueError, match="longer"):
        build_walk(mean, longer)
