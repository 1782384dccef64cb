from dataclasses import replace

import numpy as np
import pytest

from gpszip.mapping import assignment
from gpszip.mapping.assignment import assign_knots, cut_into_batches, drop_unused_nodes
from gpszip.mapping.initial_map import list_segments
from gpszip.mapping.placement import place_nodes
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import estimate_prices
from gpszip.mapping.time_grid import build_time_grid
from gpszip.model import QuantisationGrid, Track
from gpszip.run import Serial, Threads
from gpszip.testing.city import drives

PLAN = Plan(target=1.0)


@pytest.fixture(scope="module")
def town():
    """Time grid of a town's traffic, with a knot and a node at every fifth slot."""
    tracks = [Track(name, *drive) for name, drive in drives(vehicles=12, period=5.0).items()]
    time_grid = build_time_grid(
        tracks,
        [np.zeros(len(track) - 1, bool) for track in tracks],
        QuantisationGrid((0, 0), 0, 149, 141),
    )
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    slot_nodes[::5] = slot_nodes[time_grid.first_slots] = slot_nodes[time_grid.last_slots] = 0
    slot_nodes[slot_nodes >= 0] = np.arange((slot_nodes >= 0).sum())
    return time_grid, slot_nodes, time_grid.positions[slot_nodes >= 0].copy()


@pytest.fixture
def small_batches(monkeypatch):
    monkeypatch.setattr(assignment, "_SINGLE_BATCH_SLOTS", 300)
    monkeypatch.setattr(assignment, "_BATCH_SLOTS", 300)


@pytest.mark.parametrize("turn", range(4))
def test_batches_cover_every_piece_once(town, small_batches, turn):
    time_grid, slot_nodes, _ = town
    batches = cut_into_batches(time_grid, slot_nodes, turn)
    slices = np.concatenate(batches)
    assert len(batches) > 3
    assert max(batch[-1, 1] - batch[0, 0] for batch in batches) < 600
    assert (slot_nodes[slices[:, :2]] >= 0).all()
    np.testing.assert_array_equal(slices[slices[:, 2] == 1, 0], time_grid.first_slots)
    np.testing.assert_array_equal(slices[slices[:, 3] == 1, 1], time_grid.last_slots)
    is_inside = slices[1:, 2] == 0
    np.testing.assert_array_equal(slices[1:, 0][is_inside], slices[:-1, 1][is_inside])


def test_batches_end_elsewhere_in_the_next_turn(town, small_batches):
    time_grid, slot_nodes, _ = town
    first, second = (
        {int(batch[0, 0]) for batch in cut_into_batches(time_grid, slot_nodes, turn)}
        for turn in (0, 1)
    )
    assert len(first & second) < len(first) / 2


@pytest.mark.parametrize("executor", [Serial(), Threads(1), Threads(2), Threads(3)], ids=str)
def test_the_executor_does_not_change_the_knots(town, small_batches, executor):
    time_grid, slot_nodes, positions = town
    prices = estimate_prices(None, 0.3, len(positions))
    expected = assign_knots(time_grid, slot_nodes, positions, PLAN, prices, 1)
    result = assign_knots(time_grid, slot_nodes, positions, PLAN, prices, 1, executor=executor)
    np.testing.assert_array_equal(result[0], expected[0])
    np.testing.assert_array_equal(result[1], expected[1])


def test_old_nodes_stay_where_they_are_and_pieces_end_in_knots(town, small_batches):
    time_grid, slot_nodes, positions = town
    assigned, nodes = assign_knots(
        time_grid, slot_nodes, positions, PLAN, estimate_prices(None, 0.3, len(positions)), 0
    )
    assert (assigned[time_grid.first_slots] >= 0).all()
    assert (assigned[time_grid.last_slots] >= 0).all()
    assert len(np.unique(assigned[assigned >= 0])) == len(nodes) < len(positions)
    # Every node is an old one, or new at the position of the log at one of its knots.
    old_positions = {tuple(position) for position in positions.tolist()}
    new_nodes = [
        node for node in range(len(nodes)) if tuple(nodes[node].tolist()) not in old_positions
    ]
    for node in new_nodes:
        assert (time_grid.positions[assigned == node] == nodes[node]).all(axis=1).any()


def test_batches_find_about_as_few_knots_as_a_single_batch(town, monkeypatch):
    time_grid, slot_nodes, positions = town
    counts = []
    for size in (300, 1_000_000):
        monkeypatch.setattr(assignment, "_BATCH_SLOTS", size)
        monkeypatch.setattr(assignment, "_SINGLE_BATCH_SLOTS", size)
        current, nodes = slot_nodes, positions
        for turn in range(4):
            current, nodes = assign_knots(
                time_grid, current, nodes, PLAN, estimate_prices(None, 0.3, len(nodes)), turn
            )
            nodes = place_nodes(list_segments(time_grid, current, len(nodes)), nodes)
        counts.append((current >= 0).sum() + len(nodes))
    assert counts[0] < 1.05 * counts[1]


def test_a_full_map_gets_more_capacity(town, small_batches, monkeypatch):
    time_grid, slot_nodes, positions = town
    prices = estimate_prices(None, 3.0, len(positions))
    expected = assign_knots(time_grid, slot_nodes, positions, PLAN, prices, 0)
    monkeypatch.setattr(assignment, "_SPARE_NODES", -40)
    result = assign_knots(time_grid, slot_nodes, positions, PLAN, prices, 0)
    np.testing.assert_array_equal(result[0], expected[0])
    np.testing.assert_array_equal(result[1], expected[1])


def test_unused_nodes_are_dropped_but_not_fixed_ones():
    slot_nodes, positions = drop_unused_nodes(
        np.array([4, -1, 1, 4]), np.arange(10.0).reshape(5, 2), 1
    )
    assert slot_nodes.tolist() == [2, -1, 1, 2]
    assert positions.tolist() == [[0, 1], [2, 3], [8, 9]]


def test_shorter_segments_need_more_knots(town):
    time_grid, slot_nodes, positions = town
    prices = estimate_prices(None, 0.3, len(positions))
    wide, narrow = (
        assign_knots(
            time_grid, slot_nodes, positions, replace(PLAN, max_slots=max_slots), prices, 0
        )[0]
        for max_slots in (300, 4)
    )
    assert (narrow >= 0).sum() > (wide >= 0).sum()
