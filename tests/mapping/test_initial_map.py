import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.mapping import initial_map, placement
from gpszip.mapping.initial_map import (
    build_working_map,
    list_segments,
    normal_equations,
    round_positions,
    sample_errors,
    solve_positions,
    squared_error,
    walks_of,
)
from gpszip.mapping.kernels.assign import Prices
from gpszip.mapping.kernels.conjugate_gradients import improve_positions
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import QuantisationGrid, Track


def random_knots(seed, nodes=9, dimension=2):
    """Time grid of two tracks with gaps, and random knots that keep the ends of the pieces."""
    rng = np.random.default_rng(seed)
    tracks, gaps = [], []
    for name in "ab":
        gap = rng.random(119) < 0.03
        times = np.cumsum(rng.integers(1, 900, 120) + 6000 * np.append(False, gap)) / 1000
        tracks.append(Track(name, times, np.cumsum(rng.normal(0, 1, (120, dimension)), axis=0)))
        gaps.append(gap)
    time_grid = build_time_grid(tracks, gaps, QuantisationGrid((0,) * dimension, 0, 112, 132))
    slot_nodes = np.where(rng.random(len(time_grid.time_steps)) < 0.3, 0, -1)
    slot_nodes[time_grid.first_slots] = slot_nodes[time_grid.last_slots] = 0
    slot_nodes[slot_nodes >= 0] = rng.permutation(np.arange((slot_nodes >= 0).sum()) % nodes)
    return time_grid, slot_nodes, rng.normal(0, 20, (nodes, dimension))


def plain_errors(time_grid, slot_nodes, positions):
    """Distance of each sample, one by one."""
    distances = []
    for i, t in enumerate(time_grid.times):
        piece = int((time_grid.ends[time_grid.last_slots] <= i).sum())
        knots = [
            s
            for s in range(time_grid.first_slots[piece], time_grid.last_slots[piece] + 1)
            if slot_nodes[s] >= 0
        ]
        after = next(
            (k for k in range(1, len(knots)) if time_grid.ends[knots[k]] > i), len(knots) - 1
        )
        a, b = knots[after - 1], knots[after]
        share = (t - time_grid.time_steps[a]) / (time_grid.time_steps[b] - time_grid.time_steps[a])
        distances.append(
            float(
                np.linalg.norm(
                    (1 - share) * positions[slot_nodes[a]]
                    + share * positions[slot_nodes[b]]
                    - time_grid.sample_positions[i]
                )
            )
        )
    return distances


