"""What may become of a knot and those beside it: the changes that look cheapest, by prices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import moments_between
from gpszip.mapping.kernels.local_search_state import (
    KNOTS,
    NODES,
    TEMPORARY,
    GridSamples,
    KnotList,
    segment_error,
)

__all__ = [
    "MAX_EXTRA_BITS",
    "MAX_MOVES",
    "MAX_TRIALS",
    "MIN_SAVING",
    "CandidateMoves",
    "PriorEdges",
    "list_moves",
]

#: Numbers kept in ``Offers.terms``: bits that an offer may look dearer than what is there, how many are coded in full, and the bits of a
#: window that these must promise.
MAX_EXTRA_BITS, MAX_TRIALS, MIN_SAVING = 0, 1, 2

#: Offers kept for a knot.
MAX_MOVES = 32

#: Bits that a knot, a new way and a new node cost about.
_KNOT, _LINK, _PLACE = 5.0, 5.0, 10.0

#: Slots by which a knot may move at once, and slots that are tried for one between two others.
_SHIFT, _TRIES = 2, 8


class PriorEdges(NamedTuple):
    """The ways between nodes that were known before, both directions, those of node v from ``offsets[v]`` on."""

    offsets: NDArray[np.int64]
    into: NDArray[np.int64]


class CandidateMoves(NamedTuple):
    """Changes: knots from ``first`` to before ``after`` become ``count`` others."""

    first: NDArray[np.int64]
    after: NDArray[np.int64]
    count: NDArray[np.int64]
    slots: NDArray[np.int64]
    nodes: NDArray[np.int64]
    error: NDArray[np.float64]  # squared error that is added
    score: NDArray[np.float64]  # bits and price of the error that are added, about
    filled: NDArray[np.int64]
    beside: NDArray[np.int8]  # by node: whether a way leads to the knot before (1) or after (2)
    right: NDArray[np.float64]  # room for one place
    terms: NDArray[np.float64]


@jit
def _add_move(
    moves: CandidateMoves, first: int, after: int, count: int, error: float, score: float
) -> int:
    """Row for an offer, or -1 if it is worse than all those kept."""
    if score >= moves.terms[MAX_EXTRA_BITS]:
        return -1
    row = moves.filled[0]
    if row == MAX_MOVES:
        row = np.int64(0)
        for other in range(MAX_MOVES):
            if moves.score[other] > moves.score[row]:
                row = other
        if moves.score[row] <= score:
            return -1
    else:
        moves.filled[0] += 1
    moves.first[row], moves.after[row], moves.count[row] = first, after, count
    moves.error[row], moves.score[row] = error, score
    return row


@jit
def _mark_linked_nodes(
    knot_list: KnotList,
    prior_edges: PriorEdges,
    moves: CandidateMoves,
    first: int,
    after: int,
    left: int,
    right: int,
) -> None:
    """Note which nodes have a way to the nodes ``left`` and ``right`` besides those of the knots that are to change."""
    beside = moves.beside
    for v in range(len(beside)):
        beside[v] = 0
    for i in range(1, knot_list.counts[KNOTS]):
        if knot_list.joined[i] and (i < first or i > after):
            u, v = knot_list.node[i - 1], knot_list.node[i]
            if u == left:
                beside[v] |= 1
            elif v == left:
                beside[u] |= 1
            if u == right:
                beside[v] |= 2
            elif v == right:
                beside[u] |= 2
    for side in range(2):
        node = left if side == 0 else right
        if 0 <= node < len(prior_edges.offsets) - 1:
            for h in range(prior_edges.offsets[node], prior_edges.offsets[node + 1]):
                beside[prior_edges.into[h]] |= 1 + side


@jit
def _link_bits(moves: CandidateMoves, node: int, left: int, right: int) -> float:
    bits = 0.0
    if left >= 0 and (moves.beside[node] & 1) == 0:
        bits += _LINK
    if right >= 0 and (moves.beside[node] & 2) == 0:
        bits += _LINK
    return bits


@jit
def _quadratic_error(
    samples: GridSamples,
    knot_list: KnotList,
    before: int,
    slot: int,
    behind: int,
    center: NDArray[np.int64],
    right: NDArray[np.float64],
) -> tuple[float, float]:
    """Stiffness K and rest r0 of the squared error K|x|^2 - 2 x.right + r0 of the parts from knot ``before`` to a slot and on.

    x is relative to ``center``; a knot of -1 stands for none.
    """
    dimension = len(right)
    m, n = np.empty(dimension), np.empty(dimension)
    stiffness, rest = 0.0, 0.0
    for axis in range(dimension):
        right[axis] = 0.0
    if before >= 0:
        a = knot_list.slot[before]
        w, u1, u2, q = moments_between(
            samples.sums,
            a,
            slot,
            samples.ticks[a],
            samples.ticks[slot],
            center,
            samples.ticks_per_step,
            m,
            n,
        )
        stiffness += u2
        rest += q
        for axis in range(dimension):
            x = (
                knot_list.places[knot_list.node[before], axis]
                - center[axis] / samples.ticks_per_step
            )
            right[axis] += n[axis] - (u1 - u2) * x
            rest += (w - 2.0 * u1 + u2) * x * x - 2.0 * x * (m[axis] - n[axis])
    if behind >= 0:
        b = knot_list.slot[behind]
        w, u1, u2, q = moments_between(
            samples.sums,
            slot,
            b,
            samples.ticks[slot],
            samples.ticks[b],
            center,
            samples.ticks_per_step,
            m,
            n,
        )
        stiffness += w - 2.0 * u1 + u2
        rest += q
        for axis in range(dimension):
            x = (
                knot_list.places[knot_list.node[behind], axis]
                - center[axis] / samples.ticks_per_step
            )
            right[axis] += m[axis] - n[axis] - (u1 - u2) * x
            rest += u2 * x * x - 2.0 * x * n[axis]
    return stiffness, rest


@jit
def _add_new_node_move(
    samples: GridSamples,
    knot_list: KnotList,
    moves: CandidateMoves,
    first: int,
    after: int,
    slot: int,
    center: NDArray[np.int64],
    quadratic: tuple[float, float],
    step: int,
    price: float,
    old: float,
    bits: float,
) -> None:
    """Offer one knot with a node of its own at the whole place of least error, or ``step`` (1, 2.. up, -1, -2.. down an axis) beside."""
    dimension = len(moves.right)
    stiffness, rest = quadratic
    if stiffness < 1e-9:
        return
    place = np.empty(dimension)
    error = rest - old
    for axis in range(dimension):
        middle = center[axis] / samples.ticks_per_step
        place[axis] = np.rint(moves.right[axis] / stiffness + middle)
        if abs(step) == axis + 1:
            place[axis] += 1.0 if step > 0 else -1.0
        x = place[axis] - middle
        error += stiffness * x * x - 2.0 * x * moves.right[axis]
    row = _add_move(moves, first, after, 1, error, price * error + bits)
    if row >= 0:
        node = len(knot_list.places) - TEMPORARY + row
        knot_list.places[node] = place
        moves.slots[row, 0], moves.nodes[row, 0] = slot, node


@jit
def _add_replacement_moves(
    samples: GridSamples,
    knot_list: KnotList,
    prior_edges: PriorEdges,
    moves: CandidateMoves,
    fixed: int,
    first: int,
    after: int,
    low: int,
    high: int,
    stride: int,
    price: float,
) -> None:
    """Offer a single knot in place of those from ``first`` to before ``after``, at every ``stride``-th slot from low to high."""
    behind = after if after < knot_list.counts[KNOTS] and knot_list.joined[after] else -1
    before = first - 1 if first == after or knot_list.joined[first] else -1
    left = knot_list.node[before] if before >= 0 else -1
    right = knot_list.node[behind] if behind >= 0 else -1
    _mark_linked_nodes(knot_list, prior_edges, moves, first, after, left, right)
    old, bits = 0.0, 0.0
    for i in range(first, after):
        old += knot_list.error[i]
        v = knot_list.node[i]
        knot_list.uses[v] -= 1
        bits -= _KNOT + _link_bits(moves, v, left, right if i == after - 1 else -1)
        if knot_list.uses[v] == 0 and v >= fixed:
            bits -= _PLACE
    if behind >= 0:
        old += knot_list.error[behind]
    bits += _KNOT
    links = (_LINK if left >= 0 else 0.0) + (0.5 * _LINK if right >= 0 else 0.0)
    for slot in range(low, high + 1, stride):
        center = samples.centers[slot]
        quadratic = _quadratic_error(samples, knot_list, before, slot, behind, center, moves.right)
        lowest = quadratic[1] - old
        for axis in range(len(center)):
            lowest -= moves.right[axis] * moves.right[axis] / max(quadratic[0], 1e-9)
        if price * lowest + bits >= moves.terms[MAX_EXTRA_BITS]:
            continue
        for v in range(knot_list.counts[NODES]):
            if knot_list.uses[v] == 0 and v >= fixed:
                continue
            if after == first + 1 and slot == knot_list.slot[first] and v == knot_list.node[first]:
                continue
            error = quadratic[1] - old
            for axis in range(len(center)):
                x = knot_list.places[v, axis] - center[axis] / samples.ticks_per_step
                error += quadratic[0] * x * x - 2.0 * x * moves.right[axis]
            score = price * error + bits
            if score < moves.terms[MAX_EXTRA_BITS]:
                score += _link_bits(moves, v, left, right)
                row = _add_move(moves, first, after, 1, error, score)
                if row >= 0:
                    moves.slots[row, 0], moves.nodes[row, 0] = slot, v
        _add_new_node_move(
            samples,
            knot_list,
            moves,
            first,
            after,
            slot,
            center,
            quadratic,
            np.int64(0),
            price,
            old,
            bits + _PLACE + links,
        )
        if (
            after == first + 1
            and knot_list.uses[knot_list.node[first]] == 0
            and slot == knot_list.slot[first]
        ):
            for axis in range(len(center)):
                _add_new_node_move(
                    samples,
                    knot_list,
                    moves,
                    first,
                    after,
                    slot,
                    center,
                    quadratic,
                    axis + 1,
                    price,
                    old,
                    bits + _PLACE + links,
                )
                _add_new_node_move(
                    samples,
                    knot_list,
                    moves,
                    first,
                    after,
                    slot,
                    center,
                    quadratic,
                    -axis - 1,
                    price,
                    old,
                    bits + _PLACE + links,
                )
    for i in range(first, after):
        knot_list.uses[knot_list.node[i]] += 1


@jit
def _is_inside_piece(knot_list: KnotList, j: int) -> bool:
    """Whether a knot lies inside a piece."""
    return (
        0 < j < knot_list.counts[KNOTS] - 1
        and knot_list.joined[j] == 1
        and knot_list.joined[j + 1] == 1
    )


@jit
def _add_removal_moves(
    samples: GridSamples,
    knot_list: KnotList,
    moves: CandidateMoves,
    fixed: int,
    j: int,
    price: float,
) -> None:
    """Offer to leave out a knot, and to move those beside it by up to one slot then."""
    a, b = j - 1, j + 1
    u, v = knot_list.node[a], knot_list.node[b]
    back, forth = (
        1 if _is_inside_piece(knot_list, a) else 0,
        1 if _is_inside_piece(knot_list, b) else 0,
    )
    bits = -_KNOT - (
        _PLACE if knot_list.uses[knot_list.node[j]] == 1 and knot_list.node[j] >= fixed else 0.0
    )
    for p in range(-back, back + 1):
        at = knot_list.slot[a] + p
        if p != 0 and at <= knot_list.slot[a - 1]:
            continue
        lead = (
            segment_error(
                samples,
                knot_list.slot[a - 1],
                knot_list.places[knot_list.node[a - 1]],
                at,
                knot_list.places[u],
            )
            - knot_list.error[a]
            if p != 0
            else 0.0
        )
        for q in range(-forth, forth + 1):
            to = knot_list.slot[b] + q
            if to <= at or (q != 0 and to >= knot_list.slot[b + 1]):
                continue
            tail = (
                segment_error(
                    samples,
                    to,
                    knot_list.places[v],
                    knot_list.slot[b + 1],
                    knot_list.places[knot_list.node[b + 1]],
                )
                - knot_list.error[b + 1]
                if q != 0
                else 0.0
            )
            error = (
                lead
                + tail
                + segment_error(samples, at, knot_list.places[u], to, knot_list.places[v])
                - knot_list.error[j]
                - knot_list.error[b]
            )
            row = _add_move(moves, a, b + 1, 2, error, price * error + bits)
            if row >= 0:
                moves.slots[row, 0], moves.slots[row, 1] = at, to
                moves.nodes[row, 0], moves.nodes[row, 1] = u, v


@jit
def list_moves(
    samples: GridSamples,
    knot_list: KnotList,
    prior_edges: PriorEdges,
    moves: CandidateMoves,
    fixed: int,
    j: int,
    price: float,
) -> None:
    """List what may become of knot j: moved, given another node, left out, made one with the next, or followed by another."""
    moves.filled[0] = 0
    knots = knot_list.counts[KNOTS]
    here = knot_list.slot[j]
    inner = _is_inside_piece(knot_list, j)
    low = max(here - _SHIFT, knot_list.slot[j - 1] + 1) if inner else here
    high = min(here + _SHIFT, knot_list.slot[j + 1] - 1) if inner else here
    _add_replacement_moves(
        samples, knot_list, prior_edges, moves, fixed, j, j + 1, low, high, np.int64(1), price
    )
    if inner:
        _add_removal_moves(samples, knot_list, moves, fixed, j, price)
    if inner and _is_inside_piece(knot_list, j + 1):
        low, high = knot_list.slot[j - 1] + 1, knot_list.slot[j + 2] - 1
        _add_replacement_moves(
            samples,
            knot_list,
            prior_edges,
            moves,
            fixed,
            j,
            j + 2,
            low,
            high,
            (high - low) // _TRIES + 1,
            price,
        )
    if (
        j + 1 < knots
        and knot_list.joined[j + 1]
        and price * knot_list.error[j + 1] > _KNOT - moves.terms[MAX_EXTRA_BITS]
    ):
        low, high = here + 1, knot_list.slot[j + 1] - 1
        if low <= high:
            _add_replacement_moves(
                samples,
                knot_list,
                prior_edges,
                moves,
                fixed,
                j + 1,
                j + 1,
                low,
                high,
                (high - low) // _TRIES + 1,
                price,
            )
