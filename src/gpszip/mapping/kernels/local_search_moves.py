"""Candidate moves of a local search: changes of a knot and its neighbours that look cheapest.

The bits of a move are estimated by fixed prices here; the coder counts those of the best ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner, inner_uncounted
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
    "MAX_MOVES",
    "MOVE_COUNT",
    "CandidateMoves",
    "PriorEdges",
    "list_moves",
]

#: Index in ``CandidateMoves.counts`` of the number of moves listed.
MOVE_COUNT = 0

#: Candidate moves kept for a knot, each with a temporary node.
MAX_MOVES = TEMPORARY

#: About the bits of a knot.
_KNOT_BITS = 5.0
#: About the bits of a step along a new edge, beyond those of a known one.
_EDGE_BITS = 5.0
#: About the bits of a new node's position.
_NODE_BITS = 10.0

#: Slots by which a knot may move at once.
_MAX_SHIFT = 2

#: Slots that are tried for a knot between two others.
_MAX_TRIED_SLOTS = 8

#: Stiffness below which no sample holds a knot.
_MIN_STIFFNESS = 1e-9

#: Flags of ``CandidateMoves.links``: an edge leads to the knot before, and to the one after.
_LINKED_BEFORE = 1
_LINKED_AFTER = 2


class PriorEdges(NamedTuple):
    """Edges of prior walks in CSR form, both directions."""

    offsets: NDArray[np.int64]  # first edge of each node
    ends: NDArray[np.int64]  # node that each edge leads to


class CandidateMoves(NamedTuple):
    """Candidate moves: the knots from ``first`` to before ``after`` become ``count`` others."""

    first: NDArray[np.int64]
    after: NDArray[np.int64]
    count: NDArray[np.int64]
    slots: NDArray[np.int64]  # of the new knots, shape (MAX_MOVES, 2)
    nodes: NDArray[np.int64]  # of the new knots, shape (MAX_MOVES, 2)
    errors: NDArray[np.float64]  # squared error that is added
    scores: NDArray[np.float64]  # about the bits that are added, with the price of the error
    counts: NDArray[np.int64]  # by MOVE_COUNT
    links: NDArray[np.int8]  # flags of each node, see above
    linear: NDArray[np.float64]  # linear terms of an error, shape (d,)
    max_extra_bits: float  # score from which on a move is left out


class _Replacement(NamedTuple):
    """Knots that a single new one replaces."""

    first: int  # first knot
    after: int  # knot after the last
    before: int  # knot that a segment leads from, or -1
    behind: int  # knot that a segment leads to, or -1
    left: int  # node of the knot before, or -1
    right: int  # node of the knot behind, or -1
    old_error: float  # squared error of the segments that go
    bits: float  # about the bits that are added, but for the new knot's node


class _Quadratic(NamedTuple):
    """Squared error K|x|^2 - 2 x.b + r of a knot at x; b is in ``CandidateMoves.linear``."""

    stiffness: float  # K
    constant: float  # r


@inner_uncounted
def _add_move(
    moves: CandidateMoves, first: int, after: int, count: int, error: float, score: float
) -> int:
    """Row of a new move, or -1 if it scores worse than all those kept."""
    # A move whose estimated extra bits reach the maximum is not worth encoding.
    if score >= moves.max_extra_bits:
        return -1

    # A full list drops its worst move.
    row = moves.counts[MOVE_COUNT]
    if row == MAX_MOVES:
        row = np.int64(0)
        for other in range(MAX_MOVES):
            if moves.scores[other] > moves.scores[row]:
                row = other
        if moves.scores[row] <= score:
            return -1
    else:
        moves.counts[MOVE_COUNT] += 1

    # Enter what the move replaces; the caller adds the new slots and nodes.
    moves.first[row], moves.after[row], moves.count[row] = first, after, count
    moves.errors[row], moves.scores[row] = error, score
    return row


@inner_uncounted
def _mark_linked_nodes(
    knot_list: KnotList,
    prior_edges: PriorEdges,
    moves: CandidateMoves,
    first: int,
    after: int,
    left: int,
    right: int,
) -> None:
    """Mark the nodes that share an edge with the nodes ``left`` and ``right``.

    Steps from and to the knots that change do not count.
    """
    # Clear the marks of the knots before.
    links = moves.links
    for v in range(len(links)):
        links[v] = 0

    # Edges of the walks.
    for i in range(1, knot_list.counts[KNOTS]):
        if knot_list.joined[i] and (i < first or i > after):
            u, v = knot_list.nodes[i - 1], knot_list.nodes[i]
            if u == left:
                links[v] |= _LINKED_BEFORE
            elif v == left:
                links[u] |= _LINKED_BEFORE
            if u == right:
                links[v] |= _LINKED_AFTER
            elif v == right:
                links[u] |= _LINKED_AFTER

    # Edges of prior walks.
    for side in range(2):
        node = left if side == 0 else right
        if 0 <= node < len(prior_edges.offsets) - 1:
            for h in range(prior_edges.offsets[node], prior_edges.offsets[node + 1]):
                links[prior_edges.ends[h]] |= _LINKED_BEFORE if side == 0 else _LINKED_AFTER


@inner_uncounted
def _link_bits(moves: CandidateMoves, node: int, left: int, right: int) -> float:
    """Bits of the new edges from a node to its neighbours; -1 stands for no neighbour."""
    bits = 0.0
    if left >= 0 and (moves.links[node] & _LINKED_BEFORE) == 0:
        bits += _EDGE_BITS
    if right >= 0 and (moves.links[node] & _LINKED_AFTER) == 0:
        bits += _EDGE_BITS
    return bits


@inner
def _quadratic_error(
    samples: GridSamples,
    knot_list: KnotList,
    before: int,
    slot: int,
    behind: int,
    center: NDArray[np.int64],
    linear: NDArray[np.float64],
) -> _Quadratic:
    """Squared error of the segments from knot ``before`` to a slot, and on to knot ``behind``.

    It is K|x|^2 - 2 x.b + r for the knot's position x relative to ``center``; ``linear`` receives
    b. A knot of -1 stands for none. With the moments of :mod:`grid_moments` and the other end of a
    segment at y, the segment that ends in x adds

        K += U2,  b += N - (U1 - U2) y,  r += Q + (W - 2 U1 + U2) |y|^2 - 2 y.(M - N)

    and the segment that starts in x adds

        K += W - 2 U1 + U2,  b += M - N - (U1 - U2) y,  r += Q + U2 |y|^2 - 2 y.N
    """
    # Without segments, K, b and r are 0.
    dimension = len(linear)
    m, n = np.empty(dimension), np.empty(dimension)
    stiffness, constant = 0.0, 0.0
    for axis in range(dimension):
        linear[axis] = 0.0

    # The segment that ends in the knot.
    if before >= 0:
        a = knot_list.slots[before]
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
        constant += q
        for axis in range(dimension):
            y = (
                knot_list.positions[knot_list.nodes[before], axis]
                - center[axis] / samples.ticks_per_step
            )
            linear[axis] += n[axis] - (u1 - u2) * y
            constant += (w - 2.0 * u1 + u2) * y * y - 2.0 * y * (m[axis] - n[axis])

    # The segment that starts in the knot.
    if behind >= 0:
        b = knot_list.slots[behind]
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
        constant += q
        for axis in range(dimension):
            y = (
                knot_list.positions[knot_list.nodes[behind], axis]
                - center[axis] / samples.ticks_per_step
            )
            linear[axis] += m[axis] - n[axis] - (u1 - u2) * y
            constant += u2 * y * y - 2.0 * y * n[axis]
    return _Quadratic(stiffness, constant)


@inner_uncounted
def _take_out_knots(
    knot_list: KnotList,
    prior_edges: PriorEdges,
    moves: CandidateMoves,
    fixed: int,
    first: int,
    after: int,
) -> _Replacement:
    """Take the uses of the knots from ``first`` to before ``after`` out, and sum up what they save.

    :func:`_put_back_knots` undoes it.
    """
    # Find the neighbours in the same piece, and the nodes that share an edge with them.
    behind = after if after < knot_list.counts[KNOTS] and knot_list.joined[after] else -1
    before = first - 1 if first == after or knot_list.joined[first] else -1
    left = knot_list.nodes[before] if before >= 0 else -1
    right = knot_list.nodes[behind] if behind >= 0 else -1
    _mark_linked_nodes(knot_list, prior_edges, moves, first, after, left, right)

    # Knots save their own bits, those of their edges, and those of nodes that nobody else uses.
    old_error, bits = 0.0, 0.0
    for i in range(first, after):
        old_error += knot_list.errors[i]
        v = knot_list.nodes[i]
        knot_list.uses[v] -= 1
        bits -= _KNOT_BITS + _link_bits(moves, v, left, right if i == after - 1 else -1)
        if knot_list.uses[v] == 0 and v >= fixed:
            bits -= _NODE_BITS
    if behind >= 0:
        old_error += knot_list.errors[behind]
    bits += _KNOT_BITS
    return _Replacement(first, after, before, behind, left, right, old_error, bits)


@inner_uncounted
def _put_back_knots(knot_list: KnotList, first: int, after: int) -> None:
    """Count the uses of the knots from ``first`` to before ``after`` again."""
    for i in range(first, after):
        knot_list.uses[knot_list.nodes[i]] += 1


@inner_uncounted
def _lowest_error(moves: CandidateMoves, quadratic: _Quadratic, old_error: float) -> float:
    """Least squared error that a knot adds anywhere: r - |b|^2 / K, less the old error."""
    lowest = quadratic.constant - old_error
    for axis in range(len(moves.linear)):
        lowest -= moves.linear[axis] * moves.linear[axis] / max(quadratic.stiffness, _MIN_STIFFNESS)
    return lowest


@inner_uncounted
def _add_known_node_moves(
    samples: GridSamples,
    knot_list: KnotList,
    moves: CandidateMoves,
    fixed: int,
    replacement: _Replacement,
    slot: int,
    center: NDArray[np.int64],
    quadratic: _Quadratic,
    price: float,
) -> None:
    """Add the moves to a knot at a slot, at each node of the map."""
    # Leave out nodes without knots, unless they belong to prior walks.
    first = replacement.first
    for v in range(knot_list.counts[NODES]):
        if knot_list.uses[v] == 0 and v >= fixed:
            continue
        # The knot as it is now is no move.
        if (
            replacement.after == first + 1
            and slot == knot_list.slots[first]
            and v == knot_list.nodes[first]
        ):
            continue

        # Price the error K|x|^2 - 2 x.b + r at the node, less the old one, then the edges it lacks.
        error = quadratic.constant - replacement.old_error
        for axis in range(len(center)):
            x = knot_list.positions[v, axis] - center[axis] / samples.ticks_per_step
            error += quadratic.stiffness * x * x - 2.0 * x * moves.linear[axis]
        score = price * error + replacement.bits
        if score < moves.max_extra_bits:
            score += _link_bits(moves, v, replacement.left, replacement.right)
            row = _add_move(moves, first, replacement.after, 1, error, score)
            if row >= 0:
                moves.slots[row, 0], moves.nodes[row, 0] = slot, v


@inner
def _add_new_node_move(
    samples: GridSamples,
    knot_list: KnotList,
    moves: CandidateMoves,
    replacement: _Replacement,
    slot: int,
    center: NDArray[np.int64],
    quadratic: _Quadratic,
    step: int,
    price: float,
    bits: float,
) -> None:
    """Add the move to a knot with a new node, at the whole position of least error x = b / K.

    A ``step`` of 1, 2, ... goes one grid step up the first, second, ... axis from there, and one
    of -1, -2, ... goes down.
    """
    # Without stiffness, no sample holds the knot: there is no best position.
    dimension = len(moves.linear)
    if quadratic.stiffness < _MIN_STIFFNESS:
        return

    # Round the optimum, and measure the error there.
    position = np.empty(dimension)
    error = quadratic.constant - replacement.old_error
    for axis in range(dimension):
        middle = center[axis] / samples.ticks_per_step
        position[axis] = np.rint(moves.linear[axis] / quadratic.stiffness + middle)
        if abs(step) == axis + 1:
            position[axis] += 1.0 if step > 0 else -1.0
        x = position[axis] - middle
        error += quadratic.stiffness * x * x - 2.0 * x * moves.linear[axis]

    # The node stays temporary until the move is made.
    row = _add_move(moves, replacement.first, replacement.after, 1, error, price * error + bits)
    if row >= 0:
        node = len(knot_list.positions) - TEMPORARY + row
        copy_values(position, knot_list.positions[node])
        moves.slots[row, 0], moves.nodes[row, 0] = slot, node


@inner
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
    """Add the moves to a single knot in place of those from ``first`` to before ``after``.

    Each ``stride``-th slot from ``low`` to ``high`` is tried, with known nodes and with a new one.
    """
    # Take the old knots out, so that what only they use counts as saved.
    replacement = _take_out_knots(knot_list, prior_edges, moves, fixed, first, after)

    # A new node pays for its position and its edges; the way on may be known already.
    new_edge_bits = (_EDGE_BITS if replacement.left >= 0 else 0.0) + (
        0.5 * _EDGE_BITS if replacement.right >= 0 else 0.0
    )
    new_node_bits = replacement.bits + _NODE_BITS + new_edge_bits

    # Express the error of a knot at each slot as a quadratic of the knot's position.
    for slot in range(low, high + 1, stride):
        center = samples.centers[slot]
        quadratic = _quadratic_error(
            samples, knot_list, replacement.before, slot, replacement.behind, center, moves.linear
        )

        # Skip slots where even the best position costs too much.
        lowest = _lowest_error(moves, quadratic, replacement.old_error)
        if price * lowest + replacement.bits >= moves.max_extra_bits:
            continue

        # Try the known nodes, then a new node at the position of least error.
        _add_known_node_moves(
            samples, knot_list, moves, fixed, replacement, slot, center, quadratic, price
        )
        _add_new_node_move(
            samples,
            knot_list,
            moves,
            replacement,
            slot,
            center,
            quadratic,
            np.int64(0),
            price,
            new_node_bits,
        )

        # A node that only this knot uses may also move by one grid step.
        if (
            after == first + 1
            and knot_list.uses[knot_list.nodes[first]] == 0
            and slot == knot_list.slots[first]
        ):
            for axis in range(len(center)):
                for sign in (1, -1):
                    _add_new_node_move(
                        samples,
                        knot_list,
                        moves,
                        replacement,
                        slot,
                        center,
                        quadratic,
                        sign * (axis + 1),
                        price,
                        new_node_bits,
                    )

    # The moves are only listed: the old knots stay until one is made.
    _put_back_knots(knot_list, first, after)


@inner_uncounted
def _is_inside_piece(knot_list: KnotList, j: int) -> bool:
    """Whether a knot lies inside a piece."""
    return (
        0 < j < knot_list.counts[KNOTS] - 1
        and knot_list.joined[j] == 1
        and knot_list.joined[j + 1] == 1
    )


@inner_uncounted
def _add_removal_moves(
    samples: GridSamples,
    knot_list: KnotList,
    moves: CandidateMoves,
    fixed: int,
    j: int,
    price: float,
) -> None:
    """Add the moves that leave out knot j, and shift its neighbours by up to one slot."""
    # Only neighbours inside the piece may shift. The knot's bits are saved, and those of a node
    # that it alone uses.
    a, b = j - 1, j + 1
    u, v = knot_list.nodes[a], knot_list.nodes[b]
    shift_a = 1 if _is_inside_piece(knot_list, a) else 0
    shift_b = 1 if _is_inside_piece(knot_list, b) else 0
    bits = -_KNOT_BITS - (
        _NODE_BITS
        if knot_list.uses[knot_list.nodes[j]] == 1 and knot_list.nodes[j] >= fixed
        else 0.0
    )

    # Shift the knot before, and measure the segment that leads to it.
    for p in range(-shift_a, shift_a + 1):
        slot_a = knot_list.slots[a] + p
        if p != 0 and slot_a <= knot_list.slots[a - 1]:
            continue
        error_before = (
            segment_error(
                samples,
                knot_list.slots[a - 1],
                knot_list.positions[knot_list.nodes[a - 1]],
                slot_a,
                knot_list.positions[u],
            )
            - knot_list.errors[a]
            if p != 0
            else 0.0
        )

        # Shift the knot behind, and measure the segment that leads from it.
        for q in range(-shift_b, shift_b + 1):
            slot_b = knot_list.slots[b] + q
            if slot_b <= slot_a or (q != 0 and slot_b >= knot_list.slots[b + 1]):
                continue
            error_behind = (
                segment_error(
                    samples,
                    slot_b,
                    knot_list.positions[v],
                    knot_list.slots[b + 1],
                    knot_list.positions[knot_list.nodes[b + 1]],
                )
                - knot_list.errors[b + 1]
                if q != 0
                else 0.0
            )

            # Measure the segment that replaces the two of the knot.
            error = (
                error_before
                + error_behind
                + segment_error(
                    samples, slot_a, knot_list.positions[u], slot_b, knot_list.positions[v]
                )
                - knot_list.errors[j]
                - knot_list.errors[b]
            )
            row = _add_move(moves, a, b + 1, 2, error, price * error + bits)
            if row >= 0:
                moves.slots[row, 0], moves.slots[row, 1] = slot_a, slot_b
                moves.nodes[row, 0], moves.nodes[row, 1] = u, v


@inner_uncounted
def list_moves(
    samples: GridSamples,
    knot_list: KnotList,
    prior_edges: PriorEdges,
    moves: CandidateMoves,
    fixed: int,
    j: int,
    price: float,
) -> None:
    """List the candidate moves of knot j.

    The knot is shifted, given another node, left out, merged with the next one, or followed by a
    new one.

    Parameters
    ----------
    moves : CandidateMoves
        Receives the moves.
    fixed : int
        The first nodes, of prior walks.
    j : int
        The knot.
    price : float
        Bits for a squared error of one grid step.
    """
    # Forget the moves of the knot before.
    moves.counts[MOVE_COUNT] = 0
    knots = knot_list.counts[KNOTS]
    slot = knot_list.slots[j]
    is_inside = _is_inside_piece(knot_list, j)

    # Shift the knot, or give it another node; the ends of a piece keep their slots.
    low = max(slot - _MAX_SHIFT, knot_list.slots[j - 1] + 1) if is_inside else slot
    high = min(slot + _MAX_SHIFT, knot_list.slots[j + 1] - 1) if is_inside else slot
    _add_replacement_moves(
        samples, knot_list, prior_edges, moves, fixed, j, j + 1, low, high, np.int64(1), price
    )

    # Leave it out.
    if is_inside:
        _add_removal_moves(samples, knot_list, moves, fixed, j, price)

    # Merge it with the next one.
    if is_inside and _is_inside_piece(knot_list, j + 1):
        low, high = knot_list.slots[j - 1] + 1, knot_list.slots[j + 2] - 1
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
            (high - low) // _MAX_TRIED_SLOTS + 1,
            price,
        )

    # Insert a knot behind it, if the segment's error is worth one.
    if (
        j + 1 < knots
        and knot_list.joined[j + 1]
        and price * knot_list.errors[j + 1] > _KNOT_BITS - moves.max_extra_bits
    ):
        low, high = slot + 1, knot_list.slots[j + 1] - 1
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
                (high - low) // _MAX_TRIED_SLOTS + 1,
                price,
            )
