from dataclasses import replace

import numpy as np
import pytest

from gpszip.mapping import assignment as settling
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
    """Slots of a town's traffic, and a knot with a node of its own at every fifth of them."""
    tracks = [Track(name, *drive) for name, drive in drives(vehicles=12, period=5.0).items()]
    slots = build_time_grid(
        tracks,
        [np.zeros(len(track) - 1, bool) for track in tracks],
        QuantisationGrid((0, 0), 0, 149, 141),
    )
    slot_nodes = np.full(len(slots.time_steps), -1, np.int64)
    slot_nodes[::5] = slot_nodes[slots.first_slots] = slot_nodes[slots.last_slots] = 0
    slot_nodes[slot_nodes >= 0] = np.arange((slot_nodes >= 0).sum())
    return slots, slot_nodes, slots.positions[slot_nodes >= 0].copy()


@pytest.fixture
def small_batches(monkeypatch):
    monkeypatch.setattr(settling, "_ALONE", 300)
    monkeypatch.setattr(settling, "_BATCH_SLOTS", 300)


@pytest.mark.parametrize("turn", range(4))
def test_batches_cover_every_piece_once(town, small_batches, turn):
    slots, slot_nodes, _ = town
    batches = cut_into_batches(slots, slot_nodes, turn)
    stretches = np.concatenate(batches)
    assert len(batches) > 3
    assert max(batch[-1, 1] - batch[0, 0] for batch in batches) < 600
    assert (slot_nodes[stretches[:, :2]] >= 0).all()
    np.testing.assert_array_equal(stretches[stretches[:, 2] == 1, 0], slots.first_slots)
    np.testing.assert_array_equal(stretches[stretches[:, 3] == 1, 1], slots.last_slots)
    inside = stretches[1:, 2] == 0
    np.testing.assert_array_equal(stretches[1:, 0][inside], stretches[:-1, 1][inside])


def test_batches_are_cut_elsewhere_in_the_next_turn(town, small_batches):
    slots, slot_nodes, _ = town
    first, second = (
        {int(batch[0, 0]) for batch in cut_into_batches(slots, slot_nodes, turn)} for turn in (0, 1)
    )
    assert len(first & second) < len(first) / 2


@pytest.mark.parametrize("executor", [Serial(), Threads(1), Threads(2), Threads(3)], ids=str)
def test_the_same_knots_come_out_whoever_settles_them(town, small_batches, executor):
    slots, slot_nodes, positions = town
    bits = estimate_prices(None, 0.3, len(positions))
    expected = assign_knots(slots, slot_nodes, positions, PLAN, bits, 1)
    found = assign_knots(slots, slot_nodes, positions, PLAN, bits, 1, executor=executor)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_knots_that_stay_keep_their_places_and_ends_have_knots(town, small_batches):
    slots, slot_nodes, positions = town
    again, nodes = assign_knots(
        slots, slot_nodes, positions, PLAN, estimate_prices(None, 0.3, len(positions)), 0
    )
    assert (again[slots.first_slots] >= 0).all()
    assert (again[slots.last_slots] >= 0).all()
    assert len(np.unique(again[again >= 0])) == len(nodes) < len(positions)
    # every node is one that was there, or lies where the log is at one of its knots
    old = {tuple(spot) for spot in positions.tolist()}
    fresh = [node for node in range(len(nodes)) if tuple(nodes[node].tolist()) not in old]
    for node in fresh:
        assert (slots.positions[again == node] == nodes[node]).all(axis=1).any()


def test_batches_find_about_as_few_knots_as_one_sweep(town, monkeypatch):
    slots, slot_nodes, positions = town
    counts = []
    for size in (300, 1_000_000):
        monkeypatch.setattr(settling, "_BATCH_SLOTS", size)
        here, nodes = slot_nodes, positions
        for turn in range(4):
            here, nodes = assign_knots(
                slots, here, nodes, PLAN, estimate_prices(None, 0.3, len(nodes)), turn
            )
            nodes = place_nodes(list_segments(slots, here, len(nodes)), nodes)
        counts.append((here >= 0).sum() + len(nodes))
    assert counts[0] < 1.05 * counts[1]


def test_a_draft_without_room_grows(town, small_batches, monkeypatch):
    slots, slot_nodes, positions = town
    bits = estimate_prices(None, 3.0, len(positions))
    expected = assign_knots(slots, slot_nodes, positions, PLAN, bits, 0)
    monkeypatch.setattr(settling, "_SPARE", -40)
    found = assign_knots(slots, slot_nodes, positions, PLAN, bits, 0)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_nodes_that_are_not_used_go_but_the_fixed_ones():
    slot_nodes, positions = drop_unused_nodes(
        np.array([4, -1, 1, 4]), np.arange(10.0).reshape(5, 2), 1
    )
    assert slot_nodes.tolist() == [2, -1, 1, 2]
    assert positions.tolist() == [[0, 1], [2, 3], [8, 9]]


def test_a_narrow_window_leaves_more_knots(town):
    slots, slot_nodes, positions = town
    bits = estimate_prices(None, 0.3, len(positions))
    wide, narrow = (
        assign_knots(slots, slot_nodes, positions, replace(PLAN, max_slots=max_slots), bits, 0)[0]
        for max_slots in (300, 4)
    )
    assert (narrow >= 0).sum() > (wide >= 0).sum()
