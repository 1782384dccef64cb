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
    "count_classes",
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
_NO_BEARING = np.int64(7)

#: What a true comparison counts for.
_ONE = np.int64(1)

#: Binary digits of a double below its exponent.
_MANTISSA_BITS = 52


@inner_uncounted
def _square(step: float) -> float:
    """Square of a difference of coordinates, of which no more than the largest counts."""
    size = min(abs(step), _MAX_DIFFERENCE)
    return size * size


@inner_uncounted
def _measure_in_plane(
    positions: NDArray[np.int64],
    u: int,
    a: NDArray[np.float64],
    block: NDArray[np.int64],
    distances: NDArray[np.float64],
    squares: NDArray[np.float64],
    dots: NDArray[np.float64],
) -> None:
    """Fill in what :func:`_measure` returns, in two dimensions.

    The compiler vectorises neighbouring coordinates in one pass: a fifth of the time of others.
    """
    for i in range(len(squares)):
        x = np.float64(block[2 * i] - positions[u, 0])
        y = np.float64(block[2 * i + 1] - positions[u, 1])
        distances[i] = _square(x) + _square(y)
        squares[i] = x * x + y * y
        dots[i] = a[0] * x + a[1] * y


@inner
def _measure(
    positions: NDArray[np.int64], u: int, a: NDArray[np.float64], first: int, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Measure the steps b from u to ``count`` nodes from ``first`` on.

    Returns their squared lengths with limited differences, their squared lengths, and the scalar
    products a b.
    """
    distances, squares, dots = np.zeros(count), np.zeros(count), np.zeros(count)
    nodes = positions[first : first + count]
    if positions.shape[1] == 2:
        _measure_in_plane(positions, u, a, nodes.reshape(-1), distances, squares, dots)
        return distances, squares, dots

    for axis in range(positions.shape[1]):
        origin = positions[u, axis]
        for i in range(count):
            b = np.float64(nodes[i, axis] - origin)
            distances[i] += _square(b)
            squares[i] += b * b
            dots[i] += a[axis] * b
    return distances, squares, dots


@inner
def _add_octaves(
    model: WalkModel, distances: NDArray[np.float64], classes: NDArray[np.uint8]
) -> None:
    """Add the octave of each squared distance to the class of its node.

    Octaves count from 181/1024 of the mean step length on: each is twice the squared distance.
    """
    # One octave for each bound b, 2 b, 4 b, ... that is reached. The exponent of a positive double
    # are its highest bits: as whole numbers, doubles whose ratio is at least 2**k differ by at
    # least k << 52, and others by less.
    reach = min(max(model.scalars[STEP_LENGTH], _MIN_REACH), _MAX_REACH)
    bound = np.full(1, np.float64((reach * 181 >> 10) ** 2) / (SUBSTEPS * SUBSTEPS))
    bits, first = distances.view(np.int64), bound.view(np.int64)[0]
    for i in range(len(classes)):
        octave = ((bits[i] - first) >> _MANTISSA_BITS) + 1
        octave = min(max(octave, np.int64(0)), np.int64(OCTAVES - 1))
        classes[i] += np.uint8(octave * KINDS_PER_OCTAVE)


@inner_uncounted
def _add_bearings(
    step_square: float,
    squares: NDArray[np.float64],
    dots: NDArray[np.float64],
    classes: NDArray[np.uint8],
) -> None:
    """Add the bearing to the class of each node: its turn from the step that led to u.

    With a that step, b the one from u to the node and cos = a b / (|a| |b|), it is the number of
    bounds that cos * |cos| is not above; 7 where a or b is null, or there was no step.
    """
    # Comparing cos * |cos| takes no square root. Bounds that it is above are written one by one,
    # since a loop over them keeps the compiler from vectorising.
    for i in range(len(classes)):
        product = step_square * squares[i]
        cosine = dots[i] * abs(dots[i]) / product
        above = (cosine > 0.97) * _ONE + (cosine > 0.75) * _ONE + (cosine > 0.25) * _ONE
        above += (cosine > -0.25) * _ONE + (cosine > -0.75) * _ONE + (cosine > -0.97) * _ONE
        classes[i] += np.uint8(6 - above if product > 0.0 else _NO_BEARING)


@inner_uncounted
def _add_gap_ends(gap_ends: NDArray[np.int64], classes: NDArray[np.uint8]) -> None:
    """Add to the class of each node whether no gap, one, few or many gaps began or ended there."""
    for i in range(len(classes)):
        ends = gap_ends[i]
        classes[i] += np.uint8((ends > 0) * _ONE + (ends > 1) * _ONE + (ends > 3) * _ONE)


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


@inner
def count_classes(classes: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Count the candidates of each class."""
    # Four tables take turns: an entry is not read again right after it was written.
    counts = np.zeros((4, _CLASSES + 1), np.int64)
    for i in range(len(classes)):
        counts[i & 3, classes[i]] += 1
    for i in range(_CLASSES + 1):
        counts[0, i] += counts[1, i] + counts[2, i] + counts[3, i]
    return counts[0]


@inner_uncounted
def sum_weights(counts: NDArray[np.int64], weights: NDArray[np.int64]) -> int:
    """Sum of the weights of candidates, given how many each class has."""
    total = np.int64(0)
    for i in range(len(counts)):
        total += counts[i] * weights[i]
    return total


@inner_uncounted
def is_search_limited(model: WalkModel) -> bool:
    """Whether so many choices were cheap that only few candidates are weighed any more."""
    return model.scalars[CHEAP_CHOICES] >= _MAX_CHEAP_CHOICES


@inner_uncounted
def is_cheap(weight: int, total: int) -> bool:
    """Whether a choice takes less than 2 bits."""
    return 4 * weight > total


@inner_uncounted
def learn_candidate(
    model: WalkModel, table: int, counts: NDArray[np.int64], chosen: int, cheap: bool
) -> None:
    """Learn of which class the choice was (-1: none was chosen), and whether it took few bits.

    ``counts`` is what :func:`count_classes` returns.
    """
    # Every candidate could be chosen.
    for i in range(_CLASSES):
        model.offered[table, i // KINDS_PER_OCTAVE, i % KINDS_PER_OCTAVE] += counts[i]

    # One was.
    if chosen >= 0:
        octave, kind = chosen // KINDS_PER_OCTAVE, chosen % KINDS_PER_OCTAVE
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
    # The step that led to u; null if there was none.
    positions = model.places
    a = np.zeros(positions.shape[1])
    step_square = 0.0
    if before >= 0:
        for axis in range(len(a)):
            a[axis] = np.float64(positions[u, axis] - positions[before, axis])
            step_square += a[axis] * a[axis]

    # Classes by distance, and by bearing or gaps.
    classes = np.zeros(count, np.uint8)
    distances, squares, dots = _measure(positions, u, a, first, count)
    _add_octaves(model, distances, classes)
    if table == BEYOND_GAPS:
        _add_gap_ends(model.gap_ends[first : first + count], classes)
    else:
        _add_bearings(step_square, squares, dots, classes)
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
    counts, weights = count_classes(classes), class_weights(model, table)
    total = sum_weights(counts, weights)

    # Whether it is one of them, unless all nodes or none are.
    is_recent, chosen, cheap = 1 if total > 0 else 0, _NONE, False
    if total > 0 and first > 0:
        is_recent = code_bit(coder, model.bit_counts, BIT_RECENT_NODE, 1 if node >= first else 0)

    # a candidate by its weight, any other node with equal probabilities
    if is_recent:
        choice = code_candidate(coder, classes, weights, total, node - first)
        chosen = np.int64(classes[choice])
        cheap = is_cheap(weights[chosen], total)
        node = first + choice
    else:
        if is_decoding(coder):
            node = decode_cumulative(coder, nodes)
        code_interval(coder, node, 1, nodes)
    learn_candidate(model, table, counts, chosen, cheap)
    return node
