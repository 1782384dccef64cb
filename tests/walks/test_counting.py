import numpy as np
import pytest

from gpszip.model import GridWalk, Walk
from gpszip.walks.counting import build_road_map, find_travelled_segments
from oracle.segment_map import directed_counts


@pytest.mark.parametrize("seed", range(20))
def test_counts_match_a_plain_tally(seed):
    rng = np.random.default_rng(seed)
    nodes = rng.normal(0, 9, (int(rng.integers(1, 9)), 2))
    walks = []
    for _ in range(int(rng.integers(0, 5))):
        knots = int(rng.integers(1, 40))
        visited = rng.integers(0, len(nodes), knots).astype(np.int32)
        gaps = rng.random(knots - 1) < 0.2
        kinds = (Walk("w", visited, None, gaps), GridWalk(visited, np.arange(knots), gaps))
        walks.append(kinds[int(rng.integers(2))])
    road_map, plain = build_road_map(nodes, walks), directed_counts(walks)
    assert road_map.edges.tolist() == [
        list(edge) for edge in sorted({(min(pair), max(pair)) for pair in plain})
    ]
    for (u, v), forward, backward in zip(
        road_map.edges.tolist(), road_map.forward, road_map.backward, strict=True
    ):
        assert (forward, backward) == (plain[u, v], plain[v, u])


def test_walks_of_one_knot_and_no_walks_make_no_edges():
    single_knot = Walk("w", np.array([0], np.int32), None, np.zeros(0, np.bool_))
    for nodes, walks in (([[0.0, 0.0]], [single_knot]), ([[0.0, 0.0]], []), (np.zeros((0, 2)), [])):
        road_map = build_road_map(nodes, walks)
        assert road_map.edges.shape == (0, 2)
        assert len(road_map.nodes) == len(nodes)
        assert len(road_map.forward) == len(road_map.backward) == 0


@pytest.mark.parametrize("seed", range(20))
def test_time_ranges_cut_segments_of_many_walks_as_of_each_alone(seed):
    rng = np.random.default_rng(seed)
    walks = []
    for number in range(int(rng.integers(1, 6))):
        knots = int(rng.integers(1, 12))
        times, gaps = np.cumsum(rng.integers(1, 9, knots)) * 1.0, rng.random(knots - 1) < 0.3
        first, last = times[np.append(True, gaps)], times[np.append(gaps, True)]
        ranges = np.stack([first, last], axis=1) + rng.uniform(-6, 6, (len(first), 2))
        visited = rng.integers(0, 5, knots).astype(np.int32)
        has_ranges = rng.random() < 0.7
        walks.append(Walk(f"{number}", visited, times, gaps, ranges if has_ranges else None))
    road_map = build_road_map(np.zeros((5, 2)), walks)

    # A plain tally, segment by segment.
    tally = dict[tuple[int, int], int]()
    for walk in walks:
        piece, plain = 0, []
        for i, gap in enumerate(walk.gaps.tolist()):
            begin, end = (-np.inf, np.inf) if walk.time_ranges is None else walk.time_ranges[piece]
            u, v = walk.nodes[i : i + 2].tolist()
            is_travel = not gap and u != v and walk.times[i + 1] > begin and walk.times[i] < end
            plain.append(is_travel)
            tally[u, v] = tally.get((u, v), 0) + is_travel
            piece += gap
        assert find_travelled_segments(walk).tolist() == plain
    for (u, v), forward, backward in zip(
        road_map.edges.tolist(), road_map.forward, road_map.backward, strict=True
    ):
        assert (forward, backward) == (tally.get((u, v), 0), tally.get((v, u), 0))
    assert road_map.forward.sum() + road_map.backward.sum() == sum(tally.values())
