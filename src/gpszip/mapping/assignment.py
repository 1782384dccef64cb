"""One E-step over all pieces, in batches that do not depend on which worker runs them.

Each batch assigns its knots on its own copy of the map, which begins as the last round left it, so
that batches may run in any order and at once. Then their new nodes get numbers in the order of the
batches.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.prior import Prior
from gpszip.mapping.initial_map import allocate_working_map, build_working_map
from gpszip.mapping.kernels.assign import (
    FIRST_SLOT,
    LAST_SLOT,
    Prices,
    assign_slice,
)
from gpszip.mapping.kernels.assign_max_error import build_directions
from gpszip.mapping.kernels.initial_map import (
    FIRST_REUSABLE,
    NODE_COUNT,
    WorkingMap,
    copy_working_map,
)
from gpszip.mapping.kernels.time_grid import TimeGridArrays
from gpszip.mapping.plan import Plan
from gpszip.mapping.time_grid import TimeGrid
from gpszip.run.executor import Executor

__all__ = ["assign_knots", "cut_into_batches", "drop_unused_nodes", "enlarge_map"]

#: Near nodes that are candidates at each slot: with three, a map of many streets took 5 % more.
_NEAR_NODES = 5

#: Slots up to which all pieces are one batch.
_SINGLE_BATCH_SLOTS = 60_000

#: Least number of slots of a batch.
_BATCH_SLOTS = 25_000

#: Largest number of batches.
_MAX_BATCHES = 64

#: Capacity for new nodes in the map of a batch, beside one for each of its knots.
_SPARE_NODES = 4096

#: Knots by which the first window of a slice grows from round to round, so that windows end
#: elsewhere in each.
_PHASE_STEP = 7


def drop_unused_nodes(
    slot_nodes: NDArray[np.int64], positions: NDArray[np.float64], fixed: int = 0
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Drop the nodes without a knot, except for the first ``fixed``, and renumber the others."""
    is_knot = slot_nodes >= 0
    used, inverse = np.unique(
        np.concatenate([np.arange(fixed), slot_nodes[is_knot]]), return_inverse=True
    )
    slot_nodes = slot_nodes.copy()
    slot_nodes[is_knot] = inverse[fixed:]
    return slot_nodes, positions[used]


