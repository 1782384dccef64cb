import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.mapping.verbatim import keep_samples
from gpszip.model import Track
from gpszip.walks.quantised import dequantise_walks, node_positions
from oracle.decoded import position
from random_tests import examples


@given(
    st.integers(0, 10_000),
    st.integers(1, 30),
    st.integers(1, 4),
    st.sampled_from([0.05, 0.5, 5.0, 1e3]),
)
@examples(150)
def test_all_samples_are_within_the_error(seed, n, dimension, error):
    rng = np.random.default_rng(seed)
    tracks = [
        Track(
            str(i),
            1.4e9 + np.cumsum(rng.uniform(0.5, 20, n)),
            np.cumsum(rng.normal(0, 30, (n, dimension)), axis=0),
        )
        for i in range(2)
    ]
    gaps = [rng.random(n - 1) < 0.2 for _ in tracks]
    grid, grid_walks = keep_samples(tracks, gaps, error)
    nodes = node_positions(grid_walks, grid)
    for track, walk in zip(tracks, dequantise_walks(grid_walks, grid, ["0", "1"]), strict=True):
        for t, p in zip(track.times, track.positions, strict=True):
            interpolated = position(walk.times, nodes[walk.nodes], walk.gaps, t)
            assert interpolated is not None
            assert np.linalg.norm(interpolated - p) <= error * (1 + 1e-9)


def test_samples_that_round_to_one_position_share_a_node():
    track = Track("a", range(6), [[0.0, 0.0], [9.0, 0.0]] * 3)
    _, grid_walks = keep_samples([track], [np.zeros(5, bool)], 0.5)
    assert grid_walks.walks[0].nodes.tolist() == [0, 1, 0, 1, 0, 1]


def test_gaps_stay_gaps():
    track = Track("a", [0.0, 1.0, 100.0, 101.0], [[0.0], [1.0], [50.0], [51.0]])
    _, grid_walks = keep_samples([track], [np.array([False, True, False])], 0.5)
    assert grid_walks.walks[0].gaps.tolist() == [False, True, False]


@pytest.mark.parametrize("n", [1, 2])
def test_the_shortest_tracks_are_kept(n):
    grid, grid_walks = keep_samples(
        [Track("a", range(n), np.ones((n, 2)))], [np.zeros(n - 1, bool)], 0.1
    )
    assert len(grid_walks.nodes) == 1
    assert node_positions(grid_walks, grid) == pytest.approx(np.ones((1, 2)), abs=0.1)
