import numpy as np
import pytest

from gpszip.codec.prior import Prior
from gpszip.codec.walks import decode, encode
from gpszip.mapping.budgets import ErrorBudgets
from gpszip.mapping.initial_map import list_segments, sample_errors
from gpszip.mapping.kernels.local_search_moves import list_moves
from gpszip.mapping.kernels.local_search_nodes import _error_at
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

RMSE = 0.5
WORK = 60_000


def frame_for(rmse, seconds):
    return QuantisationGrid((0, 0), 0, step_index(1.2 * rmse), step_index(seconds))


def grid_walks(dimension=2):
    flat = frame_for(RMSE, 1.6)
    return QuantisationGrid((0,) * dimension, 0, flat.space, flat.time)


def raised(track, dimension):
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
    whole = patrol(32000, seed=3)
    return Track("0", whole.times[::16], whole.positions[::16])


def setting(kind, day):
    """Tracks, gaps and lattice of one kind of log."""
    dimension = {"1-D": 1, "3-D": 3}.get(kind, 2)
    day = raised(day, dimension)
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
    return tracks, gaps, grid_walks(dimension)


def measured(tracks, walks, grid):
    return measure_errors(
        tracks,
        dequantise_walks(walks, grid, [track.id for track in tracks]),
        node_positions(walks, grid),
    )


@pytest.mark.parametrize("kind", ["plain", "gaps", "tracks", "1-D", "3-D"])
def test_polished_walks_are_smaller_within_the_bound_and_what_they_say(kind, day):
    tracks, gaps, grid = setting(kind, day)
    slots, unit = build_time_grid(tracks, gaps, grid), step_size(grid.space)
    first = learn(slots, len(tracks), Plan(target=0.9995 * RMSE / unit, rounds=6))
    polished = improve_walks(slots, first, target=RMSE / unit, work=WORK)
    data = encode(polished.walks)
    read = decode(data, len(grid.origin), len(tracks))
    found = measured(tracks, read, grid)
    assert len(data) == polished.size < first.size
    assert found.rmse == pytest.approx(polished.error * unit)
    assert found.rmse <= RMSE
    assert found.uncovered == 0
    assert [walk.gaps.sum() for walk in read.walks] == [gap.sum() for gap in gaps]


def test_polishing_twice_gives_the_same_bytes(day):
    tracks, gaps, grid = setting("plain", day)
    slots, target = build_time_grid(tracks, gaps, grid), RMSE / step_size(grid.space)
    first = learn(slots, 1, Plan(target=target, rounds=6))
    one, two = (improve_walks(slots, first, target=target, work=WORK) for _ in range(2))
    assert encode(one.walks) == encode(two.walks)


def test_a_maximum_is_kept(day):
    tracks, gaps, grid = setting("plain", day)
    slots, unit = build_time_grid(tracks, gaps, grid), step_size(grid.space)
    first = learn(slots, 1, Plan(target=RMSE / unit, rounds=6))
    most = measured(tracks, first.walks, grid).max_error
    polished = improve_walks(slots, first, maximum=most / unit, work=WORK)
    assert polished.size < first.size
    assert measured(tracks, decode(encode(polished.walks), 2, 1), grid).max_error <= most * (
        1 + 1e-9
    )


def test_on_a_known_map_its_nodes_stay(day):
    grid = grid_walks()
    early, late = (
        [Track(name, day.times[part], day.positions[part])]
        for name, part in (("a", slice(1000)), ("b", slice(1000, None)))
    )
    none = [np.zeros(999, bool)]
    target = RMSE / step_size(grid.space)
    past = Prior(learn(build_time_grid(early, none, grid), 1, Plan(target=target, rounds=4)).walks)
    slots = build_time_grid(late, none, grid)
    first = learn(slots, 1, Plan(target=target, rounds=4), known=past)
    polished = improve_walks(slots, first, target=target, known=past, work=WORK)
    data = encode(polished.walks, past)
    read = decode(data, 2, 1, past)
    assert len(data) == polished.size < first.size
    assert read.nodes[: past.nodes].tolist() == past.walks.nodes.tolist()
    assert measured(late, read, grid).rmse <= RMSE


def test_what_can_not_be_polished_comes_back_as_it_is(day):
    tracks, gaps, grid = setting("plain", day)
    slots, target = build_time_grid(tracks, gaps, grid), RMSE / step_size(grid.space)
    first = learn(slots, 1, Plan(target=target, rounds=6))
    missing = Outcome(first.walks, first.size, first.error, 2)
    beside = Outcome(
        GridWalks(first.walks.nodes, (GridWalk(*trimmed(first.walks.walks[0])),)),
        first.size,
        first.error,
    )
    assert improve_walks(slots, missing, target=target) is missing
    assert improve_walks(slots, beside, target=target) is beside
    assert improve_walks(slots, first, target=target, work=0) is first
    assert improve_walks(slots, first, target=first.error / 2, work=WORK) is first


def trimmed(walk):
    return walk.nodes[1:], walk.time_steps[1:], walk.gaps[1:]


def test_the_smallest_outcomes_are_polished_each_once():
    walk = GridWalk(np.zeros(80, np.int32), np.arange(80), np.zeros(79, bool))
    outcomes = [
        Outcome(GridWalks(np.zeros((1, 2), np.int64), (walk,)), size, 1.0)
        for size in (9, 7, 7, 8, 10)
    ]
    assert [one.size for one in select_best_outcomes(outcomes, 6)] == [7, 8, 9, 10]
    assert [one.size for one in select_best_outcomes(outcomes, 1)] == [7]
    assert select_best_outcomes([], 5) == []


