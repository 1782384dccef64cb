from collections import Counter

import numpy as np
import pytest

from gpszip.mapping.cleaning import dissolve, drop_isolated, filter_traversals
from gpszip.model import RoadMap


def random_map(seed, nodes=12, edges=14):
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, nodes, (edges, 2))
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0).astype(np.int32)
    forward, backward = rng.integers(0, 9, (2, len(pairs)))
    return RoadMap(rng.normal(0, 50, (nodes, 2)), pairs, forward, backward)


def hops(way):
    return list(zip(way[:-1].tolist(), way[1:].tolist(), strict=True))


@pytest.mark.parametrize("seed", range(40))
def test_ways_hold_each_edge_once_and_end_where_edges_do_not_pair(seed):
    road_map = random_map(seed)
    ways = dissolve(road_map)
    strung = [tuple(sorted(hop)) for way in range(len(ways)) for hop in hops(ways[way])]
    assert sorted(strung) == sorted(map(tuple, road_map.edges.tolist()))
    degree = Counter(road_map.edges.ravel().tolist())
    for way in range(len(ways)):
        nodes = ways[way].tolist()
        assert all(degree[node] == 2 for node in nodes[1:-1])
        ring = nodes[0] == nodes[-1]
        assert ring or all(degree[node] != 2 for node in (nodes[0], nodes[-1]))


@pytest.mark.parametrize("seed", range(40))
def test_a_way_counts_its_busiest_edge_in_each_direction(seed):
    road_map = random_map(seed)
    counts = {}
    for (u, v), forward, backward in zip(road_map.edges.tolist(), road_map.forward.tolist(), road_map.backward.tolist(), strict=True):
        counts[u, v], counts[v, u] = forward, backward
    ways = dissolve(road_map)
    for way in range(len(ways)):
        assert ways.forward[way] == max(counts[u, v] for u, v in hops(ways[way]))
        assert ways.backward[way] == max(counts[v, u] for u, v in hops(ways[way]))


def test_rings_close_with_and_without_a_junction():
    pairs = np.array([[0, 1], [0, 2], [1, 2], [3, 4], [3, 6], [4, 5], [4, 6]], np.int32)
    ones = np.ones(len(pairs), np.int64)
    ways = dissolve(RoadMap(np.zeros((7, 2)), pairs, ones, ones))
    assert sorted(tuple(ways[way].tolist()) for way in range(len(ways))) == [(0, 1, 2, 0), (4, 3, 6, 4), (4, 5)]


def test_a_map_without_edges_has_no_ways():
    assert len(dissolve(RoadMap(np.zeros((3, 2)), np.zeros((0, 2), np.int32), np.zeros(0, np.int64), np.zeros(0, np.int64)))) == 0


@pytest.mark.parametrize("minimum", [0, 1, 5, 99])
def test_filtered_maps_keep_what_was_travelled_often_enough(minimum):
    road_map = random_map(3)
    total = road_map.forward + road_map.backward
    kept = filter_traversals(road_map, minimum)
    assert kept.edges.tolist() == road_map.edges[total >= minimum].tolist()
    assert (kept.forward + kept.backward).tolist() == total[total >= minimum].tolist()
    joined = drop_isolated(kept)
    assert joined.nodes[joined.edges].tolist() == kept.nodes[kept.edges].tolist()
    assert set(joined.edges.ravel().tolist()) == set(range(len(joined.nodes)))
