import numpy as np
import pytest

from calling import from_python
from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode
from gpszip.mapping.budgets import ErrorBudgets
from gpszip.mapping.initial_map import list_segments, sample_errors
from gpszip.mapping.kernels.local_search_moves import MOVE_COUNT, list_moves
from gpszip.mapping.kernels.local_search_nodes import _added_error
from gpszip.mapping.kernels.local_search_state import KNOTS, SQUARE, replace_knots
from gpszip.mapping.local_search import (
    _assign_slots,
    _build_state,
    improve_walks,
    select_best_outcomes,
)
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.rounds import fit as learn
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import GridWalk, GridWalks, QuantisationGrid, Track
from gpszip.model.grid import step_index, step_size
from gpszip.testing import patrol
from gpszip.testing.city import drives
from gpszip.walks.error import measure_errors
from gpszip.walks.quantised import dequantise_walks, node_positions

# Inner kernels, as Python calls them.
list_moves = from_python(list_moves)
replace_knots = from_python(replace_knots)
_added_error = from_python(_added_error)

RMSE = 0.5
WORK = 60_000


def grid_for(rmse, seconds):
    return QuantisationGrid((0, 0), 0, step_index(1.2 * rmse), step_index(seconds))


def build_grid(dimension=2):
    flat = grid_for(RMSE, 1.6)
    return QuantisationGrid((0,) * dimension, 0, flat.space, flat.time)


def with_dimension(track, dimension):
    """The track in another dimension, by leaving out or adding an axis."""
    if dimension == 2:
        return track
    height = np.sin(track.times / 40)[:, None] * 6
    positions = (
        track.positions[:, :1]
        if dimension == 1
        else np.concatenate([track.positions, height], axis=1)
    )
    return Track(track.id, track.times, positions)


@pytest.fixture(scope="module")
def day():
    log = patrol(32000, seed=3)
    return Track("0", log.times[::16], log.positions[::16])


def build_log(kind, day):
    """Tracks, gaps and grid of one kind of log."""
    dimension = {"1-D": 1, "3-D": 3}.get(kind, 2)
    day = with_dimension(day, dimension)
    tracks = [day]
    if kind == "tracks":
        tracks = [
            Track(str(i), day.times[a : a + 600], day.positions[a : a + 600])
            for i, a in enumerate((0, 700, 1400))
        ]
    gaps = [np.zeros(len(track) - 1, bool) for track in tracks]
    if kind == "gaps":
        times = day.times.copy()
        times[800:] += 300
        times[1500:] += 900
        tracks = [Track("0", times, day.positions)]
        gaps[0][[799, 1499]] = True
    return tracks, gaps, build_grid(dimension)


def measured(tracks, walks, grid):
    return measure_errors(
        tracks,
        dequantise_walks(walks, grid, [track.id for track in tracks]),
        node_positions(walks, grid),
    )


@pytest.mark.parametrize("kind", ["plain", "gaps", "tracks", "1-D", "3-D"])
def test_improved_walks_are_smaller_and_keep_the_bound(kind, day):
    tracks, gaps, grid = build_log(kind, day)
    time_grid, unit = build_time_grid(tracks, gaps, grid), step_size(grid.space)
    first = learn(time_grid, len(tracks), Plan(target=0.9995 * RMSE / unit, rounds=6))
    improved = improve_walks(time_grid, first, target=RMSE / unit, work=WORK)
    data = encode(improved.walks)
    read = decode(data, len(grid.origin), len(tracks))
    errors = measured(tracks, read, grid)
    assert len(data) == improved.size < first.size
    assert errors.rmse == pytest.approx(improved.error * unit)
    assert errors.rmse <= RMSE
    assert errors.uncovered == 0
    assert [walk.gaps.sum() for walk in read.walks] == [gap.sum() for gap in gaps]


def test_the_same_walks_give_the_same_bytes(day):
    tracks, gaps, grid = build_log("plain", day)
    time_grid, target = build_time_grid(tracks, gaps, grid), RMSE / step_size(grid.space)
    first = learn(time_grid, 1, Plan(target=target, rounds=6))
    first_run, second_run = (
        improve_walks(time_grid, first, target=target, work=WORK) for _ in range(2)
    )
    assert encode(first_run.walks) == encode(second_run.walks)