@pytest.mark.parametrize("kind", ["plain", "gaps", "3-D"])
def test_added_errors_are_those_of_the_samples(kind, day):
    tracks, gaps, grid = setting(kind, day)
    slots = build_time_grid(tracks, gaps, grid)
    walks = learn(slots, 1, Plan(target=RMSE / step_size(grid.space), rounds=6)).walks
    state = _build_state(slots, _assign_slots(slots, walks), walks, None, WORK)
    knot_list, moves = state.knot_list, state.moves
    moves.terms[0] = 20.0
    seen = set()
    for j in range(0, int(knot_list.counts[KNOTS]), 3):
        list_moves(state.samples, knot_list, state.prior_edges, moves, 0, j, 0.1)
        for row in range(int(moves.filled[0])):
            other = type(knot_list)(*(array.copy() for array in knot_list))
            old, count = exact(slots, knot_list), int(moves.count[row])
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
            assert exact(slots, other) - old == pytest.approx(
                moves.error[row], rel=2e-2, abs=0.5
            )  # the sums count in whole ticks
            assert other.totals[SQUARE] - knot_list.totals[SQUARE] == pytest.approx(
                moves.error[row], rel=1e-6, abs=1e-5
            )
            seen.add((int(moves.after[row] - moves.first[row]), count))
    # moved or given another node; left out; two made one; another put between
    assert {(1, 1), (3, 2), (2, 1), (0, 1)} <= seen


def test_the_error_of_a_moved_node_is_that_of_the_samples(day):
    tracks, gaps, grid = setting("gaps", day)
    slots = build_time_grid(tracks, gaps, grid)
    walks = learn(slots, 1, Plan(target=RMSE / step_size(grid.space), rounds=6)).walks
    knot_list = (
        state := _build_state(slots, _assign_slots(slots, walks), walks, None, WORK)
    ).knot_list
    used = int(knot_list.counts[KNOTS])
    for node in range(0, len(walks.nodes), 3):
        knots = np.flatnonzero(knot_list.node[:used] == node)
        other = type(knot_list)(*(array.copy() for array in knot_list))
        other.places[node] += (1, -2)
        added = _error_at(state.samples, knot_list, node, other.places[node], knots, len(knots))
        assert exact(slots, other) - exact(slots, knot_list) == pytest.approx(
            added, rel=1e-2, abs=0.5
        )


def exact(slots, knot_list):
    """Squared error of a chain from the samples themselves, without any sums."""
    used = int(knot_list.counts[KNOTS])
    total = 0.0
    for a, b in zip(range(used - 1), range(1, used), strict=True):
        if knot_list.joined[b]:
            p, q = knot_list.slot[a], knot_list.slot[b]
            inside = slice(slots.ends[p], slots.ends[q])
            share = (slots.times[inside] - slots.time_steps[p]) / (
                slots.time_steps[q] - slots.time_steps[p]
            )
            start, end = knot_list.places[knot_list.node[a]], knot_list.places[knot_list.node[b]]
            total += (
                (start + share[:, None] * (end - start) - slots.sample_positions[inside]) ** 2
            ).sum()
    return total


def test_what_is_left_of_the_error_allowed_is_made_use_of():
    tracks = [
        Track(name, *drive)
        for name, drive in drives(blocks=4, vehicles=6, period=15.0, seed=2).items()
    ]
    grid = QuantisationGrid((0, 0), 0, step_index(9.6), step_index(2.2))
    slots, unit = (
        build_time_grid(tracks, [np.zeros(len(track) - 1, bool) for track in tracks], grid),
        step_size(grid.space),
    )
    first = learn(slots, len(tracks), Plan(target=7.2 / unit, rounds=12))
    polished = improve_walks(slots, first, target=8.0 / unit, work=WORK)
    assert polished.size < first.size
    assert 0.985 * 8.0 < polished.error * unit <= 8.0


def share_of(slots, walks, groups):
    """Root mean square error of each group, in quanta, sample by sample."""
    at = _assign_slots(slots, walks)
    errors, _ = sample_errors(
        slots, list_segments(slots, at, len(walks.nodes)), walks.nodes.astype(float)
    )
    return np.sqrt(np.bincount(groups, weights=errors**2) / np.bincount(groups))


def test_each_group_keeps_to_an_error_of_its_own(day):
    tracks, gaps, grid = setting("tracks", day)
    slots, unit = build_time_grid(tracks, gaps, grid), step_size(grid.space)
    groups = np.repeat([0, 0, 1], [len(track) for track in tracks])
    first = learn(slots, len(tracks), Plan(target=0.9995 * RMSE / unit, rounds=6))
    allowed = share_of(slots, first.walks, groups) * [0.9, 1.3]
    polished = improve_walks(slots, first, budgets=ErrorBudgets(groups, allowed), work=WORK)
    found = share_of(slots, polished.walks, groups)
    assert (found <= allowed).all()
    assert found[1] > allowed[1] / 1.3
    again = improve_walks(slots, polished, budgets=ErrorBudgets(groups, allowed), work=WORK)
    assert again.size <= polished.size < 1.1 * first.size


def test_walks_are_given_back_where_no_share_can_be_kept(day):
    tracks, gaps, grid = setting("tracks", day)
    slots = build_time_grid(tracks, gaps, grid)
    first = learn(slots, len(tracks), Plan(target=RMSE / step_size(grid.space), rounds=6))
    groups = np.repeat([0, 1, 1], [len(track) for track in tracks])
    assert (
        improve_walks(
            slots, first, budgets=ErrorBudgets(groups, np.array([1e-3, 1.0])), work=WORK // 10
        )
        is first
    )
