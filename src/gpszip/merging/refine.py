"""A map and walks that are there already, made smaller: knots and nodes are moved, dropped and united within a deviation allowed."""

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

#: Power of the error's excess by which the price follows, what it gains with each further miss, and the farthest it goes at once.
_PUSH, _MORE, _LEAP = 2.5, 1.5, 5.0

#: Weight of the points of the dearest group; the others have less, but at least 1.
_WEIGHTS = 16

#: Every so many rounds the price falls by this factor: walks that need fewer knots leave a local optimum behind.
_KICK_EVERY, _KICK = 6, 0.6

#: Rounds at the end in which nodes stay where they are, so that all walks come within the maximum.
_LAST_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class AllowedDeviation:
    """How far curves may be moved, in quanta.

    Parameters
    ----------
    rms : float64 array, shape (G,)
        In the root mean square of each group of points by their weights.
    maximum : float
        Anywhere.
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
    """Move, drop and unite the knots and nodes of a map by description length.

    The slots are laid over points of the curves that are to be kept. Each round settles the knots anew along parts that keep
    the maximum (E-step); in all but the last, nodes are then placed by least squares (M-step) and united where that saves bits.
    Each group of points has its own price of squared error, which follows what the group is allowed.

    Parameters
    ----------
    time_grid : Slots
        Where knots may lie.
    tracks : int
        Number of tracks.
    groups : int64 array, shape (n,)
        Group of each point.
    slot_nodes : int64 array, shape (S,)
        Node at each slot, -1 where there is no knot.
    positions : float64 array, shape (V, d)
        The nodes, in quanta.
    allowed : Allowance
        What keeps to it counts; a part that misses the maximum counts as much as mending it will.
    rounds : int
        Number of rounds.

    Returns
    -------
    Outcome or None
        The smallest that was met on the way, the walks as given among them; None if none kept to the root mean squares.
    """
    plan = Plan(target=float(allowed.rms.max()), maximum=allowed.maximum, rounds=rounds)
    counts = np.bincount(groups, weights=time_grid.weights, minlength=len(allowed.rms))
    price = 0.3 * len(time_grid.time_steps) / (time_grid.samples * allowed.rms**2)
    push = np.full(len(price), _PUSH)

    def measured() -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
        outcome, bit_statistics, errors = measure_and_encode(
            time_grid, slot_nodes, positions, tracks, plan
        )
        mean = np.bincount(
            groups, weights=time_grid.weights * errors**2, minlength=len(counts)
        ) / np.maximum(counts, 1)
        return outcome, bit_statistics, np.sqrt(mean) / allowed.rms

    positions = np.rint(positions)
    best, bit_statistics, over = measured()
    held = bool((over <= 1).all())
    for turn in range(rounds):
        weighed = reweight_samples(
            time_grid,
            np.rint(np.maximum(_WEIGHTS * price / price.max(), 1)).astype(np.int64)[groups],
        )
        bits = estimate_prices(bit_statistics, float(price.max()) / _WEIGHTS, len(positions))
        slot_nodes, positions = assign_knots(
            replace(weighed, positions=np.rint(time_grid.positions)),
            slot_nodes,
            positions,
            plan,
            bits,
            turn,
            allowed.maximum,
        )
        if turn % 2 == 0 and turn < rounds - _LAST_ROUNDS:
            segments = list_segments(weighed, slot_nodes, len(positions))
            slot_nodes, segments, positions = merge_nodes(
                slot_nodes, segments, place_nodes(segments, positions), plan, bits, 0
            )
            positions = place_on_grid(segments, positions, 0)
        outcome, bit_statistics, over = measured()
        if (over <= 1).all() and (not held or outcome.cost < best.cost):
            best, held = outcome, True
        over = over / 0.995
        push = np.where(over > 1, push + _MORE, _PUSH)
        price = price * np.clip(np.maximum(over, 0.01) ** push, 1 / _LEAP, _LEAP)
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < rounds:
            price, push = _KICK * price, np.full(len(price), _PUSH)
    return best if held else None


def snap_to_time_grid(
    time_grid: TimeGrid, walks: GridWalks
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Put the knots of walks on slots of the same lattice: the nearest slot of the piece that each belongs to.

    Where two knots come to lie on one slot, the later one stays; pieces begin and end with a knot.

    Returns
    -------
    slot_nodes : int64 array, shape (S,)
        Node at each slot, -1 where there is no knot.
    positions : float64 array, shape (V, d)
        The nodes, in quanta.
    """
    slot_nodes = np.full(len(time_grid.time_steps), -1, np.int64)
    owned = np.searchsorted(time_grid.piece_tracks, np.arange(len(walks.walks) + 1))
    for number, walk in enumerate(walks.walks):
        pieces = np.arange(owned[number], owned[number + 1])
        starts = time_grid.time_steps[time_grid.first_slots[pieces]]
        which = pieces[
            np.clip(np.searchsorted(starts, walk.time_steps, side="right") - 1, 0, len(pieces) - 1)
        ]
        for piece in pieces.tolist():
            mine = np.flatnonzero(which == piece)
            first, last = int(time_grid.first_slots[piece]), int(time_grid.last_slots[piece])
            cells = time_grid.time_steps[first : last + 1]
            after = np.clip(np.searchsorted(cells, walk.time_steps[mine]), 0, len(cells) - 1)
            before = np.maximum(after - 1, 0)
            nearer = np.where(
                walk.time_steps[mine] - cells[before] < cells[after] - walk.time_steps[mine],
                before,
                after,
            )
            slot_nodes[first + nearer] = walk.nodes[mine]
            slot_nodes[first], slot_nodes[last] = walk.nodes[mine[0]], walk.nodes[mine[-1]]
    return slot_nodes, walks.nodes.astype(np.float64)
