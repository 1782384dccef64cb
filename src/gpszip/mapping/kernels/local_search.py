"""Local search over knots: each change that saves more bits than its error is worth is made.

The coder counts the bits of each candidate move: at first of the knots around it only, then, for
the best ones, of all walks, since its model adapts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit_uncounted
from gpszip.mapping.kernels.local_search_bits import (
    FIXED,
    WORK,
    CoderWorkspace,
    encode_all,
    encode_prefix,
)
from gpszip.mapping.kernels.local_search_moves import (
    MOVE_COUNT,
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

#: Knots that are encoded behind those that may change, for what the change does to the model.
_TAIL = 12

#: Knots whose moves share a prefix.
_CHUNK = 8

#: Moves of one knot that are encoded in full.
_MAX_TRIALS = 4

#: Bits that a change saves at least.
_MIN_GAIN = 1e-6

#: Stands for no knot.
_NONE = -1


class KernelPointers(NamedTuple):
    """Pointers to kernels that are slow to compile into each caller."""

    code: Any  # codec.kernels.walk_coder.code_walks
    window: Any  # local_search_bits.encode_window
    accept_or_undo: Any  # accept_or_undo, below


class AcceptanceRule(NamedTuple):
    """When a change is accepted; squared errors are in squared grid steps."""

    price: float  # bits for a squared error
    max_square: float  # largest squared error on the way
    bound: float  # largest squared error of the best walks
    maximum: float  # largest distance of a sample, 0 for none
    merge_bits: float  # bits of error up to which a merge of two nodes is encoded
    shift_bits: float  # the same for a shift of a node
    group_bounds: NDArray[np.float64]  # largest squared error of each group in the best walks
    overshoot: float  # multiple of the group bounds that is allowed on the way


@inner_uncounted
def _cost(knot_list: KnotList, rule: AcceptanceRule) -> float:
    """Rate-distortion cost J = bits + price * squared error."""
    return knot_list.totals[BITS] + rule.price * knot_list.totals[SQUARE]


@inner_uncounted
def _keep_best(knot_list: KnotList, best: KnotList, rule: AcceptanceRule) -> None:
    """Copy the walks to ``best`` if they are the smallest within all bounds."""
    if knot_list.totals[SQUARE] <= rule.bound and knot_list.totals[BITS] < best.totals[BITS]:
        for g in range(len(knot_list.group_squares)):
            if knot_list.group_squares[g] > rule.group_bounds[g]:
                return
        copy_knot_list(knot_list, best)


@inner_uncounted
def _exceeds_group_bound(knot_list: KnotList, backup: KnotList, rule: AcceptanceRule) -> bool:
    """Whether a change brings a group farther beyond its bound."""
    exceeds = False
    for g in range(len(knot_list.group_squares)):
        exceeds |= (
            knot_list.group_squares[g] > rule.overshoot * rule.group_bounds[g]
            and knot_list.group_squares[g] > backup.group_squares[g]
        )
    return exceeds


@inner_uncounted
def _is_allowed(
    samples: GridSamples, knot_list: KnotList, moves: CandidateMoves, rule: AcceptanceRule, row: int
) -> bool:
    """Whether the errors stay within their bounds with a move."""
    # A move that lowers the error is always allowed.
    error = moves.errors[row]
    if knot_list.totals[SQUARE] + error > rule.max_square and error > 0:
        return False
    group = samples.groups[knot_list.slots[moves.first[row]]]
    if (
        error > 0
        and knot_list.group_squares[group] + error > rule.overshoot * rule.group_bounds[group]
    ):
        return False
    if rule.maximum == 0:
        return True

    # Check the samples of each new segment, from the knot before to the one after.
    first, after, count = moves.first[row], moves.after[row], moves.count[row]
    i = first - 1 if first > 0 and (first == after or knot_list.joined[first]) else -1
    slot, node = (
        (knot_list.slots[i], knot_list.nodes[i]) if i >= 0 else (np.int64(-1), np.int64(-1))
    )
    for k in range(count + 1):
        if k == count and (after >= knot_list.counts[KNOTS] or not knot_list.joined[after]):
            break
        next_slot = moves.slots[row, k] if k < count else knot_list.slots[after]
        next_node = moves.nodes[row, k] if k < count else knot_list.nodes[after]
        if slot >= 0 and not is_within(
            samples,
            slot,
            knot_list.positions[node],
            next_slot,
            knot_list.positions[next_node],
            rule.maximum,
        ):
            return False
        slot, node = next_slot, next_node
    return True


@inner_uncounted
def _count_later_uses(workspace: CoderWorkspace, knot_list: KnotList, end: int) -> None:
    """Count the uses of each node from knot ``end`` on."""
    for v in range(len(workspace.uses_after_window)):
        workspace.uses_after_window[v] = 0
    for i in range(end, knot_list.counts[KNOTS]):
        workspace.uses_after_window[knot_list.nodes[i]] += 1


@jit_uncounted
def accept_or_undo(
    code: Any,
    workspace: CoderWorkspace,
    time_steps: NDArray[np.int64],
    knot_list: KnotList,
    backup: KnotList,
    best: KnotList,
    rule: AcceptanceRule,
) -> bool:
    """Encode changed walks; unless the change pays, restore the walks of ``backup``.

    Returns
    -------
    bool
        Whether the change was accepted.
    """
    if _exceeds_group_bound(knot_list, backup, rule):
        copy_knot_list(backup, knot_list)
        return False

    knot_list.totals[BITS] = encode_all(code, workspace, knot_list, time_steps)
    if _cost(knot_list, rule) < _cost(backup, rule) - _MIN_GAIN:
        _keep_best(knot_list, best, rule)
        return True
    copy_knot_list(backup, knot_list)
    return False


@inner
def _try_moves(
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
    window_bits: float,
) -> bool:
    """Encode the moves of a knot in the window [start, end), and make the best one that pays.

    ``window_bits`` is the number of bits of the window without a change.
    """
    # Cost that each move adds by the bits of the window.
    costs = np.full(moves.counts[MOVE_COUNT], np.inf)
    for row in range(moves.counts[MOVE_COUNT]):
        if _is_allowed(samples, knot_list, moves, rule, row):
            bits = pointers.window(
                pointers.code,
                workspace,
                knot_list,
                samples.time_steps,
                start,
                end,
                moves.first[row],
                moves.after[row],
                moves.count[row],
                moves.slots[row],
                moves.nodes[row],
            )
            costs[row] = bits - window_bits + rule.price * moves.errors[row]

    # Encode all walks with the cheapest moves, one after the other, until one pays.
    for _ in range(min(_MAX_TRIALS, len(costs))):
        row = np.argmin(costs)
        if costs[row] > 0.0:
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
        costs[row] = np.inf
    return False


@jit_uncounted
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
    """Go once along all walks, and make the changes that pay.

    Parameters
    ----------
    pointers : KernelPointers
        Kernels to call.
    workspace : CoderWorkspace
        The coder; its work is counted down, and ends the sweep at 0.
    samples : GridSamples
        Slots and samples.
    prior_edges : PriorEdges
        Edges of prior walks.
    knot_list, backup, best : KnotList
        The walks, a copy to undo a change from, and the smallest walks within the bound.
    moves : CandidateMoves
        Scratch space for the moves of one knot.
    rule : AcceptanceRule
        When a change is accepted.

    Returns
    -------
    int
        Number of changes.
    """
    # Go along the walks by chunks of knots: all moves of a chunk are encoded after one prefix.
    changes, start, none = 0, np.int64(0), np.int64(_NONE)
    while start < knot_list.counts[KNOTS] and workspace.counts[WORK] > 0:
        # Encode the prefix of a chunk of knots. Moves reach back to the knot before the one
        # before, so that the prefix ends two knots before the chunk.
        j = start + 2 if start > 0 else np.int64(0)
        stop = start + 2 + _CHUNK
        encode_prefix(
            pointers.code,
            workspace,
            knot_list,
            samples.time_steps,
            start + 1 if start > 0 else np.int64(0),
        )

        # Go through the knots of the chunk, which grows or shrinks with the changes made.
        has_changed = True
        end, window_bits = np.int64(0), 0.0
        while j < min(stop, knot_list.counts[KNOTS]) and workspace.counts[WORK] > 0:
            # Encode the window as it is, at first and after each change.
            if has_changed:
                end = min(stop + _TAIL, knot_list.counts[KNOTS])
                _count_later_uses(workspace, knot_list, end)
                window_bits = pointers.window(
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

            # Try the moves of knot j.
            list_moves(
                samples, knot_list, prior_edges, moves, workspace.counts[FIXED], j, rule.price
            )
            knots = knot_list.counts[KNOTS]
            has_changed = _try_moves(
                pointers,
                workspace,
                samples,
                knot_list,
                backup,
                best,
                moves,
                rule,
                start,
                end,
                window_bits,
            )
            if has_changed:
                changes += 1
                stop += knot_list.counts[KNOTS] - knots
            j += 1
        start = max(stop - 2, start + 1)
    return changes
