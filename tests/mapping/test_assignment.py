from dataclasses import replace

import numpy as np
import pytest

from gpszip.mapping import assignment as settling
from gpszip.mapping.assignment import compact, cut_pieces, settle
from gpszip.mapping.initial_map import list_parts
from gpszip.mapping.placement import place
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import prices_of
from gpszip.mapping.time_grid import lay_slots
from gpszip.model import Frame, Track
from gpszip.run import Serial, Threads
from gpszip.testing.city import drives

PLAN = Plan(target=1.0)


@pytest.fixture(scope="module")
def town():
    """Slots of a town's traffic, and a knot with a node of its own at every fifth of them."""
    tracks = [Track(name, *drive) for name, drive in drives(vehicles=12, period=5.0).items()]
    slots = lay_slots(tracks, [np.zeros(len(track) - 1, bool) for track in tracks], Frame((0, 0), 0, 149, 141))
    at = np.full(len(slots.cells), -1, np.int64)
    at[::5] = at[slots.firsts] = at[slots.lasts] = 0
    at[at >= 0] = np.arange((at >= 0).sum())
    return slots, at, slots.places[at >= 0].copy()


@pytest.fixture
def small_batches(monkeypatch):
    monkeypatch.setattr(settling, "_ALONE", 300)
    monkeypatch.setattr(settling, "_BATCH_SLOTS", 300)


@pytest.mark.parametrize("turn", range(4))
def test_batches_cover_every_piece_once(town, small_batches, turn):
    slots, at, _ = town
    batches = cut_pieces(slots, at, turn)
    stretches = np.concatenate(batches)
    assert len(batches) > 3
    assert max(batch[-1, 1] - batch[0, 0] for batch in batches) < 600
    assert (at[stretches[:, :2]] >= 0).all()
    np.testing.assert_array_equal(stretches[stretches[:, 2] == 1, 0], slots.firsts)
    np.testing.assert_array_equal(stretches[stretches[:, 3] == 1, 1], slots.lasts)
    inside = stretches[1:, 2] == 0
    np.testing.assert_array_equal(stretches[1:, 0][inside], stretches[:-1, 1][inside])


def test_batches_are_cut_elsewhere_in_the_next_turn(town, small_batches):
    slots, at, _ = town
    first, second = ({int(batch[0, 0]) for batch in cut_pieces(slots, at, turn)} for turn in (0, 1))
    assert len(first & second) < len(first) / 2


@pytest.mark.parametrize("executor", [Serial(), Threads(1), Threads(2), Threads(3)], ids=str)
def test_the_same_knots_come_out_whoever_settles_them(town, small_batches, executor):
    slots, at, places = town
    bits = prices_of(None, 0.3, len(places))
    expected = settle(slots, at, places, PLAN, bits, 1)
    found = settle(slots, at, places, PLAN, bits, 1, executor=executor)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_knots_that_stay_keep_their_places_and_ends_have_knots(town, small_batches):
    slots, at, places = town
    again, nodes = settle(slots, at, places, PLAN, prices_of(None, 0.3, len(places)), 0)
    assert (again[slots.firsts] >= 0).all()
    assert (again[slots.lasts] >= 0).all()
    assert len(np.unique(again[again >= 0])) == len(nodes) < len(places)
    # every node is one that was there, or lies where the log is at one of its knots
    old = {tuple(spot) for spot in places.tolist()}
    fresh = [node for node in range(len(nodes)) if tuple(nodes[node].tolist()) not in old]
    for node in fresh:
        assert (slots.places[again == node] == nodes[node]).all(axis=1).any()


def test_batches_find_about_as_few_knots_as_one_sweep(town, monkeypatch):
    slots, at, places = town
    counts = []
    for size in (300, 1_000_000):
        monkeypatch.setattr(settling, "_BATCH_SLOTS", size)
        here, nodes = at, places
        for turn in range(4):
            here, nodes = settle(slots, here, nodes, PLAN, prices_of(None, 0.3, len(nodes)), turn)
            nodes = place(list_parts(slots, here, len(nodes)), nodes)
        counts.append((here >= 0).sum() + len(nodes))
    assert counts[0] < 1.05 * counts[1]


def test_a_draft_without_room_grows(town, small_batches, monkeypatch):
    slots, at, places = town
    bits = prices_of(None, 3.0, len(places))
    expected = settle(slots, at, places, PLAN, bits, 0)
    monkeypatch.setattr(settling, "_SPARE", -40)
    found = settle(slots, at, places, PLAN, bits, 0)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_nodes_that_are_not_used_go_but_the_fixed_ones():
    at, places = compact(np.array([4, -1, 1, 4]), np.arange(10.0).reshape(5, 2), 1)
    assert at.tolist() == [2, -1, 1, 2]
    assert places.tolist() == [[0, 1], [2, 3], [8, 9]]


def test_a_narrow_window_leaves_more_knots(town):
    slots, at, places = town
    bits = prices_of(None, 0.3, len(places))
    wide, narrow = (settle(slots, at, places, replace(PLAN, widest=widest), bits, 0)[0] for widest in (300, 4))
    assert (narrow >= 0).sum() > (wide >= 0).sum()
