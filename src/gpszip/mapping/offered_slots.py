"""E-steps on some of the slots: those next to knots, and every so many of the others.

Where a segment spans many slots, most of them never get a knot. The time of an E-step grows with
the square of the slots of a segment, so that few slots for each knot take a fraction of it. Other
slots are offered in each round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.prior import Prior
from gpszip.mapping.assignment import assign_knots
from gpszip.mapping.kernels.assign import Prices
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import TimeGrid, select_slots
from gpszip.run.executor import Executor

__all__ = ["assign_on_offered_slots", "mask_offered_slots"]

#: Slots to either side of a knot that are always offered.
_REACH = 1

#: Share of the distance between two offered slots by which they shift from round to round: by the
#: golden section, the slots of any number of rounds spread evenly.
_SHIFT = 0.618

#: Distance below which all slots are offered.
_MIN_STRIDE = 1.5


def mask_offered_slots(
    time_grid: TimeGrid, slot_nodes: NDArray[np.int64], slots_per_knot: float, turn: int
) -> NDArray[np.bool_] | None:
    """Mark the slots that a round offers.

    Parameters
    ----------
    time_grid : TimeGrid
        All slots.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot; each piece begins and ends with one.
    slots_per_knot : float
        Slots to offer for each knot, evenly spread, beside those next to knots.
    turn : int
        Number of the round.

    Returns
    -------
    bool array, shape (S,), or None
        None where the log has no more slots than that.
    """
    # Every so many slots, shifted from round to round.
    knots = np.flatnonzero(slot_nodes >= 0)
    stride = len(slot_nodes) / (slots_per_knot * len(knots))
    if stride < _MIN_STRIDE:
        return None
    is_offered = np.zeros(len(slot_nodes), np.bool_)
    first = turn * _SHIFT % 1.0 * stride
    marks = np.arange(first, len(slot_nodes), stride).astype(np.int64)
    is_offered[np.minimum(marks, len(slot_nodes) - 1)] = True

    # The knots with their neighbours, and the ends of pieces.
    for shift in range(-_REACH, _REACH + 1):
        is_offered[np.clip(knots + shift, 0, len(slot_nodes) - 1)] = True
    is_offered[time_grid.first_slots] = is_offered[time_grid.last_slots] = True
    return is_offered


def assign_on_offered_slots(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    plan: Plan,
    prices: Prices,
    turn: int,
    prior: Prior | None = None,
    executor: Executor | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose all knots anew on ``plan.slots_per_knot`` slots for each.

    Parameters and results are those of :func:`~gpszip.mapping.assignment.assign_knots`.
    """
    is_offered = mask_offered_slots(time_grid, slot_nodes, plan.slots_per_knot, turn)
    if is_offered is None:
        return assign_knots(
            time_grid, slot_nodes, positions, plan, prices, turn, prior=prior, executor=executor
        )

    # Assign on these slots only; no other slot carries a knot.
    chosen, positions = assign_knots(
        select_slots(time_grid, is_offered),
        slot_nodes[is_offered],
        positions,
        plan,
        prices,
        turn,
        prior=prior,
        executor=executor,
    )
    assigned = np.full(len(slot_nodes), -1, np.int64)
    assigned[is_offered] = chosen
    return assigned, positions
