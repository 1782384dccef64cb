"""Coding of links: which known node a new way or a gap leads to, by how far it lies and in which direction.

Thousands of nodes are weighed for one link. What is worked out for each of them has no branches, so that the compiler takes several
at a time; weights are had once for each class of nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import SUBSTEPS, code_bit
from gpszip.codec.kernels.range_coder import Coder, code_interval, decode_cumulative
from gpszip.codec.kernels.walk_model import CHEAP, NODES, STEP_LENGTH, WalkModel
from gpszip.codec.kernels.walk_priors import F_NEAR, OCTAVES, ON_GAP, ON_LINK
from gpszip.kernels.jit import jit

__all__ = [
    "NODE_KINDS",
    "class_weights",
    "code_candidate",
    "code_known_node",
    "is_search_limited",
    "learn_candidate",
    "sum_weights",
]

#: Most nodes that a new way is weighed for. Once so many more new ways were cheap than not, as only forged bytes have them, few nodes
#: are weighed: each byte read then takes bounded time.
_LINKS, _FEW_LINKS, _CHEAP_WAYS = 4096, 64, 1 << 14

#: Classes of nodes: octaves of distance by eight kinds, and those that no link leads to.
NODE_KINDS = 8
_CLASSES = OCTAVES * NODE_KINDS
_BARRED = _CLASSES

#: What stands for no candidate.
_NONE = np.int64(-1)

#: Axes count up to this many quanta. Sums of squares beyond 2**53 aren't exact any more, but lie beyond all bounds.
_FARTHEST = 2.0**25


@jit
def _add_octaves(model: WalkModel, u: int, first: int, classes: NDArray[np.uint8]) -> None:
    """Add to the class of each node from ``first`` on how far it is from u, in half octaves of the step to expect."""
    places = model.places
    squares = np.zeros(len(classes))
    for axis in range(places.shape[1]):
        here = places[u, axis]
        for i in range(len(classes)):
            step = min(abs(np.float64(places[first + i, axis] - here)), _FARTHEST)
            squares[i] += step * step
    reach = min(max(model.scalars[STEP_LENGTH], np.int64(64)), np.int64(1) << 27)
    bound = np.float64((reach * 181 >> 10) ** 2) / (SUBSTEPS * SUBSTEPS)
    for _ in range(OCTAVES - 1):
        for i in range(len(classes)):
            classes[i] += np.uint8(NODE_KINDS) if squares[i] >= bound else np.uint8(0)
        bound *= 2.0


@jit
def _add_bearings(
    places: NDArray[np.int64], before: int, u: int, first: int, classes: NDArray[np.uint8]
) -> None:
    """Add to the class of each node the turn from the last step towards it, by its cosine; 7 if there was none."""
    one = 0.0
    dots, twos = np.zeros(len(classes)), np.zeros(len(classes))
    if before >= 0:
        for axis in range(places.shape[1]):
            here = places[u, axis]
            a = np.float64(here - places[before, axis])
            one += a * a
            for i in range(len(classes)):
                b = np.float64(places[first + i, axis] - here)
                dots[i] += a * b
                twos[i] += b * b
    for i in range(len(classes)):
        square = dots[i] * abs(dots[i]) / (one * twos[i])
        kind = np.uint8(0)
        for bound in (0.97, 0.75, 0.25, -0.25, -0.75, -0.97):
            kind += np.uint8(0) if square > bound else np.uint8(1)
        classes[i] += kind if one * twos[i] > 0.0 else np.uint8(7)


@jit
def _add_rests(rests: NDArray[np.int64], first: int, classes: NDArray[np.uint8]) -> None:
    """Add to the class of each node how often gaps began or ended there."""
    for i in range(len(classes)):
        for bound in (0, 1, 3):
            classes[i] += np.uint8(1) if rests[first + i] > bound else np.uint8(0)


@jit
def _bar(model: WalkModel, u: int, layer: int, first: int, classes: NDArray[np.uint8]) -> None:
    """Bar u and, but after gaps, the nodes that u has a way to."""
    if u >= first:
        classes[u - first] = _BARRED
    half = model.head[u]
    while half >= 0 and layer == ON_LINK:
        if model.into[half] >= first:
            classes[model.into[half] - first] = _BARRED
        half = model.following[half]


@jit
def sum_weights(classes: NDArray[np.uint8], weights: NDArray[np.int64]) -> int:
    """Sum of the weights of candidates of these classes."""
    total = np.int64(0)
    for i in range(len(classes)):
        total += weights[classes[i]]
    return total


@jit
def is_search_limited(model: WalkModel) -> bool:
    """Whether so many choices were cheap that only few nodes are weighed any more."""
    return model.scalars[CHEAP] >= _CHEAP_WAYS


@jit
def learn_candidate(
    model: WalkModel, layer: int, classes: NDArray[np.uint8], chosen: int, cheap: bool
) -> None:
    """Learn which of the candidates was taken (-1: none) and whether that was cheap."""
    had = np.zeros(_CLASSES + 1, np.int64)
    for i in range(len(classes)):
        had[classes[i]] += 1
    for i in range(_CLASSES):
        model.offers[layer, i // NODE_KINDS, i % NODE_KINDS] += had[i]
    if chosen >= 0:
        model.hits[layer, classes[chosen] // NODE_KINDS, classes[chosen] % NODE_KINDS] += 128
    if model.scalars[NODES] > _FEW_LINKS:
        model.scalars[CHEAP] = max(model.scalars[CHEAP] + (1 if cheap else -1), np.int64(0))


@jit
def class_weights(model: WalkModel, layer: int) -> NDArray[np.int64]:
    """Weight of a node of each class; none for those barred."""
    weights = np.zeros(_CLASSES + 1, np.int64)
    for i in range(_CLASSES):
        weights[i] = (model.hits[layer, i // NODE_KINDS, i % NODE_KINDS] << 16) // model.offers[
            layer, i // NODE_KINDS, i % NODE_KINDS
        ] + 1
    return weights


@jit
def code_candidate(
    coder: Coder, classes: NDArray[np.uint8], weights: NDArray[np.int64], total: int, v: int
) -> int:
    """Code which of the nodes it is, the newest first."""
    i = len(classes)
    start = np.int64(0)
    if coder.cursor[1] == 1:
        at = decode_cumulative(coder, total)
        while i > 0 and start <= at:
            i -= 1
            start += weights[classes[i]]
        start -= weights[classes[i]]
    else:
        while i - 1 > v:
            i -= 1
            start += weights[classes[i]]
        i = v
    code_interval(coder, start, weights[classes[i]], total)
    return i


@jit
def code_known_node(coder: Coder, model: WalkModel, u: int, before: int, v: int, layer: int) -> int:
    """Code the node that a new way or a gap leads to: one of the newest, by where it lies, or any."""
    nodes = model.scalars[NODES]
    count = min(nodes, np.int64(_FEW_LINKS if is_search_limited(model) else _LINKS))
    first = nodes - count
    classes = np.zeros(count, np.uint8)
    _add_octaves(model, u, first, classes)
    if layer == ON_GAP:
        _add_rests(model.rests, first, classes)
    else:
        _add_bearings(model.places, before, u, first, classes)
    _bar(model, u, layer, first, classes)
    weights = class_weights(model, layer)
    total = sum_weights(classes, weights)
    is_near, chosen, cheap = 1 if total > 0 else 0, _NONE, False
    if total > 0 and first > 0:
        is_near = code_bit(coder, model.flags, F_NEAR, 1 if v >= first else 0)
    if not is_near:
        if coder.cursor[1] == 1:
            v = decode_cumulative(coder, nodes)
        code_interval(coder, v, 1, nodes)
    else:
        chosen = code_candidate(coder, classes, weights, total, v - first)
        cheap = 4 * weights[classes[chosen]] > total
        v = first + chosen
    learn_candidate(model, layer, classes, chosen, cheap)
    return v
