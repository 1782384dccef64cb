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

from gpszip.codec.prior import Prior
from gpszip.mapping.initial_map import allocate_working_map, build_working_map
from gpszip.mapping.kernels.assign import assign_slice
from gpszip.mapping.kernels.assign_max_error import build_directions
from gpszip.mapping.kernels.initial_map import WorkingMap, copy_working_map
from gpszip.mapping.kernels.time_grid import TimeGridArrays
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import TimeGrid
from gpszip.run.executor import Executor

__all__ = ["assign_knots", "cut_into_batches", "drop_unused_nodes"]

_NEAR_NODES = 5
#: Slots that are settled as one batch, slots of a batch of more, at least, and the most batches.
_ALONE, _BATCH_SLOTS, _MOST_BATCHES = 60_000, 25_000, 64
#: Room for new nodes in a batch's draft, beside one for each of its knots.
_SPARE = 4096
#: Numbers kept in ``Draft.scalars``.
_NODES, _BASE = 0, 3


def drop_unused_nodes(
    slot_nodes: NDArray[np.int64], positions: NDArray[np.float64], fixed: int = 0
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Drop the nodes without a knot, save the first ``fixed``."""
    knots = slot_nodes >= 0
    used, inverse = np.unique(
        np.concatenate([np.arange(fixed), slot_nodes[knots]]), return_inverse=True
    )
    slot_nodes = slot_nodes.copy()
    slot_nodes[knots] = inverse[fixed:]
    return slot_nodes, positions[used]


def assign_knots(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    plan: Plan,
    bits: NDArray[np.float64],
    turn: int,
    maximum: float = 0.0,
    known: Prior | None = None,
    executor: Executor | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose all knots anew, window by window, at prices that stay fixed.

    Parameters
    ----------
    time_grid : Slots
        Where knots may lie.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot; not changed.
    positions : float64 array, shape (V, d)
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
    batches = cut_into_batches(time_grid, slot_nodes, turn)
    spare = _SPARE + max(
        int((slot_nodes[batch[0, 0] : batch[-1, 1] + 1] >= 0).sum()) for batch in batches
    )
    working_map = build_working_map(
        time_grid, slot_nodes, positions, plan.reach * plan.target, spare, known
    )
    # where batches share nodes, none may give a node's number to another one
    base = len(positions) if len(batches) > 1 else 0
    working_map.scalars[_BASE] = base
    job = _Sweep(working_map, _build_grid_arrays(time_grid, maximum), slot_nodes, plan, bits, turn)
    run = map if executor is None or len(batches) == 1 else executor.map
    slot_nodes, total, nodes = slot_nodes.copy(), base, [positions[:base]]
    for batch, (knots, made) in zip(batches, run(job.assign_knots, batches), strict=True):
        slot_nodes[int(batch[0, 0]) : int(batch[-1, 1]) + 1] = np.where(
            knots >= base, knots + (total - base), knots
        )
        nodes.append(made)
        total += len(made)
    return drop_unused_nodes(slot_nodes, np.concatenate(nodes), fixed)


def cut_into_batches(
    time_grid: TimeGrid, slot_nodes: NDArray[np.int64], turn: int
) -> list[NDArray[np.int64]]:
    """Cut the pieces into batches of about as many slots; long pieces are cut at knots, elsewhere in each turn.

    Returns
    -------
    list of int64 arrays, shape (stretches, 4)
        First and last slot of each stretch of a batch, and whether a piece begins and ends there.
    """
    size = max(_BATCH_SLOTS, -(-len(slot_nodes) // _MOST_BATCHES))
    if len(slot_nodes) <= _ALONE:
        count = len(time_grid.first_slots)
        return [
            np.stack(
                [
                    time_grid.first_slots,
                    time_grid.last_slots,
                    np.ones(count, np.int64),
                    np.ones(count, np.int64),
                ],
                axis=1,
            ).astype(np.int64)
        ]
    marks = np.arange(size * (2 + turn % 3) // 4, len(slot_nodes) - size // 4, size)
    knots = np.flatnonzero(slot_nodes >= 0)
    cuts = np.unique(knots[np.searchsorted(knots, marks)])
    piece = np.searchsorted(time_grid.last_slots, cuts)
    inside = (cuts > time_grid.first_slots[piece]) & (cuts < time_grid.last_slots[piece])
    starts = np.unique(np.concatenate([time_grid.first_slots, cuts[inside]]))
    ends = np.unique(np.concatenate([time_grid.last_slots, cuts[inside]]))
    slices = np.stack(
        [starts, ends, np.isin(starts, time_grid.first_slots), np.isin(ends, time_grid.last_slots)],
        axis=1,
    ).astype(np.int64)
    bounds = np.unique(np.searchsorted(starts, cuts))
    return [batch for batch in np.split(slices, bounds) if len(batch)]


@dataclass(frozen=True, eq=False)
class _Sweep:
    """What all batches of one sweep have in common."""

    working_map: WorkingMap
    grid_arrays: TimeGridArrays
    slot_nodes: NDArray[np.int64]
    plan: Plan
    bits: NDArray[np.float64]
    turn: int

    def assign_knots(
        self, batch: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the knots between the batch's first and last slot, and the places of the nodes that it has made."""
        begin, end = int(batch[0, 0]), int(batch[-1, 1])
        base, here = int(self.working_map.scalars[_BASE]), slice(begin, end + 1)
        working_map = _copy(self.working_map) if base else self.working_map
        slot_nodes, grid_arrays, marks = (
            self.slot_nodes[here].copy(),
            _select_slots(self.grid_arrays, here),
            np.zeros(len(working_map.positions), np.int64),
        )
        for time_slice in _order_slices(batch, begin, self.turn):
            start = int(time_slice[0])
            while start < time_slice[1]:
                start = assign_slice(
                    working_map, grid_arrays, slot_nodes, start, time_slice, 1 + (self.turn * 7) % self.plan.window, self.plan.window, _NEAR_NODES,
                    self.plan.max_slots, self.bits, marks,
                )  # fmt: skip
                if start < time_slice[1]:
                    working_map = _enlarge(
                        working_map, 2 * self.plan.max_slots * self.plan.window + len(slot_nodes)
                    )
                    marks = np.zeros(len(working_map.positions), np.int64)
        return slot_nodes, working_map.positions[base : int(working_map.scalars[_NODES])]


def _order_slices(batch: NDArray[np.int64], begin: int, turn: int) -> Iterator[NDArray[np.int64]]:
    """Stretches counted from the batch's first slot, every other turn from the last one on."""
    yield from (batch - np.array([begin, begin, 0, 0]))[:: 1 if turn % 2 == 0 else -1]


def _copy(working_map: WorkingMap) -> WorkingMap:
    copies: Any = {name: values.copy() for name, values in working_map._asdict().items()}
    return WorkingMap(**copies)


def _enlarge(working_map: WorkingMap, spare: int) -> WorkingMap:
    """Return the same draft with room for more nodes and steps."""
    bigger = allocate_working_map(
        working_map.positions.shape[1],
        len(working_map.positions) + spare,
        len(working_map.into) // 2 + spare,
        float(working_map.bucket_size[0]),
    )
    copy_working_map(bigger, working_map)
    return bigger


def _select_slots(grid_arrays: TimeGridArrays, here: slice) -> TimeGridArrays:
    """Return the ground of some slots only; samples are still counted from the log's first."""
    of = grid_arrays._asdict()
    return TimeGridArrays(
        **of
        | {
            name: of[name][here]
            for name in ("sums", "ticks", "centers", "positions", "ends", "time_steps")
        }
    )


def _build_grid_arrays(time_grid: TimeGrid, maximum: float) -> TimeGridArrays:
    fan, share = build_directions(time_grid.positions.shape[1])
    return TimeGridArrays(
        time_grid.sums, time_grid.ticks, time_grid.centers, time_grid.positions, np.array([time_grid.ticks_per_step]), time_grid.ends, time_grid.times, time_grid.sample_positions,
        time_grid.time_steps.astype(np.float64), fan, np.array([share * maximum]),
    )  # fmt: skip
