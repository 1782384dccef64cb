import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.verbatim import keep_samples
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track
from gpszip.walks.error import measure_errors
from gpszip.walks.quantised import dequantise_walks, node_positions


def coarse(track, gaps, keep, grid=None):
    """A walk over the ends of the pieces and some of the samples between them, on a fine lattice."""
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
@settings(max_examples=60, deadline=None)
def test_no_sample_stays_farther_than_the_maximum(seed, n, dimension, maximum):
    rng = np.random.default_rng(seed)
    track = Track(
        "a",
        1e6 + np.cumsum(rng.uniform(0.5, 3.0, n)),
        np.cumsum(rng.normal(0, 1, (n, dimension)), axis=0),
    )
    gaps = rng.random(n - 1) < 0.05
    grid, grid_walks = coarse(track, gaps, rng.random(n) < 0.1)
    before = errors([track], grid, grid_walks)
    assume(
        not before.uncovered
    )  # a lone sample became a stop of two knots, which shifts those that this test keeps
    mended = enforce_max_error([track], grid, grid_walks, maximum)
    assert mended is not None
    found = errors([track], *mended)
    assert found.max_error <= maximum
    assert found.uncovered == 0
    walk = mended[1].walks[0]
    assert (np.diff(walk.time_steps) > 0).all()
    assert walk.gaps.sum() == grid_walks.walks[0].gaps.sum()
    if before.max_error <= maximum:
        np.testing.assert_array_equal(walk.time_steps, grid_walks.walks[0].time_steps)


def test_a_detour_goes_by_nodes_that_are_there():
    x = np.concatenate([np.arange(10.0), np.arange(10.0, 0.0, -1), np.arange(11.0)])
    track = Track("a", np.arange(31.0), x[:, None])
    grid_walks = GridWalks(
        np.array([[0], [10]]),
        (GridWalk(np.array([0, 1], np.int32), np.array([0, 30]), np.array([False])),),
    )
    _, mended = enforce_max_error([track], QuantisationGrid((0,), 0, 128, 128), grid_walks, 0.5)
    assert mended.nodes.tolist() == [[0], [10]]
    assert mended.walks[0].nodes.tolist() == [0, 1, 0, 1]


def test_a_lattice_too_coarse_is_made_finer_and_only_then():
    track = Track("a", np.arange(0.0, 40.0, 0.5), (np.arange(80)[:, None] // 2 % 2) * 5.0)
    grid_walks = GridWalks(
        np.array([[0]]),
        (GridWalk(np.array([0, 0], np.int32), np.array([0, 5]), np.array([False])),),
    )
    grid, mended = enforce_max_error([track], QuantisationGrid((0,), 0, 100, 152), grid_walks, 1.0)
    assert grid.time < 152
    assert errors([track], grid, mended).max_error <= 1.0
    calm = Track("b", np.arange(0.0, 40.0, 0.5), np.zeros((80, 1)))
    assert enforce_max_error([calm], QuantisationGrid((0,), 0, 100, 152), grid_walks, 1.0)[
        0
    ] == QuantisationGrid((0,), 0, 100, 152)


def test_a_maximum_below_the_finest_lattice_is_missed():
    rng = np.random.default_rng(1)
    track = Track("a", np.arange(30.0), rng.normal(0, 1, (30, 2)))
    grid, grid_walks = coarse(track, np.zeros(29, bool), np.zeros(30, bool))
    assert enforce_max_error([track], grid, grid_walks, 1e-7) is None


@pytest.mark.parametrize("count", [2, 3])
def test_tracks_share_the_nodes_that_mending_adds(count):
    one = Track("0", np.arange(20.0), np.where(np.arange(20)[:, None] == 9, 7.0, 0.0))
    tracks = [Track(str(i), one.times, one.positions) for i in range(count)]
    walk = GridWalk(np.array([0, 0], np.int32), np.array([0, 19]), np.array([False]))
    _, mended = enforce_max_error(
        tracks,
        QuantisationGrid((0,), 0, 128, 128),
        GridWalks(np.array([[0]]), (walk,) * count),
        0.4,
    )
    assert sorted(mended.nodes[:, 0].tolist()) == [0, 7]
