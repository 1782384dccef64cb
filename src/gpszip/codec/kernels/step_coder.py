"""Coding of steps along edges: the kind of a step, and which known edge it takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit, code_choice
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import NODE_COUNT, WalkModel, find_half_edge, pair_count
from gpszip.codec.kernels.walk_priors import (
    AMONG_EDGES,
    BIT_ESCAPE,
    BIT_NEW_NODE,
    BIT_STAY,
    BIT_TURN_BACK,
)
from gpszip.kernels.jit import inner, inner_uncounted

__all__ = [
    "KIND_BACK",
    "KIND_KNOWN",
    "KIND_NEW_EDGE",
    "KIND_NEW_NODE",
    "KIND_STAY",
    "code_known_edge",
    "code_step_kind",
    "step_kind",
]

#: Kinds of steps.
KIND_BACK = np.int64(0)  # along the edge on which the walk came
KIND_KNOWN = np.int64(1)  # along another known edge
KIND_NEW_EDGE = np.int64(2)  # along a new edge to a known node
KIND_NEW_NODE = np.int64(3)  # along a new edge to a new node
KIND_STAY = np.int64(4)  # a stop

#: Largest sum of weights, half of what the range coder takes.
_MAX_WEIGHT_SUM = np.int64(1) << 40

#: Kind of a turn without a heading, and the class of edges in the tables of choices.
_NO_BEARING = 7
_OCTAVE = 0

#: Contexts tell at most so many edges of a node apart, and so many levels of traversals.
_MAX_DEGREE = 5
_MAX_LEVEL = 4

#: What the choice of an edge adds to the count of its turn, and the weight of all edges together.
_TURN_INCREMENT = 1 << 16

#: A pair of half-edges counts as at most so many.
_MAX_PAIR_COUNT = np.int64(1) << 16


@inner_uncounted
def _node_level(model: WalkModel, u: int) -> tuple[int, int]:
    """Edges at u, at most 5, and binary digits of how often they were taken from u, at most 4."""
    degree = 0
    departures = np.int64(0)
    half_edge = model.first_half_edge[u]
    while half_edge >= 0:
        degree += 1
        departures += model.traversals[half_edge]
        half_edge = model.next_half_edge[half_edge]
    level = 0
    while level < _MAX_LEVEL and departures >= (1 << level):
        level += 1
    return min(degree, _MAX_DEGREE), level


@inner
def _list_edges(model: WalkModel, u: int, back: int) -> NDArray[np.int64]:
    """Half-edges from u, save the one back."""
    count = 0
    half_edge = model.first_half_edge[u]
    while half_edge >= 0:
        count += half_edge != back
        half_edge = model.next_half_edge[half_edge]

    half_edges = np.empty(count, np.int64)
    i = 0
    half_edge = model.first_half_edge[u]
    while half_edge >= 0:
        if half_edge != back:
            half_edges[i] = half_edge
            i += 1
        half_edge = model.next_half_edge[half_edge]
    return half_edges


@inner_uncounted
def _weigh_edges(
    model: WalkModel,
    u: int,
    before: int,
    incoming: int,
    half_edges: NDArray[np.int64],
    turns: NDArray[np.int64],
    weights: NDArray[np.int64],
) -> int:
    """Fill in turns and weights of half-edges from u; return the sum of the weights.

    With n and m the traversals of a half-edge and of its opposite, r the ratio at which edges of
    its turn were chosen, and p how often it followed ``incoming``, the weight is
    w = (3 n + m + 1) r, and then w + p * (sum of all w) / 2.
    """
    chosen, offered = model.chosen[AMONG_EDGES, _OCTAVE], model.offered[AMONG_EDGES, _OCTAVE]

    # By traversals and turns; the ratio is between 1/16 and 16, in units of 2**-8.
    sum_before = np.int64(0)
    for i in range(len(half_edges)):
        half_edge = half_edges[i]
        turns[i] = _bearing(model.places, before, u, model.end_node[half_edge])
        ratio = (chosen[turns[i]] << 8) // offered[turns[i]]
        ratio = min(max(ratio, np.int64(16)), np.int64(4096))
        forth, opposite = model.traversals[half_edge], model.traversals[half_edge ^ 1]
        weights[i] = (3 * forth + opposite + 1) * ratio
        sum_before += weights[i]

    # By pairs of edges, where any step followed on this one.
    total = sum_before
    if incoming >= 0 and model.continued[incoming] > 0:
        for i in range(len(half_edges)):
            count = min(pair_count(model, incoming, half_edges[i]), _MAX_PAIR_COUNT)
            more = count * sum_before // 2
            weights[i] += more
            total += more

    # Halve what is too large for the range coder.
    while total > _MAX_WEIGHT_SUM:
        total = np.int64(0)
        for i in range(len(half_edges)):
            weights[i] = (weights[i] >> 1) + 1
            total += weights[i]
    return total


@inner
def code_known_edge(
    coder: Coder, model: WalkModel, u: int, before: int, incoming: int, back: int, node: int
) -> int:
    """Code which known edge is taken from u, other than the one back; return its half-edge.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the turn.
    u, before : int
        Where the walk is, and the node from which it came there, or -1.
    incoming, back : int
        Half-edge on which it came, and the opposite one; -1 if there is none.
    node : int
        Where the edge leads; ignored by a decoder.
    """
    # A single edge is certain and takes no bits.
    half_edges = _list_edges(model, u, back)
    count = len(half_edges)
    if count == 1:
        return half_edges[0]

    # Choose by weight.
    turns, weights = np.empty(count, np.int64), np.empty(count, np.int64)
    total = _weigh_edges(model, u, before, incoming, half_edges, turns, weights)
    choice = 0
    for i in range(count):
        if model.end_node[half_edges[i]] == node:
            choice = i
    choice = code_choice(coder, weights, count, choice)

    # Learn the turn: what was expected of each, and which was taken.
    for i in range(count):
        model.offered[AMONG_EDGES, _OCTAVE, turns[i]] += (weights[i] << 16) // total
    model.chosen[AMONG_EDGES, _OCTAVE, turns[choice]] += _TURN_INCREMENT
    return half_edges[choice]


@inner_uncounted
def _bearing(positions: NDArray[np.int64], before: int, u: int, node: int) -> int:
    """Turn from the step that led to u towards a node, in eight classes; 7 if there was no step.

    With a and b the two steps and cos = a b / (|a| |b|), it is the number of bounds that
    cos * |cos| is not above.
    """
    # Without a step that led to u, there is no turn.
    if before < 0:
        return _NO_BEARING

    # Scalar product, and squared lengths.
    dot = 0.0
    step_square = 0.0
    square = 0.0
    for axis in range(positions.shape[1]):
        a = np.float64(positions[u, axis] - positions[before, axis])
        b = np.float64(positions[node, axis] - positions[u, axis])
        dot += a * b
        step_square += a * a
        square += b * b
    if step_square == 0.0 or square == 0.0:
        return _NO_BEARING

    # Count the bounds that cos * |cos| is not above; that takes no square root.
    cosine = dot * abs(dot) / (step_square * square)
    for i, bound in enumerate((0.97, 0.75, 0.25, -0.25, -0.75, -0.97)):
        if cosine > bound:
            return i
    return 6


@inner_uncounted
def step_kind(model: WalkModel, u: int, back: int, node: int) -> int:
    """Kind of the step from u to ``node``, where ``back`` is the half-edge back, or -1."""
    if node == model.scalars[NODE_COUNT]:
        return KIND_NEW_NODE
    if node == u:
        return KIND_STAY
    half_edge = find_half_edge(model, u, node)
    if half_edge < 0:
        return KIND_NEW_EDGE
    return KIND_BACK if half_edge == back else KIND_KNOWN


@inner_uncounted
def _code_known_kind(
    coder: Coder, model: WalkModel, degree: int, incoming: int, back: int, kind: int, last_kind: int
) -> int:
    """Code whether a step along a known edge goes back; return its kind."""
    # Only one of the two is possible.
    if back < 0:
        return KIND_KNOWN
    if degree == 1:
        return KIND_BACK

    # 2 if a walk went back here before, 1 if the half-edge back was ever taken
    seen = 1 if model.traversals[back] > 0 else 0
    if incoming >= 0 and pair_count(model, incoming, back) > 0:
        seen = 2
    context = BIT_TURN_BACK + (min(degree, 4) * 3 + seen) * 2 + (1 if last_kind == KIND_BACK else 0)
    goes_back = code_bit(coder, model.bit_counts, context, 1 if kind == KIND_BACK else 0)
    return KIND_BACK if goes_back else KIND_KNOWN


@inner_uncounted
def _code_unknown_kind(
    coder: Coder,
    counts: NDArray[np.int32],
    nodes: int,
    degree: int,
    is_fresh: int,
    kind: int,
    last_kind: int,
) -> int:
    """Code whether a step along no known edge is a stop, a new node or a new edge."""
    last = min(last_kind, 4)
    context = BIT_STAY + last * 2 + is_fresh
    if code_bit(coder, counts, context, 1 if kind == KIND_STAY else 0):
        return KIND_STAY

    # a new edge leads from a known node to another one
    if nodes < 2:
        return KIND_NEW_NODE
    context = BIT_NEW_NODE + min(degree, 3) * 5 + last
    is_new = code_bit(coder, counts, context, 1 if kind == KIND_NEW_NODE else 0)
    return KIND_NEW_NODE if is_new else KIND_NEW_EDGE


@inner_uncounted
def code_step_kind(
    coder: Coder, model: WalkModel, u: int, incoming: int, back: int, kind: int, last_kind: int
) -> int:
    """Code the kind of a step from u.

    The first bit, as the escape symbol of PPM (J. G. Cleary, I. H. Witten, 1984), says whether the
    step leaves what the model knows at this node: it takes no known edge. One or two bits follow.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the bits.
    u : int
        Where the walk is.
    incoming, back : int
        Half-edge on which it came to u, and the opposite one; -1 if there is none.
    kind : int
        The kind to encode; ignored by a decoder.
    last_kind : int
        Kind of the step before.
    """
    degree, level = _node_level(model, u)
    is_fresh = 1 if last_kind >= KIND_NEW_NODE else 0
    if degree > 0:
        context = BIT_ESCAPE + (degree * 5 + level) * 2 + is_fresh
        if not code_bit(coder, model.bit_counts, context, 1 if kind >= KIND_NEW_EDGE else 0):
            return _code_known_kind(coder, model, degree, incoming, back, kind, last_kind)
    return _code_unknown_kind(
        coder, model.bit_counts, model.scalars[NODE_COUNT], degree, is_fresh, kind, last_kind
    )