def test_a_maximum_is_kept(day):
    tracks, gaps, grid = build_log("plain", day)
    time_grid, unit = build_time_grid(tracks, gaps, grid), step_size(grid.space)
    first = learn(time_grid, 1, Plan(target=RMSE / unit, rounds=6))
    most = measured(tracks, first.walks, grid).max_error
    improved = improve_walks(time_grid, first, maximum=most / unit, work=WORK)
    assert improved.size < first.size
    assert measured(tracks, decode(encode(improved.walks), 2, 1), grid).max_error <= most * (
        1 + 1e-9
    )


def test_nodes_of_prior_walks_stay(day):
    grid = build_grid()
    early, late = (
        [Track(name, day.times[part], day.positions[part])]
        for name, part in (("a", slice(1000)), ("b", slice(1000, None)))
    )
    no_gaps = [np.zeros(999, bool)]
    target = RMSE / step_size(grid.space)
    prior = Prior(
        learn(build_time_grid(early, no_gaps, grid), 1, Plan(target=target, rounds=4)).walks
    )
    time_grid = build_time_grid(late, no_gaps, grid)
    first = learn(time_grid, 1, Plan(target=target, rounds=4), prior=prior)
    improved = improve_walks(time_grid, first, target=target, prior=prior, work=WORK)
    data = encode(improved.walks, prior)
    read = decode(data, 2, 1, prior)
    assert len(data) == improved.size < first.size
    assert read.nodes[: prior.nodes].tolist() == prior.walks.nodes.tolist()
    assert measured(late, read, grid).rmse <= RMSE


def test_walks_that_cannot_be_improved_are_returned(day):
    tracks, gaps, grid = build_log("plain", day)
    time_grid, target = build_time_grid(tracks, gaps, grid), RMSE / step_size(grid.space)
    first = learn(time_grid, 1, Plan(target=target, rounds=6))
    missing = Outcome(first.walks, first.size, first.error, 2)
    beside = Outcome(
        GridWalks(first.walks.nodes, (GridWalk(*trimmed(first.walks.walks[0])),)),
        first.size,
        first.error,
    )
    assert improve_walks(time_grid, missing, target=target) is missing
    assert improve_walks(time_grid, beside, target=target) is beside
    assert improve_walks(time_grid, first, target=target, work=0) is first
    assert improve_walks(time_grid, first, target=first.error / 2, work=WORK) is first


def trimmed(walk):
    return walk.nodes[1:], walk.time_steps[1:], walk.gaps[1:]


def test_the_smallest_distinct_outcomes_are_selected():
    walk = GridWalk(np.zeros(80, np.int32), np.arange(80), np.zeros(79, bool))
    outcomes = [
        Outcome(GridWalks(np.zeros((1, 2), np.int64), (walk,)), size, 1.0)
        for size in (9, 7, 7, 8, 10)
    ]
    assert [outcome.size for outcome in select_best_outcomes(outcomes, 6)] == [7, 8, 9]
    assert [outcome.size for outcome in select_best_outcomes(outcomes, 1)] == [7]
    assert select_best_outcomes([], 5) == []


@pytest.mark.parametrize("kind", ["plain", "gaps", "3-D"])
def test_moves_add_the_errors_of_the_samples(kind, day):
    tracks, gaps, grid = build_log(kind, day)
    time_grid = build_time_grid(tracks, gaps, grid)
    walks = learn(time_grid, 1, Plan(target=RMSE / step_size(grid.space), rounds=6)).walks
    state = _build_state(time_grid, _assign_slots(time_grid, walks), walks, None, WORK)
    knot_list, moves = state.knot_list, state.moves
    moves = moves._replace(max_extra_bits=20.0)
    seen = set()
    for j in range(0, int(knot_list.counts[KNOTS]), 3):
        list_moves(state.samples, knot_list, state.prior_edges, moves, 0, j, 0.1)
        for row in range(int(moves.counts[MOVE_COUNT])):
            other = type(knot_list)(*(array.copy() for array in knot_list))
            old, count = sample_squares(time_grid, knot_list), int(moves.count[row])
            assert replace_knots(
                state.samples,
                other,
                0,
                moves.first[row],
                moves.after[row],
                moves.count[row],
                moves.slots[row],
                moves.nodes[row],
            )
            # The sums count in whole ticks.
            assert sample_squares(time_grid, other) - old == pytest.approx(
                moves.errors[row], rel=2e-2, abs=0.5
            )
            assert other.totals[SQUARE] - knot_list.totals[SQUARE] == pytest.approx(
                moves.errors[row], rel=1e-6, abs=1e-5
            )
            seen.add((int(moves.after[row] - moves.first[row]), count))
    # Knots are shifted or relabelled; removed; merged; inserted.
    assert {(1, 1), (3, 2), (2, 1), (0, 1)} <= seen


