import numpy as np
import pytest

from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode
from gpszip.mapping import search
from gpszip.mapping.on_known_map import learn_on, needed_refinements
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track
from gpszip.model.grid import MAX_REFINEMENTS, refined_grid, step_size
from gpszip.model.grid_walks import refined
from gpszip.run import Serial
from gpszip.testing import patrol
from gpszip.walks.error import measure_errors
from gpszip.walks.quantised import dequantise_walks, node_positions

RMSE = 0.4


def half(track, first, last, name):
    return Track(name, track.times[first:last], track.positions[first:last])


def no_gaps(tracks):
    return [np.zeros(len(track) - 1, bool) for track in tracks]


@pytest.fixture(scope="module")
def day():
    """Two hours of a patrol, a sample each second."""
    log = patrol(96000, seed=2)
    return Track("0", log.times[::16], log.positions[::16])


@pytest.fixture(scope="module")
def known_map(day):
    """Grid and walks of the first half of a patrol."""
    morning = [half(day, 0, 3000, "morning")]
    grid, walks = search.learn_map(morning, no_gaps(morning), rmse=RMSE, effort=1)
    return grid, Prior(walks)


@pytest.fixture(scope="module")
def later_tracks(day):
    return [half(day, 3000, 4700, "noon"), half(day, 4700, 6000, "evening")]


def errors(tracks, walks, grid):
    return measure_errors(
        tracks,
        dequantise_walks(walks, grid, [track.id for track in tracks]),
        node_positions(walks, grid),
    )


@pytest.mark.parametrize("bound", [{"rmse": RMSE}, {"max_error": 1.5}])
def test_later_tracks_keep_the_bound_on_the_map(known_map, later_tracks, bound):
    grid, prior = known_map
    walks = learn_on(prior, grid, later_tracks, no_gaps(later_tracks), **bound, effort=2)
    read = decode(encode(walks, prior), 2, 2, prior)
    assert read.nodes[: prior.nodes].tolist() == prior.walks.nodes.tolist()
    summary = errors(later_tracks, read, grid)
    assert summary.uncovered == 0
    assert (summary.rmse <= RMSE) if "rmse" in bound else (summary.max_error <= 1.5)
    # Most of the nodes that they use are known.
    used = np.unique(np.concatenate([walk.nodes for walk in walks.walks]))
    assert (used < prior.nodes).sum() > (used >= prior.nodes).sum()


def test_a_known_map_saves_bytes(known_map, later_tracks):
    grid, prior = known_map
    on_map = encode(
        learn_on(prior, grid, later_tracks, no_gaps(later_tracks), rmse=RMSE, effort=2), prior
    )
    separate = encode(search.learn_map(later_tracks, no_gaps(later_tracks), rmse=RMSE, effort=2)[1])
    assert len(on_map) < 0.95 * len(separate)


def test_a_log_from_elsewhere_gets_new_nodes(known_map, later_tracks):
    grid, prior = known_map
    away = [Track(track.id, track.times, track.positions + 5000.0) for track in later_tracks]
    walks = learn_on(prior, grid, away, no_gaps(away), rmse=RMSE, effort=1)
    used = np.unique(np.concatenate([walk.nodes for walk in walks.walks]))
    assert used.min() >= prior.nodes
    assert errors(away, walks, grid).rmse <= RMSE


def test_the_executor_does_not_change_the_walks(known_map, later_tracks):
    grid, prior = known_map
    first, second = (
        learn_on(
            prior, grid, later_tracks, no_gaps(later_tracks), rmse=RMSE, effort=3, executor=executor
        )
        for executor in (None, Serial())
    )
    assert encode(first, prior) == encode(second, prior)


def test_a_small_share_of_a_log_gets_a_small_share_of_its_work(known_map, later_tracks):
    grid, prior = known_map

    def run(**work):
        starts = []
        walks = learn_on(
            prior,
            grid,
            later_tracks,
            no_gaps(later_tracks),
            rmse=RMSE,
            **work,
            progress=lambda _, count: starts.append(count),
        )
        return starts[-1], len(encode(walks, prior))

    single, (starts, size) = run(effort=1), run(effort=5)
    assert starts > single[0] == 1
    assert size <= single[1]
    assert run(effort=5, share=1e-6) == single


def test_a_finer_bound_takes_a_finer_grid(known_map):
    grid, _ = known_map
    assert needed_refinements(grid, RMSE, None) == 0
    assert needed_refinements(grid, RMSE / 4, None) > 0
    assert needed_refinements(grid, RMSE / 1000, None) == MAX_REFINEMENTS
    assert needed_refinements(grid, None, 2.5 * RMSE) == 0
    assert step_size(refined_grid(grid, 2).space) == pytest.approx(step_size(grid.space) / 4)


@pytest.mark.parametrize("times", [0, 1, 3])
def test_refined_walks_are_the_same_walks(times):
    grid = QuantisationGrid((1000, -5000), 250, 120, 130)
    walks = GridWalks(
        np.array([[3, -7], [0, 12]]),
        (GridWalk(np.array([0, 1], np.int32), np.array([-4, 9]), np.zeros(1, bool)),),
    )
    fine = refined(walks, times)
    np.testing.assert_allclose(
        node_positions(fine, refined_grid(grid, times)), node_positions(walks, grid)
    )
    (one,), (two,) = (
        dequantise_walks(walks, grid, ["a"]),
        dequantise_walks(fine, refined_grid(grid, times), ["a"]),
    )
    np.testing.assert_allclose(one.times, two.times)