def assign_knots(
    time_grid: TimeGrid,
    slot_nodes: NDArray[np.int64],
    positions: NDArray[np.float64],
    plan: Plan,
    prices: Prices,
    turn: int,
    maximum: float = 0.0,
    prior: Prior | None = None,
    executor: Executor | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose all knots anew, window by window, at fixed prices.

    Parameters
    ----------
    time_grid : TimeGrid
        Slots where knots may lie.
    slot_nodes : int64 array, shape (S,)
        Node of each slot, -1 where there is no knot; not changed.
    positions : float64 array, shape (V, d)
        The nodes, in grid steps.
    plan : Plan
        Window, longest segment and reach.
    prices : Prices
        Prices in bits.
    turn : int
        Number of the round: windows and batches end elsewhere in each.
    maximum : float, default 0
        Largest distance of a sample from its segment, in grid steps; 0 for no limit.
    prior : Prior, optional
        Walks that stay; the first nodes are theirs.
    executor : Executor, optional
        Runs the batches; the result does not depend on it.

    Returns
    -------
    slot_nodes : int64 array, shape (S,)
        The new knots.
    positions : float64 array
        The nodes that are used.
    """
    # Build the map with capacity for the largest batch.
    fixed = 0 if prior is None else prior.nodes
    batches = cut_into_batches(time_grid, slot_nodes, turn)
    spare = _SPARE_NODES + max(
        int((slot_nodes[batch[0, FIRST_SLOT] : batch[-1, LAST_SLOT] + 1] >= 0).sum())
        for batch in batches
    )
    working_map = build_working_map(
        time_grid, slot_nodes, positions, plan.reach * plan.target, spare, prior
    )

    # Where batches share nodes, none may give a shared node's number to another node.
    base = len(positions) if len(batches) > 1 else 0
    working_map.counters[FIRST_REUSABLE] = base

    # Assign the batches, and number their new nodes one batch after the other.
    job = _AssignmentJob(
        working_map, _build_grid_arrays(time_grid, maximum), slot_nodes, plan, prices, turn
    )
    run = map if executor is None or len(batches) == 1 else executor.map
    slot_nodes, total, nodes = slot_nodes.copy(), base, [positions[:base]]
    for batch, (knots, new_nodes) in zip(batches, run(job.assign_batch, batches), strict=True):
        slots = slice(int(batch[0, FIRST_SLOT]), int(batch[-1, LAST_SLOT]) + 1)
        slot_nodes[slots] = np.where(knots >= base, knots + (total - base), knots)
        nodes.append(new_nodes)
        total += len(new_nodes)
    return drop_unused_nodes(slot_nodes, np.concatenate(nodes), fixed)


def cut_into_batches(
    time_grid: TimeGrid, slot_nodes: NDArray[np.int64], turn: int
) -> list[NDArray[np.int64]]:
    """Cut the pieces into batches of about as many slots.

    Long pieces are cut at knots, elsewhere in each turn.

    Returns
    -------
    list of int64 arrays, shape (slices, 4)
        First and last slot of each time slice of a batch, and whether a piece begins and ends
        there.
    """
    # A small log is a single batch of complete pieces.
    size = max(_BATCH_SLOTS, -(-len(slot_nodes) // _MAX_BATCHES))
    if len(slot_nodes) <= _SINGLE_BATCH_SLOTS:
        ones = np.ones(len(time_grid.first_slots), np.int64)
        return [
            np.stack([time_grid.first_slots, time_grid.last_slots, ones, ones], axis=1).astype(
                np.int64
            )
        ]

    # Cut at the first knot behind each mark; marks shift by a quarter of a batch from turn to
    # turn.
    marks = np.arange(size * (2 + turn % 3) // 4, len(slot_nodes) - size // 4, size)
    knots = np.flatnonzero(slot_nodes >= 0)
    cuts = np.unique(knots[np.searchsorted(knots, marks)])

    # Cuts inside of pieces end a slice and begin the next one.
    piece = np.searchsorted(time_grid.last_slots, cuts)
    is_inside = (cuts > time_grid.first_slots[piece]) & (cuts < time_grid.last_slots[piece])
    starts = np.unique(np.concatenate([time_grid.first_slots, cuts[is_inside]]))
    ends = np.unique(np.concatenate([time_grid.last_slots, cuts[is_inside]]))
    slices = np.stack(
        [starts, ends, np.isin(starts, time_grid.first_slots), np.isin(ends, time_grid.last_slots)],
        axis=1,
    ).astype(np.int64)

    # The slices between two cuts are a batch.
    bounds = np.unique(np.searchsorted(starts, cuts))
    return [batch for batch in np.split(slices, bounds) if len(batch)]


@dataclass(frozen=True, eq=False)
class _AssignmentJob:
    """What all batches of one E-step share."""

    working_map: WorkingMap
    grid_arrays: TimeGridArrays
    slot_nodes: NDArray[np.int64]
    plan: Plan
    prices: Prices
    turn: int

    def assign_batch(
        self, batch: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the knots from the batch's first to its last slot, and its new nodes."""
        # Work on copies; a single batch needs none of the map.
        begin, end = int(batch[0, FIRST_SLOT]), int(batch[-1, LAST_SLOT])
        slots = slice(begin, end + 1)
        base = int(self.working_map.counters[FIRST_REUSABLE])
        working_map = _copy_map(self.working_map) if base else self.working_map
        slot_nodes = self.slot_nodes[slots].copy()
        grid_arrays = _select_slots(self.grid_arrays, slots)
        marks = np.zeros(len(working_map.positions), np.int64)

        # Assign window by window; the first window's size changes from round to round, so that
        # windows end elsewhere.
        phase = 1 + (self.turn * _PHASE_STEP) % self.plan.window
        for time_slice in _order_slices(batch, begin, self.turn):
            start = int(time_slice[FIRST_SLOT])
            while start < time_slice[LAST_SLOT]:
                start = assign_slice(
                    working_map,
                    grid_arrays,
                    slot_nodes,
                    start,
                    time_slice,
                    phase,
                    self.plan.window,
                    _NEAR_NODES,
                    self.plan.max_slots,
                    self.prices,
                    marks,
                )
                # The kernel stops where the map is full.
                if start < time_slice[LAST_SLOT]:
                    working_map = enlarge_map(
                        working_map, 2 * self.plan.max_slots * self.plan.window + len(slot_nodes)
                    )
                    marks = np.zeros(len(working_map.positions), np.int64)
        return slot_nodes, working_map.positions[base : int(working_map.counters[NODE_COUNT])]


def _order_slices(batch: NDArray[np.int64], begin: int, turn: int) -> Iterator[NDArray[np.int64]]:
    """Slices with slots counted from the batch's first one; in odd turns, the last slice first."""
    shift = np.zeros(4, np.int64)
    shift[[FIRST_SLOT, LAST_SLOT]] = begin
    yield from (batch - shift)[:: 1 if turn % 2 == 0 else -1]


def _copy_map(working_map: WorkingMap) -> WorkingMap:
    return WorkingMap._make(
        values.copy() if isinstance(values, np.ndarray) else values for values in working_map
    )


def enlarge_map(working_map: WorkingMap, spare: int) -> WorkingMap:
    """Return the same map with capacity for ``spare`` more nodes and steps."""
    larger = allocate_working_map(
        working_map.positions.shape[1],
        len(working_map.positions) + spare,
        len(working_map.end_node) // 2 + spare,
        working_map.cell_size,
    )
    copy_working_map(larger, working_map)
    return larger


def _select_slots(grid_arrays: TimeGridArrays, slots: slice) -> TimeGridArrays:
    """Return the arrays of some slots only; samples are still counted from the log's first."""
    return grid_arrays._replace(
        sums=grid_arrays.sums[slots],
        ticks=grid_arrays.ticks[slots],
        centers=grid_arrays.centers[slots],
        positions=grid_arrays.positions[slots],
        ends=grid_arrays.ends[slots],
        time_steps=grid_arrays.time_steps[slots],
    )


def _build_grid_arrays(time_grid: TimeGrid, maximum: float) -> TimeGridArrays:
    """Return the arrays of a time grid, and the strips that keep samples within a maximum."""
    directions, share = build_directions(time_grid.positions.shape[1])
    return TimeGridArrays(
        sums=time_grid.sums,
        ticks=time_grid.ticks,
        centers=time_grid.centers,
        positions=time_grid.positions,
        ticks_per_step=float(time_grid.ticks_per_step),
        ends=time_grid.ends,
        times=time_grid.times,
        sample_positions=time_grid.sample_positions,
        time_steps=time_grid.time_steps.astype(np.float64),
        directions=directions,
        max_distance=float(share * maximum),
    )