@pytest.mark.parametrize("seed", range(4))
def test_errors_are_those_of_each_sample(seed):
    time_grid, slot_nodes, positions = random_knots(seed, dimension=1 + seed % 3)
    segments = list_segments(time_grid, slot_nodes, len(positions))
    errors, segment = sample_errors(time_grid, segments, positions)
    np.testing.assert_allclose(errors, plain_errors(time_grid, slot_nodes, positions), atol=1e-9)
    # The sums are of positions and times in whole ticks.
    assert squared_error(segments, positions) == pytest.approx(float((errors**2).sum()), rel=1e-3)
    assert (np.diff(segment) >= 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_nodes_are_placed_at_least_squared_error(seed):
    time_grid, slot_nodes, positions = random_knots(seed)
    segments = list_segments(time_grid, slot_nodes, len(positions))
    solved = solve_positions(*normal_equations(segments, positions))
    best = squared_error(segments, solved)
    # Least squares over all samples, set up row by row.
    design = np.zeros((time_grid.samples, len(positions)))
    _, segment = sample_errors(time_grid, segments, positions)
    start, end = (
        time_grid.time_steps[segments.first_slots][segment],
        time_grid.time_steps[segments.last_slots][segment],
    )
    share = (time_grid.times - start) / (end - start)
    np.add.at(design, (np.arange(time_grid.samples), segments.starts[segment]), 1 - share)
    np.add.at(design, (np.arange(time_grid.samples), segments.ends[segment]), share)
    expected = np.linalg.lstsq(design, time_grid.sample_positions, rcond=None)[0]
    np.testing.assert_allclose(solved, expected, atol=0.05)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        assert squared_error(segments, solved + rng.normal(0, 0.3, solved.shape)) > best


@pytest.mark.parametrize("seed", range(4))
def test_rounded_positions_are_no_worse_than_each_rounded(seed):
    time_grid, slot_nodes, positions = random_knots(seed)
    segments = list_segments(time_grid, slot_nodes, len(positions))
    system = normal_equations(segments, positions)
    solved = solve_positions(*system)
    rounded = round_positions(*system, solved)
    np.testing.assert_array_equal(rounded, np.rint(rounded))
    assert squared_error(segments, rounded) <= squared_error(segments, np.rint(solved)) + 1e-6


def test_a_node_without_samples_stays_where_it_is():
    time_grid, slot_nodes, positions = random_knots(1)
    positions = np.vstack([positions, [[77.0, -5.0]]])
    solved = solve_positions(
        *normal_equations(list_segments(time_grid, slot_nodes, len(positions)), positions)
    )
    np.testing.assert_allclose(solved[-1], [77.0, -5.0])


@pytest.mark.parametrize("seed", range(4))
def test_few_nodes_are_placed_as_many_are(seed, monkeypatch):
    fixed, nodes = 2 * (seed % 2), 9
    time_grid, slot_nodes, positions = random_knots(seed, nodes)
    prices = Prices(*range(1, 11))
    plan = Plan(target=8.0)

    def place(limit):
        monkeypatch.setattr(initial_map, "MAX_DENSE_NODES", limit)
        monkeypatch.setattr(placement, "MAX_DENSE_NODES", limit)
        segments = list_segments(time_grid, slot_nodes, nodes)
        placed = placement.place_nodes(segments, positions, fixed)
        rounded = placement.place_on_grid(segments, placed, fixed)
        merged, _, kept = placement.merge_nodes(slot_nodes, segments, placed, plan, prices, fixed)
        return placed, rounded, merged, kept

    dense, sparse = place(nodes), place(0)
    for one, other in zip(dense, sparse, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_many_nodes_are_placed_step_by_step_as_few_are_at_once(seed, monkeypatch):
    time_grid, slot_nodes, positions = random_knots(seed, 30, dimension=1 + seed % 3)
    segments = list_segments(time_grid, slot_nodes, 30)
    direct = solve_positions(*normal_equations(segments, positions))

    monkeypatch.setattr(initial_map, "MAX_DENSE_NODES", 0)
    monkeypatch.setattr(initial_map, "_MAX_DIRECT_NODES", 0)
    segments = list_segments(time_grid, slot_nodes, 30)
    start = positions + np.random.default_rng(seed).normal(0, 5, positions.shape)
    unchanged = start.copy()
    stepwise = solve_positions(*normal_equations(segments, positions), start)
    np.testing.assert_allclose(stepwise, direct, atol=0.02)
    np.testing.assert_array_equal(start, unchanged)
    assert abs(stepwise - start).max() > 1


def many_knots(seed, nodes, dimension):
    """As :func:`random_knots`, of longer tracks whose nodes follow each other at random."""
    rng = np.random.default_rng(seed)
    tracks = [
        Track(
            name,
            np.cumsum(rng.integers(1, 900, 6000)) / 1000,
            np.cumsum(rng.normal(0, 1, (6000, dimension)), axis=0),
        )
        for name in "ab"
    ]
    gaps = [np.zeros(5999, bool)] * 2
    time_grid = build_time_grid(tracks, gaps, QuantisationGrid((0,) * dimension, 0, 112, 132))
    slot_nodes = np.where(rng.random(len(time_grid.time_steps)) < 0.5, 0, -1)
    slot_nodes[time_grid.first_slots] = slot_nodes[time_grid.last_slots] = 0
    knots = int((slot_nodes >= 0).sum())
    slot_nodes[slot_nodes >= 0] = rng.permutation(np.arange(knots) % nodes)
    return time_grid, slot_nodes, rng.normal(0, 20, (nodes, dimension))


@pytest.mark.parametrize(("fixed", "dimension"), [(0, 1), (0, 2), (70, 2), (70, 3)])
def test_more_than_a_thousand_nodes_are_placed_as_the_direct_solution(
    fixed, dimension, monkeypatch
):
    time_grid, slot_nodes, positions = many_knots(fixed, 1200, dimension)
    segments = list_segments(time_grid, slot_nodes, len(positions))
    placed = placement.place_nodes(segments, positions, fixed)

    monkeypatch.setattr(initial_map, "_MAX_DIRECT_NODES", len(positions))
    direct = placement.place_nodes(segments, positions, fixed)
    np.testing.assert_allclose(placed, direct, atol=0.01)
    np.testing.assert_array_equal(placed[:fixed], positions[:fixed])
    # They were placed in two ways.
    assert (placed != direct).any()


@pytest.mark.parametrize("seed", range(3))
def test_nodes_placed_in_too_few_steps_have_less_error_than_at_the_start(seed, monkeypatch):
    # Nodes in a row take about twenty steps.
    time_grid, slot_nodes, _ = many_knots(seed, 1200, 2)
    knots = int((slot_nodes >= 0).sum())
    slot_nodes[slot_nodes >= 0] = np.arange(knots)
    segments = list_segments(time_grid, slot_nodes, knots)
    start = time_grid.positions[slot_nodes >= 0] + 30.0

    errors = [squared_error(segments, start)]
    for steps in (1, 2, 5, 10):
        monkeypatch.setattr(initial_map, "_MAX_STEPS", steps)
        errors.append(squared_error(segments, placement.place_nodes(segments, start)))
    assert (np.diff(errors) < 0).all()


def test_kernels_take_matrices_of_few_and_many_nodes_alike(monkeypatch):
    time_grid, slot_nodes, positions = random_knots(0)
    systems = []
    for limit in (len(positions), 0):
        monkeypatch.setattr(initial_map, "MAX_DENSE_NODES", limit)
        segments = list_segments(time_grid, slot_nodes, len(positions))
        stiffness, right = normal_equations(segments, positions)
        systems.append((type(stiffness), *initial_map._compress_rows(stiffness), right))
    (dense, *few), (sparse, *many) = systems
    assert dense is not sparse
    for one, other in zip(few, many, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other)


def random_system(nodes, seed):
    """A sparse symmetric positive definite matrix, and a right-hand side."""
    rng = np.random.default_rng(seed)
    factor = np.where(rng.random((nodes, nodes)) < 0.2, rng.normal(size=(nodes, nodes)), 0.0)
    matrix = factor @ factor.T + np.diag(rng.uniform(0.5, 2.0, nodes))
    return matrix, rng.normal(0, 9, (nodes, 2))


@given(nodes=st.integers(1, 25), seed=st.integers(0, 999))
def test_steps_lead_to_the_solution_and_stop_near_it(nodes, seed):
    matrix, right = random_system(nodes, seed)
    rows, columns = np.nonzero(matrix)
    offsets = np.searchsorted(rows, np.arange(nodes + 1)).astype(np.int32)
    system = offsets, columns.astype(np.int32), matrix[rows, columns], right

    def improve(start, tolerance, steps):
        positions = start.copy()
        improve_positions(*system, positions, tolerance, steps)
        return positions

    # In exact arithmetic, as many steps as there are nodes lead to the solution.
    solution = np.linalg.solve(matrix, right)
    start = np.zeros((nodes, 2))
    np.testing.assert_allclose(improve(start, 1e-10, 4 * nodes), solution, atol=1e-5)

    # Each step brings x'Kx - 2 x'r down, and none is taken within the tolerance.
    def energy(x):
        return np.sum(x * (matrix @ x) - 2 * x * right)

    energies = [energy(improve(start, 1e-10, steps)) for steps in range(nodes + 1)]
    assert (np.diff(energies) <= 1e-6).all()
    np.testing.assert_array_equal(improve(solution + 1e-5, 1e-2, 9), solution + 1e-5)


def test_walks_have_the_knots_of_each_track_and_gaps_between_pieces():
    time_grid, slot_nodes, positions = random_knots(3)
    walks = walks_of(time_grid, slot_nodes, np.rint(positions), 2)
    for track, walk in enumerate(walks.walks):
        knots_expected, gaps = [], []
        for piece in np.flatnonzero(time_grid.piece_tracks == track):
            piece_knots = [
                s
                for s in range(time_grid.first_slots[piece], time_grid.last_slots[piece] + 1)
                if slot_nodes[s] >= 0
            ]
            gaps += [bool(knots_expected)] * (len(knots_expected) > 0) + [False] * (
                len(piece_knots) - 1
            )
            knots_expected += piece_knots
        np.testing.assert_array_equal(walk.time_steps, time_grid.time_steps[knots_expected])
        np.testing.assert_array_equal(
            walks.nodes[walk.nodes], np.rint(positions)[slot_nodes[knots_expected]]
        )
        assert walk.gaps.tolist() == gaps
    assert any(walk.gaps.any() for walk in walks.walks)


def test_a_working_map_counts_the_knots_of_its_walks():
    time_grid, slot_nodes, positions = random_knots(2)
    working_map = build_working_map(time_grid, slot_nodes, positions, 3.0, 50)
    np.testing.assert_array_equal(
        working_map.uses[:9], np.bincount(slot_nodes[slot_nodes >= 0], minlength=9)
    )
    segments = list_segments(time_grid, slot_nodes, len(positions))
    moving = segments.starts != segments.ends
    outgoing = np.bincount(segments.starts[moving], minlength=9) + 0.5 * np.bincount(
        segments.ends[moving], minlength=9
    )
    np.testing.assert_array_equal(working_map.outgoing_weight[:9], outgoing)


def test_relabelled_segments_are_those_of_relabelled_knots():
    time_grid, slot_nodes, positions = random_knots(5)
    merged = np.where(slot_nodes > 4, 4, slot_nodes)
    renamed, listed = (
        list_segments(time_grid, slot_nodes, len(positions)).relabelled(merged, 5),
        list_segments(time_grid, merged, 5),
    )
    for field in ("first_slots", "last_slots", "starts", "ends", "moments", "centers"):
        np.testing.assert_array_equal(getattr(renamed, field), getattr(listed, field))
    np.testing.assert_array_equal(renamed.stiffness, listed.stiffness)
