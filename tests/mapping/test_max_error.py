import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.verbatim import keep_samples
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track
from gpszip.walks.error import measure_errors
from gpszip.walks.quantised import dequantise_walks, node_positions
from random_tests import examples


def sparse_walk(track, gaps, keep, grid=None):
    """A walk over the ends of the pieces and some of the samples between them, on a fine grid."""
    grid, grid_walks = keep_samples([track], [gaps], 0.01) if grid is None else grid
    walk = grid_walks.walks[0]
    first, last = np.append(True, gaps), np.append(gaps, True)
    kept = np.flatnonzero(first | last | keep)
    return grid, GridWalks(
        grid_walks.nodes,
        (GridWalk(walk.nodes[kept], walk.time_steps[kept], np.append(gaps, False)[kept[:-1]]),),
    )


def errors(tracks, grid, grid_walks):
    return measure_errors(
        tracks,
        dequantise_walks(grid_walks, grid, [track.id for track in tracks]),
        node_positions(grid_walks, grid),
    )


@given(
    st.integers(0, 10_000), st.integers(2, 120), st.integers(1, 3), st.sampled_from([0.1, 1.0, 8.0])
)
@examples(60)
def test_all_samples_come_within_the_maximum(seed, n, dimension, maximum):
    rng = np.random.default_rng(seed)
    track = Track(
        "a",
        1e6 + np.cumsum(rng.uniform(0.5, 3.0, n)),
        np.cumsum(rng.normal(0, 1, (n, dimension)), axis=0),
    )
    gaps = rng.random(n - 1) < 0.05
    grid, grid_walks = sparse_walk(track, gaps, rng.random(n) < 0.1)
    before = errors([track], grid, grid_walks)
    # A single sample becomes a stop of two knots, which shifts those that this test keeps.
    assume(not before.uncovered)
    changed = enforce_max_error([track], grid, grid_walks, maximum)
    assert changed is not None
    after = errors([track], *changed)
    assert after.max_error <= maximum
    assert after.uncovered == 0
    walk = changed[1].walks[0]
    assert (np.diff(walk.time_steps) > 0).all()
    assert walk.gaps.sum() == grid_walks.walks[0].gaps.sum()
    if before.max_error <= maximum:
        np.testing.assert_array_equal(walk.time_steps, grid_walks.walks[0].time_steps)


def test_a_detour_uses_existing_nodes():
    x = np.concatenate([np.arange(10.0), np.arange(10.0, 0.0, -1), np.arange(11.0)])
    track = Track("a", np.arange(31.0), x[:, None])
    grid_walks = GridWalks(
        np.array([[0], [10]]),
        (GridWalk(np.array([0, 1], np.int32), np.array([0, 30]), np.array([False])),),
    )
    _, changed = enforce_max_error([track], QuantisationGrid((0,), 0, 128, 128), grid_walks, 0.5)
    assert changed.nodes.tolist() == [[0], [10]]
    assert changed.walks[0].nodes.tolist() == [0, 1, 0, 1]


def test_a_grid_is_refined_only_where_it_is_too_coarse():
    track = Track("a", np.arange(0.0, 40.0, 0.5), (np.arange(80)[:, None] // 2 % 2) * 5.0)
    grid_walks = GridWalks(
        np.array([[0]]),
        (GridWalk(np.array([0, 0], np.int32), np.array([0, 5]), np.array([False])),),
    )
    grid, changed = enforce_max_error([track], QuantisationGrid((0,), 0, 100, 152), grid_walks, 1.0)
    assert grid.time < 152
    assert errors([track], grid, changed).max_error <= 1.0
    parked = Track("b", np.arange(0.0, 40.0, 0.5), np.zeros((80, 1)))
    assert enforce_max_error([parked], QuantisationGrid((0,), 0, 100, 152), grid_walks, 1.0)[
        0
    ] == QuantisationGrid((0,), 0, 100, 152)


def test_a_maximum_below_the_finest_grid_is_missed():
    rng = np.random.default_rng(1)
    track = Track("a", np.arange(30.0), rng.normal(0, 1, (30, 2)))
    grid, grid_walks = sparse_walk(track, np.zeros(29, bool), np.zeros(30, bool))
    assert enforce_max_error([track], grid, grid_walks, 1e-7) is None


@pytest.mark.parametrize("count", [2, 3])
def test_tracks_share_new_nodes(count):
    first = Track("0", np.arange(20.0), np.where(np.arange(20)[:, None] == 9, 7.0, 0.0))
    tracks = [Track(str(i), first.times, first.positions) for i in range(count)]
    walk = GridWalk(np.array([0, 0], np.int32), np.array([0, 19]), np.array([False]))
    _, changed = enforce_max_error(
        tracks,
        QuantisationGrid((0,), 0, 128, 128),
        GridWalks(np.array([[0]]), (walk,) * count),
        0.4,
    )
    assert sorted(changed.nodes[:, 0].tolist()) == [0, 7]
