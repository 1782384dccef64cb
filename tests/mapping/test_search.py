import numpy as np
import pytest

from gpszip.codec.walks import encode
from gpszip.errors import OptionError
from gpszip.mapping.search import learn_map
from gpszip.model import Track, Walk
from gpszip.model.grid import step_size
from gpszip.run import Serial, Threads
from gpszip.testing import drives, patrol
from gpszip.walks.error import measure_errors


def no_gaps(tracks):
    return [np.zeros(len(track) - 1, bool) for track in tracks]


def measured(tracks, grid, grid_walks):
    nodes = np.array(grid.origin) / 1000 + grid_walks.nodes * step_size(grid.space)
    walks = [
        Walk(
            track.id,
            walk.nodes,
            grid.epoch / 1000 + walk.time_steps * step_size(grid.time),
            walk.gaps,
        )
        for track, walk in zip(tracks, grid_walks.walks, strict=True)
    ]
    return measure_errors(tracks, walks, nodes)


@pytest.fixture(scope="module")
def town():
    """Vehicles in whole milliseconds and millimetres, so that a shift loses nothing."""
    vehicles = drives(4, vehicles=4, duration=300.0, seed=2).items()
    return [
        Track(name, np.round(times, 3), np.round(positions, 3))
        for name, (times, positions) in vehicles
    ]


@pytest.mark.parametrize("rmse", [3.0, 8.0])
def test_the_error_is_within_the_bound(town, rmse):
    grid, grid_walks = learn_map(town, no_gaps(town), rmse=rmse, effort=1)
    errors = measured(town, grid, grid_walks)
    assert errors.uncovered == 0
    assert 0.5 * rmse < errors.rmse <= rmse


def test_tracks_of_one_sample_and_parked_tracks_are_learned():
    tracks = [Track("a", [5.0], [[1.0, 2.0]]), Track("b", np.arange(50.0), np.zeros((50, 2)))]
    grid, grid_walks = learn_map(tracks, no_gaps(tracks), rmse=1.0, effort=1)
    errors = measured(tracks, grid, grid_walks)
    assert errors.uncovered == 0
    assert errors.rmse <= 1.0


@pytest.mark.parametrize(
    ("effort", "executors"),
    [(1, (None, Serial(), Threads(1), Threads(3))), (3, (None, Threads(3)))],
    ids=["one start", "several starts"],
)
def test_the_executor_does_not_change_the_bytes(town, effort, executors):
    results = [
        learn_map(town, no_gaps(town), rmse=6.0, effort=effort, executor=run) for run in executors
    ]
    assert len({(grid, encode(grid_walks)) for grid, grid_walks in results}) == 1


def short_patrol(seed):
    track = patrol(1000, seed=seed)
    return Track(track.id, track.times[:150], track.positions[:150])


def test_a_race_gives_the_same_bytes_for_any_number_of_workers():
    track, calls = short_patrol(1), []
    results = [
        learn_map(
            [track],
            no_gaps([track]),
            rmse=0.5,
            effort=6,
            executor=run,
            progress=lambda done, of: calls.append((done, of)),
        )
        for run in (None, Threads(3))
    ]
    assert len({(grid, encode(grid_walks)) for grid, grid_walks in results}) == 1
    total = calls[-1][1]
    assert calls == 2 * [(done, total) for done in range(1, total + 1)]


@pytest.mark.parametrize("bound", [{"rmse": 0.3}, {"max_error": 0.6}], ids=["rmse", "maximum"])
def test_a_dense_log_is_learned_in_few_rounds(bound):
    # More samples than a subsample has, and several for each slot.
    track = patrol(14_000, seed=5)
    grid, grid_walks = learn_map([track], no_gaps([track]), **bound, effort=1)
    errors = measured([track], grid, grid_walks)
    assert errors.uncovered == 0
    assert errors.rmse <= bound.get("rmse", np.inf)
    assert errors.max_error <= bound.get("max_error", np.inf)
    again = learn_map([track], no_gaps([track]), **bound, effort=1, executor=Threads(3))
    assert encode(again[1]) == encode(grid_walks)
    assert len(encode(grid_walks)) < 1.15 * len(
        encode(learn_map([track], no_gaps([track]), **bound, effort=2)[1])
    )


@pytest.mark.parametrize("shift", [(1e9, 1e7), (0.0, -3e6)])
def test_a_shifted_log_gives_the_same_walks(town, shift):
    grid, grid_walks = learn_map(town, no_gaps(town), rmse=6.0, effort=1)
    moved = [Track(track.id, track.times + shift[0], track.positions + shift[1]) for track in town]
    moved_grid, moved_walks = learn_map(moved, no_gaps(moved), rmse=6.0, effort=1)
    assert encode(moved_walks) == encode(grid_walks)
    assert (moved_grid.space, moved_grid.time) == (grid.space, grid.time)
    assert moved_grid.epoch - grid.epoch == 1000 * shift[0]
    assert [a - b for a, b in zip(moved_grid.origin, grid.origin, strict=True)] == [
        1000 * shift[1]
    ] * 2


def test_gaps_stay_gaps():
    track = patrol(1500, seed=5)
    times = track.times + 600.0 * (np.arange(1500) >= 700)
    track = Track("a", times, track.positions)
    gap = np.arange(1499) == 699
    grid, grid_walks = learn_map([track], [gap], rmse=0.3, effort=1)
    assert grid_walks.walks[0].gaps.sum() == 1
    assert measured([track], grid, grid_walks).uncovered == 0


def test_more_effort_never_costs_bytes(town):
    sizes = [
        len(encode(learn_map(town, no_gaps(town), rmse=6.0, effort=effort)[1])) for effort in (1, 4)
    ]
    assert sizes[1] <= sizes[0]


def test_progress_counts_up_to_its_end(town):
    calls = []
    learn_map(
        town, no_gaps(town), rmse=6.0, effort=3, progress=lambda done, of: calls.append((done, of))
    )
    assert [done for done, _ in calls] == list(range(1, calls[-1][1] + 1))
    assert len({of for _, of in calls}) == 1


def test_a_map_needs_a_bound(town):
    with pytest.raises(OptionError, match="bound"):
        learn_map(town, no_gaps(town))


@pytest.mark.parametrize("rmse", [0.3, 0.6])
def test_a_log_with_steps_far_below_the_error_is_learned(rmse):
    # 13 samples a second at 0.2 m/s: single steps look like noise, but they add up to a path.
    track = patrol(6000, seed=2)
    grid, walks = learn_map([track], [np.zeros(5999, bool)], rmse=rmse, effort=1)
    assert len(walks.nodes) > 4
    assert step_size(grid.time) < 60


@pytest.mark.parametrize("seed", range(3))
def test_under_a_maximum_knots_can_lie_at_samples_of_whole_seconds(seed):
    # Outliers: only a knot at the very time of a sample comes near enough to it.
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(3.0, 1.0, (400, 2)), axis=0)
    positions[50::60] += 500.0
    grid, _ = learn_map(
        [Track("a", np.arange(400.0), positions)], [np.zeros(399, bool)], max_error=7.0, effort=1
    )
    assert (1 / step_size(grid.time)).is_integer() or step_size(grid.time).is_integer()


@pytest.mark.parametrize("seed", range(2))
def test_the_highest_effort_takes_no_more_bytes_than_the_default(seed):
    track = short_patrol(seed)
    sizes = [
        len(encode(learn_map([track], no_gaps([track]), rmse=0.5, effort=effort)[1]))
        for effort in (5, 9)
    ]
    assert sizes[1] <= sizes[0]
