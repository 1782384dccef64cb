"""Walks polished change by change: each that saves more bits than its error is worth is made, by the coder's real count."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.local_search_bits import (
    FIXED,
    WORK,
    CoderWorkspace,
    encode_all,
    encode_prefix,
)
from gpszip.mapping.kernels.local_search_moves import (
    MAX_TRIALS,
    MIN_SAVING,
    CandidateMoves,
    PriorEdges,
    list_moves,
)
from gpszip.mapping.kernels.local_search_state import (
    BITS,
    KNOTS,
    SQUARE,
    GridSamples,
    KnotList,
    copy_knot_list,
    is_within,
    replace_knots,
)

__all__ = ["AcceptanceRule", "KernelPointers", "accept_or_undo", "sweep_knots"]

#: Knots coded behind those that may change, and knots whose changes share a prefix.
_TAIL, _CHUNK = 12, 8


#: Bits that a change saves at least.
_MIN_GAIN = 1e-6


class KernelPointers(NamedTuple):
    """Kernels that are called but not built in, since those that call them would take long to compile."""

    code: Any  # walk_coder.code_walks
    window: Any  # polish_code.code_window
    accept_or_undo: Any  # decide, below


class AcceptanceRule(NamedTuple):
    """What decides about a change."""

    price: float  # bits for a squared error
    most: float  # largest squared error, also on the way
    bound: float  # largest squared error of the best
    maximum: float  # largest distance of a sample, 0 if there is none
    unite: float  # bits of error that uniting two nodes may cost and be coded
    move: float  # the same for moving one
    bounds: NDArray[np.float64]  # largest squared error of each group in the best
    over: float  # what multiple of it is allowed on the way


@jit
def _cost(knot_list: KnotList, rule: AcceptanceRule) -> float:
    """Bits, and the error at its price."""
    return knot_list.totals[BITS] + rule.price * knot_list.totals[SQUARE]


@jit
def _keep_best(knot_list: KnotList, best: KnotList, rule: AcceptanceRule) -> None:
    """Remember the smallest walks within the bound."""
    if knot_list.totals[SQUARE] <= rule.bound and knot_list.totals[BITS] < best.totals[BITS]:
        for g in range(len(knot_list.squares)):
            if knot_list.squares[g] > rule.bounds[g]:
                return
        copy_knot_list(knot_list, best)


@jit
def _exceeds_group_bound(knot_list: KnotList, backup: KnotList, rule: AcceptanceRule) -> bool:
    """Whether a change brings a group farther beyond its bound."""
    strays = False
    for g in range(len(knot_list.squares)):
        strays |= (
            knot_list.squares[g] > rule.over * rule.bounds[g]
            and knot_list.squares[g] > backup.squares[g]
        )
    return strays


@jit
def _is_allowed(
    samples: GridSamples, knot_list: KnotList, moves: CandidateMoves, rule: AcceptanceRule, row: int
) -> bool:
    """Whether the error stays small enough with an offer."""
    square = knot_list.totals[SQUARE] + moves.error[row]
    if square > rule.most and moves.error[row] > 0:
        return False
    group = samples.groups[knot_list.slot[moves.first[row]]]
    if (
        moves.error[row] > 0
        and knot_list.squares[group] + moves.error[row] > rule.over * rule.bounds[group]
    ):
        return False
    if rule.maximum == 0:
        return True
    first, after, count = moves.first[row], moves.after[row], moves.count[row]
    i = first - 1 if first > 0 and (first == after or knot_list.joined[first]) else -1
    slot, node = (knot_list.slot[i], knot_list.node[i]) if i >= 0 else (np.int64(-1), np.int64(-1))
    for k in range(count + 1):
        if k == count and (after >= knot_list.counts[KNOTS] or not knot_list.joined[after]):
            break
        to = moves.slots[row, k] if k < count else knot_list.slot[after]
        into = moves.nodes[row, k] if k < count else knot_list.node[after]
        if slot >= 0 and not is_within(
            samples, slot, knot_list.places[node], to, knot_list.places[into], rule.maximum
        ):
            return False
        slot, node = to, into
    return True


@jit
def _count_later_uses(workspace: CoderWorkspace, knot_list: KnotList, end: int) -> None:
    for v in range(len(workspace.uses_after_window)):
        workspace.uses_after_window[v] = 0
    for i in range(end, knot_list.counts[KNOTS]):
        workspace.uses_after_window[knot_list.node[i]] += 1


@jit
def accept_or_undo(
    code: Any,
    workspace: CoderWorkspace,
    cells: NDArray[np.int64],
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    rule: AcceptanceRule,
) -> bool:
    """Code walks that were changed; take the change back, from ``spare``, unless it saves."""
    if _exceeds_group_bound(knot_list, backup, rule):
        copy_knot_list(backup, knot_list)
        return False
    knot_list.totals[BITS] = encode_all(code, workspace, knot_list, cells)
    if _cost(knot_list, rule) < _cost(backup, rule) - _MIN_GAIN:
        _keep_best(knot_list, best, rule)
        return True
    copy_knot_list(backup, knot_list)
    return False


@jit
def _improve(
    pointers: KernelPointers,
    workspace: CoderWorkspace,
    samples: GridSamples,
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    moves: CandidateMoves,
    rule: AcceptanceRule,
    start: int,
    end: int,
    base: float,
) -> bool:
    """Code the offers for one knot in a window and make the best change."""
    bits = np.full(moves.filled[0], np.inf)
    for row in range(moves.filled[0]):
        if _is_allowed(samples, knot_list, moves, rule, row):
            window = pointers.window(
                pointers.code, workspace, knot_list, samples.time_steps, start, end, moves.first[row], moves.after[row], moves.count[row],
                moves.slots[row], moves.nodes[row],
            )  # fmt: skip
            bits[row] = window - base + rule.price * moves.error[row]
    for _ in range(np.int64(min(moves.terms[MAX_TRIALS], len(bits)))):
        row = np.argmin(bits)
        if bits[row] > -moves.terms[MIN_SAVING]:
            return False
        copy_knot_list(knot_list, backup)
        if not replace_knots(
            samples,
            knot_list,
            workspace.counts[FIXED],
            moves.first[row],
            moves.after[row],
            moves.count[row],
            moves.slots[row],
            moves.nodes[row],
        ):
            copy_knot_list(backup, knot_list)
        elif pointers.accept_or_undo(
            pointers.code, workspace, samples.time_steps, knot_list, backup, best, rule
        ):
            return True
        bits[row] = np.inf
    return False


@jit
def sweep_knots(
    pointers: KernelPointers,
    workspace: CoderWorkspace,
    samples: GridSamples,
    prior_edges: PriorEdges,
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    moves: CandidateMoves,
    rule: AcceptanceRule,
) -> int:
    """Go once along all walks and change what pays; return how often, ``best`` holds the smallest that was within the bound."""
    taken, start, none = 0, np.int64(0), np.int64(-1)
    while start < knot_list.counts[KNOTS] and workspace.counts[WORK] > 0:
        j = start + 2 if start > 0 else np.int64(0)
        stop = start + 2 + _CHUNK
        encode_prefix(
            pointers.code,
            workspace,
            knot_list,
            samples.time_steps,
            start + 1 if start > 0 else np.int64(0),
        )
        renewed = True
        end, base = np.int64(0), 0.0
        while j < min(stop, knot_list.counts[KNOTS]) and workspace.counts[WORK] > 0:
            if renewed:
                end = min(stop + _TAIL, knot_list.counts[KNOTS])
                _count_later_uses(workspace, knot_list, end)
                base = pointers.window(
                    pointers.code,
                    workspace,
                    knot_list,
                    samples.time_steps,
                    start,
                    end,
                    none,
                    none,
                    np.int64(0),
                    moves.slots[0],
                    moves.nodes[0],
                )
            list_moves(
                samples, knot_list, prior_edges, moves, workspace.counts[FIXED], j, rule.price
            )
            knots = knot_list.counts[KNOTS]
            renewed = _improve(
                pointers, workspace, samples, knot_list, backup, best, moves, rule, start, end, base
            )
            if renewed:
                taken += 1
                stop += knot_list.counts[KNOTS] - knots
            j += 1
        start = max(stop - 2, start + 1)
    return taken
