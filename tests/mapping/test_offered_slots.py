import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.mapping.assignment import assign_knots
from gpszip.mapping.offered_slots import assign_on_offered_slots, mask_offered_slots
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import estimate_prices
from gpszip.mapping.time_grid import build_time_grid, select_slots
from gpszip.model import QuantisationGrid, Track
from gpszip.testing.city import drives


@pytest.fixture(scope="module")
def town():
    """Time grid of a town's traffic."""
    tracks = [Track(name, *drive) for name, drive in drives(vehicles=6, period=5.0).items()]
    gaps = [np.zeros(len(track) - 1, bool) for track in tracks]
    return build_time_grid(tracks, gaps, QuantisationGrid((0, 0), 0, 149, 141))


def with_knots(time_grid, every):
    """A knot with a node of its own at every so many slots, and at the ends of pieces."""
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    slot_nodes[::every] = slot_nodes[time_grid.first_slots] = slot_nodes[time_grid.last_slots] = 0
    slot_nodes[slot_nodes >= 0] = np.arange((slot_nodes >= 0).sum())
    return slot_nodes, time_grid.positions[slot_nodes >= 0].copy()


@given(
    every=st.integers(12, 60), slots_per_knot=st.floats(0.5, 4.0), turn=st.integers(0, 1_000_000)
)
def test_knots_their_neighbours_and_ends_of_pieces_are_offered(town, every, slots_per_knot, turn):
    slot_nodes, positions = with_knots(town, every)
    is_offered = mask_offered_slots(town, slot_nodes, slots_per_knot, turn)
    knots = np.flatnonzero(slot_nodes >= 0)
    for shift in (-1, 0, 1):
        assert is_offered[np.clip(knots + shift, 0, len(slot_nodes) - 1)].all()
    assert is_offered[town.first_slots].all()
    assert is_offered[town.last_slots].all()
    assert is_offered.sum() <= (slots_per_knot + 3) * len(positions) + 1


def test_a_few_rounds_offer_all_slots(town):
    slot_nodes, _ = with_knots(town, 40)
    masks = [mask_offered_slots(town, slot_nodes, 4.0, turn) for turn in range(24)]
    assert max(mask.mean() for mask in masks) < 0.2
    assert np.logical_or.reduce(masks).all()


def test_all_slots_are_offered_where_there_are_few_for_each_knot(town):
    slot_nodes, positions = with_knots(town, 4)
    assert mask_offered_slots(town, slot_nodes, 3.0, 1) is None
    plan = Plan(target=1.0, slots_per_knot=3.0)
    prices = estimate_prices(None, 1.0, len(positions))
    for result, expected in zip(
        assign_on_offered_slots(town, slot_nodes, positions, plan, prices, 1),
        assign_knots(town, slot_nodes, positions, plan, prices, 1),
        strict=True,
    ):
        np.testing.assert_array_equal(result, expected)


def test_knots_are_those_of_a_grid_of_the_offered_slots(town):
    slot_nodes, positions = with_knots(town, 20)
    plan = Plan(target=1.0, slots_per_knot=3.0)
    prices = estimate_prices(None, 1.0, len(positions))
    assigned, nodes = assign_on_offered_slots(town, slot_nodes, positions, plan, prices, 2)

    is_offered = mask_offered_slots(town, slot_nodes, 3.0, 2)
    expected, expected_nodes = assign_knots(
        select_slots(town, is_offered), slot_nodes[is_offered], positions, plan, prices, 2
    )
    assert (assigned[~is_offered] == -1).all()
    np.testing.assert_array_equal(assigned[is_offered], expected)
    np.testing.assert_array_equal(nodes, expected_nodes)
    assert not np.array_equal(assigned >= 0, slot_nodes >= 0)
