"""Coding of ways: what kind of step follows, which known way is taken, and where a new one leads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import code_bit, code_choice
from gpszip.kernels.jit import jit
from gpszip.kernels.range_coder import Coder, code_interval, target
from gpszip.kernels.walk_model import F_BACK, F_ESCAPE, F_NEAR, F_NEW, F_STAY, NODES, WalkModel, half_edge, length, pair_count

__all__ = ["KIND_BACK", "KIND_KNOWN", "KIND_LINK", "KIND_NEW", "KIND_STAY", "code_kind", "code_link", "code_way", "kind_of"]

#: Kinds of steps.
KIND_BACK, KIND_KNOWN, KIND_LINK, KIND_NEW, KIND_STAY = 0, 1, 2, 3, 4

#: Most nodes that a new way is weighed for.
_LINKS = 384


@jit
def _depth(model: WalkModel, u: int) -> tuple[int, int]:
    """Number of ways at u and how often they were left along, both capped for use as a context."""
    degree = 0
    visits = np.int64(0)
    half = model.head[u]
    while half >= 0:
        degree += 1
        visits += model.count[half]
        half = model.following[half]
    level = 0
    while level < 4 and visits >= (1 << level):
        level += 1
    return min(degree, 5), level


@jit
def code_way(coder: Coder, model: WalkModel, u: int, arrived: int, back: int, v: int) -> int:
    """Code which known way is taken at u, save the one back; return its half-edge."""
    ways = 0
    half = model.head[u]
    while half >= 0:
        ways += half != back
        half = model.following[half]
    halves = np.empty(ways, np.int64)
    weights = np.empty(ways, np.int64)
    single = np.int64(0)
    choice = 0
    at = 0
    half = model.head[u]
    while half >= 0:
        if half != back:
            halves[at] = half
            weights[at] = 2 * model.count[half] + model.count[half ^ 1] + 1
            single += weights[at]
            if model.into[half] == v:
                choice = at
            at += 1
        half = model.following[half]
    if arrived >= 0 and model.passed[arrived] > 0:
        for i in range(ways):
            pairs = min(pair_count(model, arrived, halves[i]), np.int64(1) << 16)
            weights[i] += 2 * pairs * single // 3
    if ways > 1:
        choice = code_choice(coder, weights, ways, choice)
    return halves[choice]


@jit
def _octave(far: int, reach: int) -> int:
    """Ratio of two lengths in half octaves, 0 to 9."""
    ratio = 0
    bound = reach * 181 >> 10
    while ratio < 9 and far >= bound:
        bound = bound * 362 >> 8
        ratio += 1
    return ratio


@jit
def _bearing(places: NDArray[np.int64], before: int, u: int, v: int) -> int:
    """Turn from the last step towards v in eight classes by its cosine; 7 if there was none."""
    if before < 0:
        return 7
    dot = 0.0
    one = 0.0
    two = 0.0
    for axis in range(places.shape[1]):
        a = np.float64(places[u, axis] - places[before, axis])
        b = np.float64(places[v, axis] - places[u, axis])
        dot += a * b
        one += a * a
        two += b * b
    if one == 0.0 or two == 0.0:
        return 7
    square = dot * abs(dot) / (one * two)
    for i, bound in enumerate((0.97, 0.75, 0.25, -0.25, -0.75, -0.97)):
        if square > bound:
            return i
    return 6


@jit
def code_link(coder: Coder, model: WalkModel, u: int, before: int, v: int, reach: int) -> int:
    """Code the node that a new way leads to: one of those near, by where it lies, or any."""
    nodes = model.scalars[NODES]
    near = np.empty(_LINKS, np.int64)
    classes = np.empty(_LINKS, np.int64)
    weights = np.empty(_LINKS, np.int64)
    count = 0
    choice = -1
    recent = max(nodes - 4096, np.int64(0))
    for w in range(nodes - 1, recent - 1, -1):
        if count == _LINKS:
            break
        if w == u or half_edge(model, u, w) >= 0:
            continue
        far = length(model.places, u, w)
        ratio = _octave(far, reach)
        if ratio > 8:
            continue
        near[count] = w
        classes[count] = ratio * 8 + _bearing(model.places, before, u, w)
        weights[count] = (model.hits[ratio, classes[count] % 8] << 16) // model.offers[ratio, classes[count] % 8] + 1
        if w == v:
            choice = count
        count += 1
    is_near = code_bit(coder, model.flags, F_NEAR, 1 if choice >= 0 else 0) if count > 0 else 0
    if is_near:
        choice = code_choice(coder, weights, count, choice)
        v = near[choice]
        model.hits[classes[choice] // 8, classes[choice] % 8] += 8
    else:
        if coder.cursor[1] == 1:
            v = target(coder, nodes)
        code_interval(coder, v, 1, nodes)
    for i in range(count):
        model.offers[classes[i] // 8, classes[i] % 8] += 1
    return v


@jit
def kind_of(model: WalkModel, u: int, back: int, node: int) -> int:
    """Kind of the step from u to ``node``, where ``back`` is the half-edge to where the walk came from."""
    if node == model.scalars[NODES]:
        return KIND_NEW
    if node == u:
        return KIND_STAY
    half = half_edge(model, u, node)
    if half < 0:
        return KIND_LINK
    return KIND_BACK if half == back else KIND_KNOWN


@jit
def code_kind(coder: Coder, model: WalkModel, u: int, arrived: int, back: int, kind: int, last: int) -> int:
    """Code the kind of a step from u, reached on the half-edge ``arrived``."""
    flags = model.flags
    degree, level = _depth(model, u)
    fresh = 1 if last >= KIND_NEW else 0
    if degree > 0:
        escape = code_bit(coder, flags, F_ESCAPE + (degree * 5 + level) * 2 + fresh, 1 if kind >= KIND_LINK else 0)
    else:
        escape = 1
    if not escape:
        if back < 0:
            return KIND_KNOWN
        if degree == 1:
            return KIND_BACK
        seen = 2 if arrived >= 0 and pair_count(model, arrived, back) > 0 else (1 if model.count[back] > 0 else 0)
        context = F_BACK + (min(degree, 4) * 3 + seen) * 2 + (1 if last == KIND_BACK else 0)
        return KIND_BACK if code_bit(coder, flags, context, 1 if kind == KIND_BACK else 0) else KIND_KNOWN
    if code_bit(coder, flags, F_STAY + min(last, 4) * 2 + fresh, 1 if kind == KIND_STAY else 0):
        return KIND_STAY
    if model.scalars[NODES] < 2:
        return KIND_NEW
    return KIND_NEW if code_bit(coder, flags, F_NEW + min(degree, 3) * 5 + min(last, 4), 1 if kind == KIND_NEW else 0) else KIND_LINK
