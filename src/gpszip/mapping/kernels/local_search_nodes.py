"""Local search over nodes: merge one with another, or move it by one grid step, by real bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner, inner_uncounted, jit
from gpszip.mapping.kernels.local_search import AcceptanceRule, KernelPointers
from gpszip.mapping.kernels.local_search_bits import FIXED, WORK, CoderWorkspace
from gpszip.mapping.kernels.local_search_state import (
    KNOTS,
    NODES,
    SQUARE,
    GridSamples,
    KnotList,
    copy_knot_list,
    is_within,
    remeasure,
    segment_error,
)

__all__ = ["sweep_nodes"]

#: Largest number of nodes with which a node is tried to be merged.
_MAX_PARTNERS = 6


@inner_uncounted
def _added_error(
    samples: GridSamples,
    knot_list: KnotList,
    node: int,
    position: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
) -> float:
    """Squared error that is added when a node, at the ``count`` knots listed, moves."""
    added = 0.0
    for k in range(count):
        i = knots[k]
        for j in range(i, min(i + 2, knot_list.counts[KNOTS])):
            # A segment from the node to itself would be met twice.
            if knot_list.joined[j] and not (j == i + 1 and knot_list.nodes[j] == node):
                u, v = knot_list.nodes[j - 1], knot_list.nodes[j]
                start = position if u == node else knot_list.positions[u]
                end = position if v == node else knot_list.positions[v]
                error = segment_error(
                    samples, knot_list.slots[j - 1], start, knot_list.slots[j], end
                )
                added += error - knot_list.errors[j]
    return added


@inner_uncounted
def _keeps_maximum(
    samples: GridSamples,
    knot_list: KnotList,
    node: int,
    position: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
    maximum: float,
) -> bool:
    """Whether no sample is farther away than a maximum when a node moves."""
    for k in range(count):
        i = knots[k]
        for j in range(i, min(i + 2, knot_list.counts[KNOTS])):
            if knot_list.joined[j]:
                u, v = knot_list.nodes[j - 1], knot_list.nodes[j]
                start = position if u == node else knot_list.positions[u]
                end = position if v == node else knot_list.positions[v]
                if not is_within(
                    samples, knot_list.slots[j - 1], start, knot_list.slots[j], end, maximum
                ):
                    return False
    return True


@inner_uncounted
def _try_move(
    pointers: KernelPointers,
    workspace: CoderWorkspace,
    samples: GridSamples,
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    rule: AcceptanceRule,
    node: int,
    target: int,
    position: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
) -> bool:
    """Move the knots of a node to a position, and undo it unless it pays.

    The position is that of the node ``target``, which takes the knots; or, if ``target`` is the
    node itself, any other.
    """
    # Under a maximum, no sample may end up farther away than that.
    if rule.maximum > 0 and not _keeps_maximum(
        samples, knot_list, node, position, knots, count, rule.maximum
    ):
        return False

    # Make the move.
    copy_knot_list(knot_list, backup)
    if target == node:
        copy_values(position, knot_list.positions[node])
    else:
        for k in range(count):
            knot_list.nodes[knots[k]] = target
        knot_list.uses[target] += knot_list.uses[node]
        knot_list.uses[node] = 0
    for k in range(count):
        remeasure(samples, knot_list, knots[k], knots[k] + 1)

    # Encode the walks, and restore the backup unless the move is accepted.
    return bool(
        pointers.accept_or_undo(
            pointers.code, workspace, samples.time_steps, knot_list, backup, best, rule
        )
    )


@inner
def _find_merge_partners(
    samples: GridSamples,
    knot_list: KnotList,
    rule: AcceptanceRule,
    fixed: int,
    node: int,
    knots: NDArray[np.int64],
    count: int,
    partners: NDArray[np.int64],
) -> int:
    """List the nodes into which a node merges at the least error, and return their number."""
    # Measure the error that a merge adds; leave out nodes beyond the price or the bound.
    added = np.empty(len(partners))
    filled = 0
    for w in range(knot_list.counts[NODES]):
        if w == node or (knot_list.uses[w] == 0 and w >= fixed):
            continue
        error = _added_error(samples, knot_list, node, knot_list.positions[w], knots, count)
        if (
            rule.price * error > rule.merge_bits
            or knot_list.totals[SQUARE] + error > rule.max_square
        ):
            continue

        # Insert the node by its error.
        i = filled
        while i > 0 and added[i - 1] > error:
            i -= 1
        if i < len(partners):
            for k in range(min(filled, len(partners) - 1), i, -1):
                partners[k], added[k] = partners[k - 1], added[k - 1]
            partners[i], added[i] = w, error
            filled = min(filled + 1, len(partners))
    return filled


@inner
def _shift_node(
    pointers: KernelPointers,
    workspace: CoderWorkspace,
    samples: GridSamples,
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    rule: AcceptanceRule,
    node: int,
    knots: NDArray[np.int64],
    count: int,
) -> int:
    """Move a node by one grid step along each axis where that pays; return how often."""
    # Try a step down and a step up along each axis.
    changes = 0
    for axis in range(knot_list.positions.shape[1]):
        for step in (-1.0, 1.0):
            # Measure the error of the shift.
            position = knot_list.positions[node].copy()
            position[axis] += step
            error = _added_error(samples, knot_list, node, position, knots, count)

            # Encode it if the error is small, or falls.
            if rule.price * error < rule.shift_bits and (
                knot_list.totals[SQUARE] + error <= rule.max_square or error < 0
            ):
                changes += _try_move(
                    pointers,
                    workspace,
                    samples,
                    knot_list,
                    backup,
                    best,
                    rule,
                    node,
                    node,
                    position,
                    knots,
                    count,
                )
    return changes


@jit
def sweep_nodes(
    pointers: KernelPointers,
    workspace: CoderWorkspace,
    samples: GridSamples,
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    rule: AcceptanceRule,
) -> int:
    """Go once over all nodes; merge and move them where that pays.

    Returns
    -------
    int
        Number of changes.
    """
    # Leave out nodes without knots, and all others once the work is used up.
    changes = 0
    fixed = workspace.counts[FIXED]
    knots = np.empty(len(knot_list.nodes), np.int64)
    partners = np.empty(_MAX_PARTNERS, np.int64)
    for node in range(knot_list.counts[NODES]):
        if knot_list.uses[node] == 0 or workspace.counts[WORK] <= 0:
            continue

        # List the knots of the node.
        count = np.int64(0)
        for i in range(knot_list.counts[KNOTS]):
            if knot_list.nodes[i] == node:
                knots[count] = i
                count += 1

        # Merge the node into another one.
        is_merged = False
        for k in range(
            _find_merge_partners(samples, knot_list, rule, fixed, node, knots, count, partners)
        ):
            w = partners[k]
            if _try_move(
                pointers,
                workspace,
                samples,
                knot_list,
                backup,
                best,
                rule,
                node,
                w,
                knot_list.positions[w].copy(),
                knots,
                count,
            ):
                is_merged = True
                break

        # Else move it; nodes of prior walks stay.
        if is_merged:
            changes += 1
        elif node >= fixed:
            changes += _shift_node(
                pointers, workspace, samples, knot_list, backup, best, rule, node, knots, count
            )
    return changes
