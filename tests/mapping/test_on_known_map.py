import numpy as np
import pytest

from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode
from gpszip.mapping import search as connected
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
    whole = patrol(96000, seed=2)
    return Track("0", whole.times[::16], whole.positions[::16])


@pytest.fixture(scope="module")
def known(day):
    """The map of the first half of a patrol, and its lattice."""
    morning = [half(day, 0, 3000, "morning")]
    grid, walks = connected.learn_map(morning, no_gaps(morning), rmse=RMSE, effort=1)
    return grid, Prior(walks)


@pytest.fixture(scope="module")
def later(day):
    return [half(day, 3000, 4700, "noon"), half(day, 4700, 6000, "evening")]


def errors(tracks, walks, grid):
    return measure_errors(
        tracks,
        dequantise_walks(walks, grid, [track.id for track in tracks]),
        node_positions(walks, grid),
    )


@pytest.mark.parametrize("bound", [{"rmse": RMSE}, {"max_error": 1.5}])
def test_later_tracks_are_walks_on_the_map_within_the_bound(known, later, bound):
    grid, past = known
    walks = learn_on(past, grid, later, no_gaps(later), **bound, effort=2)
    read = decode(encode(walks, past), 2, 2, past)
    assert read.nodes[: past.nodes].tolist() == past.walks.nodes.tolist()
    found = errors(later, read, grid)
    assert found.uncovered == 0
    assert (found.rmse <= RMSE) if "rmse" in bound else (found.max_error <= 1.5)
    # most of what they use is there already
    used = np.unique(np.concatenate([walk.nodes for walk in walks.walks]))
    assert (used < past.nodes).sum() > (used >= past.nodes).sum()


def test_a_known_map_saves_bytes(known, later):
    grid, past = known
    on_map = encode(learn_on(past, grid, later, no_gaps(later), rmse=RMSE, effort=2), past)
    alone = encode(connected.learn_map(later, no_gaps(later), rmse=RMSE, effort=2)[1])
    assert len(on_map) < 0.95 * len(alone)


def test_a_log_from_elsewhere_gets_nodes_of_its_own(known, later):
    grid, past = known
    away = [Track(track.id, track.times, track.positions + 5000.0) for track in later]
    walks = learn_on(past, grid, away, no_gaps(away), rmse=RMSE, effort=1)
    used = np.unique(np.concatenate([walk.nodes for walk in walks.walks]))
    assert used.min() >= past.nodes
    assert errors(away, walks, grid).rmse <= RMSE


def test_the_executor_does_not_matter(known, later):
    grid, past = known
    one, two = (
        learn_on(past, grid, later, no_gaps(later), rmse=RMSE, effort=3, executor=executor)
        for executor in (None, Serial())
    )
    assert encode(one, past) == encode(two, past)


def test_a_small_part_of_a_log_gets_a_small_part_of_its_work(known, later):
    grid, past = known

    def searched(**work):
        starts = []
        walks = learn_on(
            past,
            grid,
            later,
            no_gaps(later),
            rmse=RMSE,
            **work,
            progress=lambda _, count: starts.append(count),
        )
        return starts[-1], len(encode(walks, past))

    alone, (most, best) = searched(effort=1), searched(effort=5)
    assert most > alone[0] == 1
    assert best <= alone[1]
    assert searched(effort=5, share=1e-6) == alone


def test_a_finer_bound_takes_a_finer_lattice(known):
    grid, _ = known
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
