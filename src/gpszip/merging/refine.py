"""Refinement of an existing map with its walks: fewer bytes within an allowed deviation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.assignment import assign_knots
from gpszip.mapping.initial_map import list_segments
from gpszip.mapping.placement import merge_nodes, place_nodes, place_on_grid
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome, estimate_prices, measure_and_encode
from gpszip.mapping.time_grid import TimeGrid, reweight_samples
from gpszip.model import GridWalks

__all__ = ["AllowedDeviation", "refine", "snap_to_time_grid"]

#: Bits of squared error for each slot when the deviation is as large as allowed: the first price.
_BITS_PER_SLOT = 0.3

#: Power of the excess deviation by which the price changes after a first miss.
_PRICE_POWER = 2.5
#: What the power gains with each further miss.
_POWER_STEP = 1.5
#: Largest factor by which a price changes at once.
_MAX_PRICE_FACTOR = 5.0
#: Share of the allowed deviation that the price targets.
_AIM = 0.995
#: Least excess deviation that the price takes into account.
_MIN_EXCESS = 0.01

#: Weight of the points of the group with the highest price; others have less, but at least 1.
_MAX_WEIGHT = 16

#: Every so many rounds the price falls: walks that need fewer knots leave a local optimum.
_KICK_EVERY = 6
#: Factor by which it falls.
_KICK = 0.6

#: Rounds at the end in which nodes stay where they are, so that all walks come within the maximum.
_LAST_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class AllowedDeviation:
    """How far curves may be moved, in grid steps.

    Parameters
    ----------
    rms : float64 array, shape (G,)
        Largest root mean square of each group of points, by their weights.
    maximum : float
        Largest distance of any point.
    """

    rms: NDArray[np.float64]
    maximum: float


def refine(
    time_grid: TimeGrid,
    tracks: int,
    groups: NDArray[np.int64],
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    allowed: AllowedDeviation,
    rounds: int,
) -> Outcome | None:
    """Move, drop and merge the knots and nodes of a map by description length.

    Each round assigns the knots anew along segments that keep the maximum (E-step). Every other
    round, except for the last ones, then places the nodes by least squares (M-step) and merges them
    where that saves bits. Each group of points has its own price of squared error, which follows
    the deviation of the group.

    Parameters
    ----------
    time_grid : TimeGrid
        Slots where knots may lie, over the points of the curves to keep.
    tracks : int
        Number of tracks.
    groups : int64 array, shape (n,)
        Group of each point.
    slot_nodes : int64 array, shape (S,)
        Node at each slot, -1 where there is no knot.
    positions : float64 array, shape (V, d)
        The nodes, in grid steps.
    allowed : AllowedDeviation
        Bounds. A segment that misses the maximum counts as many bytes as its repair takes.
    rounds : int
        Number of rounds.

    Returns
    -------
    Outcome or None
        The smallest of all rounds and the walks as given; None if none kept to the root mean
        squares.
    """
    # Initial prices, in bits for each square grid step: with errors at the bound, they come to a
    # fixed number of bits for each slot.
    plan = Plan(target=float(allowed.rms.max()), maximum=allowed.maximum, rounds=rounds)
    group_weights = np.bincount(groups, weights=time_grid.weights, minlength=len(allowed.rms))
    price = _BITS_PER_SLOT * len(time_grid.time_steps) / (time_grid.samples * allowed.rms**2)
    power = np.full(len(price), _PRICE_POWER)

    # Cost and deviations of the walks as they are at the time of the call.
    def measure() -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
        """Outcome, bit statistics, and each group's deviation as a multiple of its bound."""
        outcome, bit_statistics, errors = measure_and_encode(
            time_grid, slot_nodes, positions, tracks, plan
        )
        squares = np.bincount(
            groups, weights=time_grid.weights * errors**2, minlength=len(group_weights)
        )
        rms = np.sqrt(squares / np.maximum(group_weights, 1))
        return outcome, bit_statistics, rms / allowed.rms

    # Begin with the walks as given.
    positions = np.rint(positions)
    best, bit_statistics, excess = measure()
    is_kept = bool((excess <= 1).all())

    # Alternate between assigning knots and placing nodes.
    for turn in range(rounds):
        # E-step: points weigh in proportion to their group's price.
        weights = np.rint(np.maximum(_MAX_WEIGHT * price / price.max(), 1)).astype(np.int64)
        weighted_grid = reweight_samples(time_grid, weights[groups])
        prices = estimate_prices(bit_statistics, float(price.max()) / _MAX_WEIGHT, len(positions))
        slot_nodes, positions = assign_knots(
            replace(weighted_grid, positions=np.rint(time_grid.positions)),
            slot_nodes,
            positions,
            plan,
            prices,
            turn,
            allowed.maximum,
        )

        # M-step and merge.
        if turn % 2 == 0 and turn < rounds - _LAST_ROUNDS:
            segments = list_segments(weighted_grid, slot_nodes, len(positions))
            slot_nodes, segments, positions = merge_nodes(
                slot_nodes, segments, place_nodes(segments, positions), plan, prices, 0
            )
            positions = place_on_grid(segments, positions, 0)

        # Keep the smallest walks within the bounds.
        outcome, bit_statistics, excess = measure()
        if (excess <= 1).all() and (not is_kept or outcome.cost < best.cost):
            best, is_kept = outcome, True

        # Let the prices follow the deviations.
        excess = excess / _AIM
        power = np.where(excess > 1, power + _POWER_STEP, _PRICE_POWER)
        factor = np.maximum(excess, _MIN_EXCESS) ** power
        price = price * np.clip(factor, 1 / _MAX_PRICE_FACTOR, _MAX_PRICE_FACTOR)
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < rounds:
            price, power = _KICK * price, np.full(len(price), _PRICE_POWER)
    return best if is_kept else None


