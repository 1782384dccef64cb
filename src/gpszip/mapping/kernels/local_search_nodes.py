"""Whole nodes polished: united with another one, or moved by one quantum, by the coder's real count."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
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


#: Nodes with which one is tried to be united.
_MAX_PARTNERS = 6


@jit
def _error_at(
    samples: GridSamples,
    knot_list: KnotList,
    node: int,
    place: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
) -> float:
    """Squared error that is added when a node, at the knots listed, lies at a place."""
    added = 0.0
    for k in range(count):
        i = knots[k]
        for j in range(i, min(i + 2, knot_list.counts[KNOTS])):
            # a part from the node to itself is met twice
            if knot_list.joined[j] and not (j == i + 1 and knot_list.node[j] == node):
                u, v = knot_list.node[j - 1], knot_list.node[j]
                start = place if u == node else knot_list.places[u]
                end = place if v == node else knot_list.places[v]
                error = segment_error(samples, knot_list.slot[j - 1], start, knot_list.slot[j], end)
                added += error - knot_list.error[j]
    return added


@jit
def _keeps_maximum(
    samples: GridSamples,
    knot_list: KnotList,
    node: int,
    place: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
    maximum: float,
) -> bool:
    for k in range(count):
        i = knots[k]
        for j in range(i, min(i + 2, knot_list.counts[KNOTS])):
            if knot_list.joined[j]:
                u, v = knot_list.node[j - 1], knot_list.node[j]
                start = place if u == node else knot_list.places[u]
                end = place if v == node else knot_list.places[v]
                if not is_within(
                    samples, knot_list.slot[j - 1], start, knot_list.slot[j], end, maximum
                ):
                    return False
    return True


@jit
def _try_move(
    pointers: KernelPointers,
    workspace: CoderWorkspace,
    samples: GridSamples,
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    rule: AcceptanceRule,
    node: int,
    into: int,
    place: NDArray[np.float64],
    knots: NDArray[np.int64],
    count: int,
) -> bool:
    """Put a node's knots at a place, that of the node ``into`` or, if that is the node itself, another one; undo it if it costs."""
    if rule.maximum > 0 and not _keeps_maximum(
        samples, knot_list, node, place, knots, count, rule.maximum
    ):
        return False
    copy_knot_list(knot_list, backup)
    if into == node:
        knot_list.places[node] = place
    else:
        for k in range(count):
            knot_list.node[knots[k]] = into
        knot_list.uses[into] += knot_list.uses[node]
        knot_list.uses[node] = 0
    for k in range(count):
        remeasure(samples, knot_list, knots[k], knots[k] + 1)
    return bool(
        pointers.accept_or_undo(
            pointers.code, workspace, samples.time_steps, knot_list, backup, best, rule
        )
    )


@jit
def _find_merge_partners(
    samples: GridSamples,
    knot_list: KnotList,
    rule: AcceptanceRule,
    fixed: int,
    node: int,
    knots: NDArray[np.int64],
    count: int,
    found: NDArray[np.int64],
) -> int:
    """The nodes with which a node may be united at the least error, and how many they are."""
    added = np.empty(len(found))
    filled = 0
    for w in range(knot_list.counts[NODES]):
        if w == node or (knot_list.uses[w] == 0 and w >= fixed):
            continue
        error = _error_at(samples, knot_list, node, knot_list.places[w], knots, count)
        if rule.price * error > rule.unite or knot_list.totals[SQUARE] + error > rule.most:
            continue
        i = filled
        while i > 0 and added[i - 1] > error:
            i -= 1
        if i < len(found):
            for k in range(min(filled, len(found) - 1), i, -1):
                found[k], added[k] = found[k - 1], added[k - 1]
            found[i], added[i] = w, error
            filled = min(filled + 1, len(found))
    return filled


@jit
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
    """Move a node by one quantum along each axis while that pays; return how often."""
    taken = 0
    for axis in range(knot_list.places.shape[1]):
        for step in (-1.0, 1.0):
            place = knot_list.places[node].copy()
            place[axis] += step
            error = _error_at(samples, knot_list, node, place, knots, count)
            if rule.price * error < rule.move and (
                knot_list.totals[SQUARE] + error <= rule.most or error < 0
            ):
                taken += _try_move(
                    pointers,
                    workspace,
                    samples,
                    knot_list,
                    backup,
                    best,
                    rule,
                    node,
                    node,
                    place,
                    knots,
                    count,
                )
    return taken


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
    """Go once over all nodes, unite and move what pays; return how often."""
    taken = 0
    fixed = workspace.counts[FIXED]
    knots = np.empty(len(knot_list.node), np.int64)
    found = np.empty(_MAX_PARTNERS, np.int64)
    for node in range(knot_list.counts[NODES]):
        if knot_list.uses[node] == 0 or workspace.counts[WORK] <= 0:
            continue
        count = np.int64(0)
        for i in range(knot_list.counts[KNOTS]):
            if knot_list.node[i] == node:
                knots[count] = i
                count += 1
        united = False
        for k in range(
            _find_merge_partners(samples, knot_list, rule, fixed, node, knots, count, found)
        ):
            w = found[k]
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
                knot_list.places[w].copy(),
                knots,
                count,
            ):
                united = True
                break
        if united:
            taken += 1
        elif node >= fixed:
            taken += _shift_node(
                pointers, workspace, samples, knot_list, backup, best, rule, node, knots, count
            )
    return taken
