"""A map and walks that are there already, made smaller: knots and nodes are moved, dropped and united within a deviation allowed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.assignment import settle
from gpszip.mapping.initial_map import list_parts
from gpszip.mapping.placement import place, rounded_places, unite
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome, prices_of, realise
from gpszip.mapping.time_grid import Slots, weigh_samples
from gpszip.model import LatticeWalks

__all__ = ["Allowance", "draft_on", "refine"]

#: Power of the error's excess by which the price follows, what it gains with each further miss, and the farthest it goes at once.
_PUSH, _MORE, _LEAP = 2.5, 1.5, 5.0

#: Weight of the points of the dearest group; the others have less, but at least 1.
_WEIGHTS = 16

#: Every so many rounds the price falls by this factor: walks that need fewer knots leave a local optimum behind.
_KICK_EVERY, _KICK = 6, 0.6

#: Rounds at the end in which nodes stay where they are, so that all walks come within the maximum.
_LAST_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Allowance:
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
    slots: Slots,
    tracks: int,
    groups: NDArray[np.int64],
    at: NDArray[np.int64],
    places: NDArray[np.float64],
    allowed: Allowance,
    rounds: int,
) -> Outcome | None:
    """Move, drop and unite the knots and nodes of a map by description length.

    The slots are laid over points of the curves that are to be kept. Each round settles the knots anew along parts that keep
    the maximum (E-step); in all but the last, nodes are then placed by least squares (M-step) and united where that saves bits.
    Each group of points has its own price of squared error, which follows what the group is allowed.

    Parameters
    ----------
    slots : Slots
        Where knots may lie.
    tracks : int
        Number of tracks.
    groups : int64 array, shape (n,)
        Group of each point.
    at : int64 array, shape (S,)
        Node at each slot, -1 where there is no knot.
    places : float64 array, shape (V, d)
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
    counts = np.bincount(groups, weights=slots.weights, minlength=len(allowed.rms))
    price = 0.3 * len(slots.cells) / (slots.samples * allowed.rms**2)
    push = np.full(len(price), _PUSH)

    def measured() -> tuple[Outcome, NDArray[np.float64], NDArray[np.float64]]:
        outcome, ledger, errors = realise(slots, at, places, tracks, plan)
        mean = np.bincount(groups, weights=slots.weights * errors**2, minlength=len(counts)) / np.maximum(counts, 1)
        return outcome, ledger, np.sqrt(mean) / allowed.rms

    places = np.rint(places)
    best, ledger, over = measured()
    held = bool((over <= 1).all())
    for turn in range(rounds):
        weighed = weigh_samples(slots, np.rint(np.maximum(_WEIGHTS * price / price.max(), 1)).astype(np.int64)[groups])
        bits = prices_of(ledger, float(price.max()) / _WEIGHTS, len(places))
        at, places = settle(replace(weighed, places=np.rint(slots.places)), at, places, plan, bits, turn, allowed.maximum)
        if turn % 2 == 0 and turn < rounds - _LAST_ROUNDS:
            parts = list_parts(weighed, at, len(places))
            at, parts, places = unite(at, parts, place(parts, places), plan, bits, 0)
            places = rounded_places(parts, places, 0)
        outcome, ledger, over = measured()
        if (over <= 1).all() and (not held or outcome.cost < best.cost):
            best, held = outcome, True
        over = over / 0.995
        push = np.where(over > 1, push + _MORE, _PUSH)
        price = price * np.clip(np.maximum(over, 0.01) ** push, 1 / _LEAP, _LEAP)
        if turn % _KICK_EVERY == _KICK_EVERY - 1 and turn + _KICK_EVERY < rounds:
            price, push = _KICK * price, np.full(len(price), _PUSH)
    return best if held else None


def draft_on(slots: Slots, walks: LatticeWalks) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Put the knots of walks on slots of the same lattice: the nearest slot of the piece that each belongs to.

    Where two knots come to lie on one slot, the later one stays; pieces begin and end with a knot.

    Returns
    -------
    at : int64 array, shape (S,)
        Node at each slot, -1 where there is no knot.
    places : float64 array, shape (V, d)
        The nodes, in quanta.
    """
    at = np.full(len(slots.cells), -1, np.int64)
    owned = np.searchsorted(slots.owners, np.arange(len(walks.walks) + 1))
    for number, walk in enumerate(walks.walks):
        pieces = np.arange(owned[number], owned[number + 1])
        starts = slots.cells[slots.firsts[pieces]]
        which = pieces[np.clip(np.searchsorted(starts, walk.cells, side="right") - 1, 0, len(pieces) - 1)]
        for piece in pieces.tolist():
            mine = np.flatnonzero(which == piece)
            first, last = int(slots.firsts[piece]), int(slots.lasts[piece])
            cells = slots.cells[first : last + 1]
            after = np.clip(np.searchsorted(cells, walk.cells[mine]), 0, len(cells) - 1)
            before = np.maximum(after - 1, 0)
            nearer = np.where(walk.cells[mine] - cells[before] < cells[after] - walk.cells[mine], before, after)
            at[first + nearer] = walk.nodes[mine]
            at[first], at[last] = walk.nodes[mine[0]], walk.nodes[mine[-1]]
    return at, walks.nodes.astype(np.float64)