def test_a_shifted_node_adds_the_errors_of_the_samples(day):
    tracks, gaps, grid = build_log("gaps", day)
    time_grid = build_time_grid(tracks, gaps, grid)
    walks = learn(time_grid, 1, Plan(target=RMSE / step_size(grid.space), rounds=6)).walks
    knot_list = (
        state := _build_state(time_grid, _assign_slots(time_grid, walks), walks, None, WORK)
    ).knot_list
    used = int(knot_list.counts[KNOTS])
    for node in range(0, len(walks.nodes), 3):
        knots = np.flatnonzero(knot_list.nodes[:used] == node)
        other = type(knot_list)(*(array.copy() for array in knot_list))
        other.positions[node] += (1, -2)
        added = _added_error(
            state.samples, knot_list, node, other.positions[node], knots, len(knots)
        )
        assert sample_squares(time_grid, other) - sample_squares(
            time_grid, knot_list
        ) == pytest.approx(added, rel=1e-2, abs=0.5)


def sample_squares(time_grid, knot_list):
    """Squared error of all segments, sample by sample."""
    used = int(knot_list.counts[KNOTS])
    total = 0.0
    for a, b in zip(range(used - 1), range(1, used), strict=True):
        if knot_list.joined[b]:
            p, q = knot_list.slots[a], knot_list.slots[b]
            inside = slice(time_grid.ends[p], time_grid.ends[q])
            share = (time_grid.times[inside] - time_grid.time_steps[p]) / (
                time_grid.time_steps[q] - time_grid.time_steps[p]
            )
            start, end = (
                knot_list.positions[knot_list.nodes[a]],
                knot_list.positions[knot_list.nodes[b]],
            )
            total += (
                (start + share[:, None] * (end - start) - time_grid.sample_positions[inside]) ** 2
            ).sum()
    return total


def test_the_error_allowed_is_used_up():
    tracks = [
        Track(name, *drive)
        for name, drive in drives(blocks=4, vehicles=6, period=15.0, seed=2).items()
    ]
    grid = QuantisationGrid((0, 0), 0, step_index(9.6), step_index(2.2))
    time_grid, unit = (
        build_time_grid(tracks, [np.zeros(len(track) - 1, bool) for track in tracks], grid),
        step_size(grid.space),
    )
    first = learn(time_grid, len(tracks), Plan(target=7.2 / unit, rounds=12))
    improved = improve_walks(time_grid, first, target=8.0 / unit, work=WORK)
    assert improved.size < first.size
    assert 0.985 * 8.0 < improved.error * unit <= 8.0


def group_errors(time_grid, walks, groups):
    """Root mean square error of each group, in grid steps, sample by sample."""
    slot_nodes = _assign_slots(time_grid, walks)
    errors, _ = sample_errors(
        time_grid, list_segments(time_grid, slot_nodes, len(walks.nodes)), walks.nodes.astype(float)
    )
    return np.sqrt(np.bincount(groups, weights=errors**2) / np.bincount(groups))


def test_each_group_keeps_its_error_budget(day):
    tracks, gaps, grid = build_log("tracks", day)
    time_grid, unit = build_time_grid(tracks, gaps, grid), step_size(grid.space)
    groups = np.repeat([0, 0, 1], [len(track) for track in tracks])
    first = learn(time_grid, len(tracks), Plan(target=0.9995 * RMSE / unit, rounds=6))
    allowed = group_errors(time_grid, first.walks, groups) * [0.9, 1.3]
    improved = improve_walks(time_grid, first, budgets=ErrorBudgets(groups, allowed), work=WORK)
    errors = group_errors(time_grid, improved.walks, groups)
    assert (errors <= allowed).all()
    assert errors[1] > allowed[1] / 1.3
    again = improve_walks(time_grid, improved, budgets=ErrorBudgets(groups, allowed), work=WORK)
    assert again.size <= improved.size < 1.1 * first.size


def test_walks_are_returned_where_no_budget_can_be_kept(day):
    tracks, gaps, grid = build_log("tracks", day)
    time_grid = build_time_grid(tracks, gaps, grid)
    first = learn(time_grid, len(tracks), Plan(target=RMSE / step_size(grid.space), rounds=6))
    groups = np.repeat([0, 1, 1], [len(track) for track in tracks])
    assert (
        improve_walks(
            time_grid, first, budgets=ErrorBudgets(groups, np.array([1e-3, 1.0])), work=WORK // 10
        )
        is first
    )
