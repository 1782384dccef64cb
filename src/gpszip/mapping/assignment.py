"""One E-step over all pieces, cut into batches that do not depend on who works on them.

Each batch settles its knots on a draft of its own, which begins as what the last round left behind, so that batches may be
settled in any order and at once. Then their new nodes get numbers in the order of the batches.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.prior import Past
from gpszip.mapping.initial_map import draft_of, empty_draft
from gpszip.mapping.kernels.assign import settle_stretch
from gpszip.mapping.kernels.assign_max_error import directions
from gpszip.mapping.kernels.initial_map import Draft, enter_draft
from gpszip.mapping.kernels.time_grid import Ground
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import Slots
from gpszip.run.executor import Executor

__all__ = ["compact", "cut_pieces", "settle"]

_NEAR_NODES = 5
#: Slots that are settled as one batch, slots of a batch of more, at least, and the most batches.
_ALONE, _BATCH_SLOTS, _MOST_BATCHES = 60_000, 25_000, 64
#: Room for new nodes in a batch's draft, beside one for each of its knots.
_SPARE = 4096
#: Numbers kept in ``Draft.scalars``.
_NODES, _BASE = 0, 3


def compact(at: NDArray[np.int64], places: NDArray[np.float64], fixed: int = 0) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Drop the nodes without a knot, save the first ``fixed``."""
    knots = at >= 0
    used, inverse = np.unique(np.concatenate([np.arange(fixed), at[knots]]), return_inverse=True)
    at = at.copy()
    at[knots] = inverse[fixed:]
    return at, places[used]


