import numpy as np
import pytest

from gpszip.model import GridWalk, Walk
from gpszip.walks.counting import build_road_map
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
