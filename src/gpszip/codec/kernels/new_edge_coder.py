"""Coding of the known node to which a new edge or a gap leads, by its distance and direction.

Up to 4,096 candidates are weighed for one node. The work for each has no branches, so that the
compiler vectorises it; weights are computed once for each class of candidates.

A candidate of octave o and kind k weighs (chosen[o, k] << 16) // offered[o, k] + 1: how often
candidates of its class were chosen, by how often they could be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import SUBSTEPS, code_bit
from gpszip.codec.kernels.range_coder import Coder, code_interval, decode_cumulative, is_decoding
from gpszip.codec.kernels.walk_model import CHEAP_CHOICES, NODE_COUNT, STEP_LENGTH, WalkModel
from gpszip.codec.kernels.walk_priors import (
    AMONG_NEW_EDGES,
    BEYOND_GAPS,
    BIT_RECENT_NODE,
    KINDS_PER_OCTAVE,
    OCTAVES,
)
from gpszip.kernels.jit import inner, inner_uncounted

__all__ = [
    "class_weights",
    "code_candidate",
    "code_known_node",
    "is_cheap",
    "is_search_limited",
    "learn_candidate",
    "sum_weights",
]

#: The newest nodes that are candidates.
_MAX_CANDIDATES = 4096

#: The same once so many more choices were cheap than not, as only forged bytes have them: each byte
#: that is read then takes bounded time.
_FEW_CANDIDATES = 64
_MAX_CHEAP_CHOICES = 1 << 14

#: Classes of candidates, and the class of nodes that can't be chosen, which weighs nothing.
_CLASSES = OCTAVES * KINDS_PER_OCTAVE
_BARRED = _CLASSES

#: Stands for no candidate.
_NONE = np.int64(-1)

#: What a choice adds to its class in ``WalkModel.chosen``.
_CHOSEN_INCREMENT = 128

#: Differences of coordinates count as at most this. Sums of squares beyond 2**53 aren't exact any
#: more, but lie beyond all bounds.
_MAX_DIFFERENCE = 2.0**25

#: The mean step length counts as at least 4 space steps and at most 2**23, in sixteenths.
_MIN_REACH = np.int64(64)
_MAX_REACH = np.int64(1) << 27

#: Kind of a candidate without a bearing.
_NO_BEARING = np.uint8(7)


@inner
def _add_octaves(model: WalkModel, u: int, first: int, classes: NDArray[np.uint8]) -> None:
    """Add the octave of the distance from u to the class of each node from ``first`` on.

    Octaves count from 181/1024 of the mean step length on: each is twice the squared distance.
    """
    # Squared distances.
    positions = model.places
    squares = np.zeros(len(classes))
    for axis in range(positions.shape[1]):
        origin = positions[u, axis]
        for i in range(len(classes)):
            step = min(abs(np.float64(positions[first + i, axis] - origin)), _MAX_DIFFERENCE)
            squares[i] += step * step

    # One more octave for each bound that is reached.
    reach = min(max(model.scalars[STEP_LENGTH], _MIN_REACH), _MAX_REACH)
    bound = np.float64((reach * 181 >> 10) ** 2) / (SUBSTEPS * SUBSTEPS)
    for _ in range(OCTAVES - 1):
        for i in range(len(classes)):
            classes[i] += np.uint8(KINDS_PER_OCTAVE) if squares[i] >= bound else np.uint8(0)
        bound *= 2.0


@inner
def _add_bearings(
    positions: NDArray[np.int64], before: int, u: int, first: int, classes: NDArray[np.uint8]
) -> None:
    """Add the bearing to the class of each node: its turn from the step that led to u.

    With a that step, b the one from u to the node and cos = a b / (|a| |b|), it is the number of
    bounds that cos * |cos| is not above; 7 where a or b is null, or there was no step.
    """
    # Scalar products a b, and squared lengths.
    step_square = 0.0
    dots, squares = np.zeros(len(classes)), np.zeros(len(classes))
    if before >= 0:
        for axis in range(positions.shape[1]):
            origin = positions[u, axis]
            a = np.float64(origin - positions[before, axis])
            step_square += a * a
            for i in range(len(classes)):
                b = np.float64(positions[first + i, axis] - origin)
                dots[i] += a * b
                squares[i] += b * b

    # Count the bounds that cos * |cos| is not above; that takes no square root.
    for i in range(len(classes)):
        cosine = dots[i] * abs(dots[i]) / (step_square * squares[i])
        bearing = np.uint8(0)
        for bound in (0.97, 0.75, 0.25, -0.25, -0.75, -0.97):
            bearing += np.uint8(0) if cosine > bound else np.uint8(1)
        classes[i] += bearing if step_square * squares[i] > 0.0 else _NO_BEARING


@inner_uncounted
def _add_gap_ends(gap_ends: NDArray[np.int64], first: int, classes: NDArray[np.uint8]) -> None:
    """Add to the class of each node whether no gap, one, few or many gaps began or ended there."""
    for i in range(len(classes)):
        for bound in (0, 1, 3):
            classes[i] += np.uint8(1) if gap_ends[first + i] > bound else np.uint8(0)


@inner_uncounted
def _bar_nodes(
    model: WalkModel, u: int, table: int, first: int, classes: NDArray[np.uint8]
) -> None:
    """Bar u and, but after gaps, the nodes to which u has an edge."""
    if u >= first:
        classes[u - first] = _BARRED
    half_edge = model.first_half_edge[u]
    while half_edge >= 0 and table == AMONG_NEW_EDGES:
        node = model.end_node[half_edge]
        if node >= first:
            classes[node - first] = _BARRED
        half_edge = model.next_half_edge[half_edge]


@inner_uncounted
def sum_weights(classes: NDArray[np.uint8], weights: NDArray[np.int64]) -> int:
    """Sum of the weights of candidates, given their classes."""
    total = np.int64(0)
    for i in range(len(classes)):
        total += weights[classes[i]]
    return total


@inner_uncounted
def is_search_limited(model: WalkModel) -> bool:
    """Whether so many choices were cheap that only few candidates are weighed any more."""
    return model.scalars[CHEAP_CHOICES] >= _MAX_CHEAP_CHOICES


@inner_uncounted
def is_cheap(weight: int, total: int) -> bool:
    """Whether a choice takes less than 2 bits."""
    return 4 * weight > total


@inner
def learn_candidate(
    model: WalkModel, table: int, classes: NDArray[np.uint8], choice: int, cheap: bool
) -> None:
    """Learn which candidate was chosen (-1: none), and whether that took few bits."""
    # Every candidate could be chosen.
    counts = np.zeros(_CLASSES + 1, np.int64)
    for i in range(len(classes)):
        counts[classes[i]] += 1
    for i in range(_CLASSES):
        model.offered[table, i // KINDS_PER_OCTAVE, i % KINDS_PER_OCTAVE] += counts[i]

    # One was.
    if choice >= 0:
        octave, kind = classes[choice] // KINDS_PER_OCTAVE, classes[choice] % KINDS_PER_OCTAVE
        model.chosen[table, octave, kind] += _CHOSEN_INCREMENT
    if model.scalars[NODE_COUNT] > _FEW_CANDIDATES:
        balance = model.scalars[CHEAP_CHOICES] + (1 if cheap else -1)
        model.scalars[CHEAP_CHOICES] = max(balance, np.int64(0))


@inner
def class_weights(model: WalkModel, table: int) -> NDArray[np.int64]:
    """Weight of a candidate of each class; 0 for the class that is barred."""
    weights = np.zeros(_CLASSES + 1, np.int64)
    for i in range(_CLASSES):
        octave, kind = i // KINDS_PER_OCTAVE, i % KINDS_PER_OCTAVE
        chosen, offered = model.chosen[table, octave, kind], model.offered[table, octave, kind]
        weights[i] = (chosen << 16) // offered + 1
    return weights


@inner_uncounted
def code_candidate(
    coder: Coder, classes: NDArray[np.uint8], weights: NDArray[np.int64], total: int, choice: int
) -> int:
    """Code which candidate is chosen; the last one owns the lowest interval.

    Parameters
    ----------
    coder : Coder
        In any direction.
    classes : uint8 array, shape (n,)
        Class of each candidate.
    weights : int64 array
        Weight of each class.
    total : int
        Sum of the weights of all candidates, more than 0.
    choice : int
        The candidate to encode; ignored by a decoder.
    """
    # Sum up the intervals from the last candidate, which owns the lowest, to the choice.
    i = len(classes)
    start = np.int64(0)
    if is_decoding(coder):
        # Pass candidates until the next interval begins beyond the number.
        number = decode_cumulative(coder, total)
        while i > 0 and start <= number:
            i -= 1
            start += weights[classes[i]]
        start -= weights[classes[i]]
    else:
        # Sum up the weights of the candidates after the one that is chosen.
        while i - 1 > choice:
            i -= 1
            start += weights[classes[i]]
        i = choice
    code_interval(coder, start, weights[classes[i]], total)
    return i


@inner
def _classify(
    model: WalkModel, u: int, before: int, table: int, first: int, count: int
) -> NDArray[np.uint8]:
    """Class of each of ``count`` nodes from ``first`` on, as candidates for u."""
    classes = np.zeros(count, np.uint8)
    _add_octaves(model, u, first, classes)
    if table == BEYOND_GAPS:
        _add_gap_ends(model.gap_ends, first, classes)
    else:
        _add_bearings(model.places, before, u, first, classes)
    _bar_nodes(model, u, table, first, classes)
    return classes


@inner
def code_known_node(
    coder: Coder, model: WalkModel, u: int, before: int, node: int, table: int
) -> int:
    """Code the known node to which a new edge or a gap from u leads.

    Parameters
    ----------
    coder : Coder
        In any direction.
    model : WalkModel
        Learns the choice.
    u, before : int
        Where the walk is, and the node from which it came there; -1 if it has no heading.
    node : int
        The node to encode; ignored by a decoder.
    table : int
        ``AMONG_NEW_EDGES`` or ``BEYOND_GAPS``.

    Returns
    -------
    int
        The node.
    """
    # The newest nodes are candidates.
    nodes = model.scalars[NODE_COUNT]
    count = min(nodes, np.int64(_FEW_CANDIDATES if is_search_limited(model) else _MAX_CANDIDATES))
    first = nodes - count
    classes = _classify(model, u, before, table, first, count)
    weights = class_weights(model, table)
    total = sum_weights(classes, weights)

    # Whether it is one of them, unless all nodes or none are.
    is_recent, choice, cheap = 1 if total > 0 else 0, _NONE, False
    if total > 0 and first > 0:
        is_recent = code_bit(coder, model.bit_counts, BIT_RECENT_NODE, 1 if node >= first else 0)

    # a candidate by its weight, any other node with equal probabilities
    if is_recent:
        choice = code_candidate(coder, classes, weights, total, node - first)
        cheap = is_cheap(weights[classes[choice]], total)
        node = first + choice
    else:
        if is_decoding(coder):
            node = decode_cumulative(coder, nodes)
        code_interval(coder, node, 1, nodes)
    learn_candidate(model, table, classes, choice, cheap)
    return node