def settle(
    slots: Slots,
    at: NDArray[np.int64],
    places: NDArray[np.float64],
    plan: Plan,
    bits: NDArray[np.float64],
    turn: int,
    maximum: float = 0.0,
    known: Past | None = None,
    executor: Executor | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose all knots anew, window by window, at prices that stay fixed.

    Parameters
    ----------
    slots : Slots
        Where knots may lie.
    at : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot; not changed.
    places : float64 array, shape (V, d)
        The nodes.
    plan : Plan
        Window, width and reach.
    bits : float64 array
        Prices.
    turn : int
        Number of the round: windows and batches are cut elsewhere in each.
    maximum : float, default 0
        Largest distance of a sample from its part, if parts are to keep one.
    known : Past, optional
        Walks that stay; theirs are the first nodes.
    executor : Executor, optional
        Where batches are settled; the result does not depend on it.

    Returns
    -------
    at, places
        The knots, and the nodes that are still used.
    """
    fixed = 0 if known is None else known.nodes
    batches = cut_pieces(slots, at, turn)
    spare = _SPARE + max(int((at[batch[0, 0] : batch[-1, 1] + 1] >= 0).sum()) for batch in batches)
    draft = draft_of(slots, at, places, plan.reach * plan.target, spare, known)
    # where batches share nodes, none may give a node's number to another one
    base = len(places) if len(batches) > 1 else 0
    draft.scalars[_BASE] = base
    job = _Job(draft, _ground(slots, maximum), at, plan, bits, turn)
    run = map if executor is None or len(batches) == 1 else executor.map
    at, total, nodes = at.copy(), base, [places[:base]]
    for batch, (knots, made) in zip(batches, run(job.settle, batches), strict=True):
        at[int(batch[0, 0]) : int(batch[-1, 1]) + 1] = np.where(knots >= base, knots + (total - base), knots)
        nodes.append(made)
        total += len(made)
    return compact(at, np.concatenate(nodes), fixed)


def cut_pieces(slots: Slots, at: NDArray[np.int64], turn: int) -> list[NDArray[np.int64]]:
    """Cut the pieces into batches of about as many slots; long pieces are cut at knots, elsewhere in each turn.

    Returns
    -------
    list of int64 arrays, shape (stretches, 4)
        First and last slot of each stretch of a batch, and whether a piece begins and ends there.
    """
    size = max(_BATCH_SLOTS, -(-len(at) // _MOST_BATCHES))
    if len(at) <= _ALONE:
        count = len(slots.firsts)
        return [np.stack([slots.firsts, slots.lasts, np.ones(count, np.int64), np.ones(count, np.int64)], axis=1).astype(np.int64)]
    marks = np.arange(size * (2 + turn % 3) // 4, len(at) - size // 4, size)
    knots = np.flatnonzero(at >= 0)
    cuts = np.unique(knots[np.searchsorted(knots, marks)])
    piece = np.searchsorted(slots.lasts, cuts)
    inside = (cuts > slots.firsts[piece]) & (cuts < slots.lasts[piece])
    starts = np.unique(np.concatenate([slots.firsts, cuts[inside]]))
    ends = np.unique(np.concatenate([slots.lasts, cuts[inside]]))
    stretches = np.stack([starts, ends, np.isin(starts, slots.firsts), np.isin(ends, slots.lasts)], axis=1).astype(np.int64)
    bounds = np.unique(np.searchsorted(starts, cuts))
    return [batch for batch in np.split(stretches, bounds) if len(batch)]


@dataclass(frozen=True, eq=False)
class _Job:
    """What all batches of one sweep have in common."""

    draft: Draft
    ground: Ground
    at: NDArray[np.int64]
    plan: Plan
    bits: NDArray[np.float64]
    turn: int

    def settle(self, batch: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the knots between the batch's first and last slot, and the places of the nodes that it has made."""
        begin, end = int(batch[0, 0]), int(batch[-1, 1])
        base, here = int(self.draft.scalars[_BASE]), slice(begin, end + 1)
        draft = _copy(self.draft) if base else self.draft
        at, ground, marks = self.at[here].copy(), _view(self.ground, here), np.zeros(len(draft.places), np.int64)
        for stretch in _in_turn(batch, begin, self.turn):
            start = int(stretch[0])
            while start < stretch[1]:
                start = settle_stretch(
                    draft, ground, at, start, stretch, 1 + (self.turn * 7) % self.plan.window, self.plan.window, _NEAR_NODES,
                    self.plan.widest, self.bits, marks,
                )  # fmt: skip
                if start < stretch[1]:
                    draft = _roomier(draft, 2 * self.plan.widest * self.plan.window + len(at))
                    marks = np.zeros(len(draft.places), np.int64)
        return at, draft.places[base : int(draft.scalars[_NODES])]


def _in_turn(batch: NDArray[np.int64], begin: int, turn: int) -> Iterator[NDArray[np.int64]]:
    """Stretches counted from the batch's first slot, every other turn from the last one on."""
    yield from (batch - np.array([begin, begin, 0, 0]))[:: 1 if turn % 2 == 0 else -1]


def _copy(draft: Draft) -> Draft:
    copies: Any = {name: values.copy() for name, values in draft._asdict().items()}
    return Draft(**copies)


def _roomier(draft: Draft, spare: int) -> Draft:
    """Return the same draft with room for more nodes and steps."""
    bigger = empty_draft(draft.places.shape[1], len(draft.places) + spare, len(draft.into) // 2 + spare, float(draft.cell[0]))
    enter_draft(bigger, draft)
    return bigger


def _view(ground: Ground, here: slice) -> Ground:
    """Return the ground of some slots only; samples are still counted from the log's first."""
    of = ground._asdict()
    return Ground(**of | {name: of[name][here] for name in ("sums", "ticks", "centers", "places", "ends", "cells")})


def _ground(slots: Slots, maximum: float) -> Ground:
    fan, share = directions(slots.places.shape[1])
    return Ground(
        slots.sums, slots.ticks, slots.centers, slots.places, np.array([slots.place_unit]), slots.ends, slots.times, slots.spots,
        slots.cells.astype(np.float64), fan, np.array([share * maximum]),
    )  # fmt: skip