def snap_to_time_grid(
    time_grid: TimeGrid, walks: GridWalks
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Move the knots of walks to the nearest slots of a time grid of the same quantisation grid.

    A knot stays in its piece. Of two knots at one slot, the later one stays; pieces begin and end
    with a knot.

    Returns
    -------
    slot_nodes : int64 array, shape (S,)
        Node at each slot, -1 where there is no knot.
    positions : float64 array, shape (V, d)
        The nodes, in grid steps.
    """
    # Slots have no knot at first. Each track has a slice of the pieces.
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    bounds = np.searchsorted(time_grid.piece_tracks, np.arange(len(walks.walks) + 1))
    for number, walk in enumerate(walks.walks):
        # Find the piece of each knot: the last one that starts before it.
        pieces = np.arange(bounds[number], bounds[number + 1])
        starts = time_grid.time_steps[time_grid.first_slots[pieces]]
        index = np.searchsorted(starts, walk.time_steps, side="right") - 1
        knot_pieces = pieces[np.clip(index, 0, len(pieces) - 1)]

        # Move the knots of each piece to its slots, the end knots to its end slots.
        for piece in pieces.tolist():
            knots = np.flatnonzero(knot_pieces == piece)
            first, last = int(time_grid.first_slots[piece]), int(time_grid.last_slots[piece])

            # Of the slots before and after each knot, take the nearer one.
            knot_steps, slot_steps = walk.time_steps[knots], time_grid.time_steps[first : last + 1]
            after = np.clip(np.searchsorted(slot_steps, knot_steps), 0, len(slot_steps) - 1)
            before = np.maximum(after - 1, 0)
            is_before = knot_steps - slot_steps[before] < slot_steps[after] - knot_steps
            slot_nodes[first + np.where(is_before, before, after)] = walk.nodes[knots]
            slot_nodes[first], slot_nodes[last] = walk.nodes[knots[0]], walk.nodes[knots[-1]]
    return slot_nodes, walks.nodes.astype(np.float64)
