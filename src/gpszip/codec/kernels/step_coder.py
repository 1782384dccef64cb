"""Coding of ways: what kind of step follows, which known way is taken, and where a new one leads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit, code_choice
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import NODES, WalkModel, find_half_edge, pair_count
from gpszip.codec.kernels.walk_priors import F_BACK, F_ESCAPE, F_NEW, F_STAY, ON_WAY
from gpszip.kernels.jit import jit

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
KIND_BACK, KIND_KNOWN, KIND_NEW_EDGE, KIND_NEW_NODE, KIND_STAY = np.arange(5)

#: Largest sum of weights.
_MOST = np.int64(1) << 40


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
def _list_ways(model: WalkModel, u: int, back: int) -> NDArray[np.int64]:
    """Half-edges at u, save the one back."""
    ways = 0
    half = model.head[u]
    while half >= 0:
        ways += half != back
        half = model.following[half]
    halves = np.empty(ways, np.int64)
    at = 0
    half = model.head[u]
    while half >= 0:
        if half != back:
            halves[at] = half
            at += 1
        half = model.following[half]
    return halves


@jit
def _weigh_ways(
    model: WalkModel,
    u: int,
    before: int,
    arrived: int,
    halves: NDArray[np.int64],
    turns: NDArray[np.int64],
    weights: NDArray[np.int64],
) -> int:
    """Weigh known ways by how often they were taken, by their turn, and by how often they followed; return the sum."""
    hits, offers = model.hits[ON_WAY, 0], model.offers[ON_WAY, 0]
    single = np.int64(0)
    for i in range(len(halves)):
        half = halves[i]
        turns[i] = _bearing(model.places, before, u, model.into[half])
        ratio = min(max((hits[turns[i]] << 8) // offers[turns[i]], np.int64(16)), np.int64(4096))
        weights[i] = (3 * model.count[half] + model.count[half ^ 1] + 1) * ratio
        single += weights[i]
    total = single
    if arrived >= 0 and model.passed[arrived] > 0:
        for i in range(len(halves)):
            more = min(pair_count(model, arrived, halves[i]), np.int64(1) << 16) * single // 2
            weights[i] += more
            total += more
    while total > _MOST:
        total = np.int64(0)
        for i in range(len(halves)):
            weights[i] = (weights[i] >> 1) + 1
            total += weights[i]
    return total


@jit
def code_known_edge(
    coder: Coder, model: WalkModel, u: int, before: int, arrived: int, back: int, v: int
) -> int:
    """Code which known way is taken at u, save the one back; return its half-edge."""
    halves = _list_ways(model, u, back)
    ways = len(halves)
    if ways == 1:
        return halves[0]
    turns, weights = np.empty(ways, np.int64), np.empty(ways, np.int64)
    total = _weigh_ways(model, u, before, arrived, halves, turns, weights)
    choice = 0
    for i in range(ways):
        if model.into[halves[i]] == v:
            choice = i
    choice = code_choice(coder, weights, ways, choice)
    for i in range(ways):
        model.offers[ON_WAY, 0, turns[i]] += (weights[i] << 16) // total
    model.hits[ON_WAY, 0, turns[choice]] += 1 << 16
    return halves[choice]


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
def step_kind(model: WalkModel, u: int, back: int, node: int) -> int:
    """Kind of the step from u to ``node``, where ``back`` is the half-edge to where the walk came from."""
    if node == model.scalars[NODES]:
        return KIND_NEW_NODE
    if node == u:
        return KIND_STAY
    half = find_half_edge(model, u, node)
    if half < 0:
        return KIND_NEW_EDGE
    return KIND_BACK if half == back else KIND_KNOWN


@jit
def code_step_kind(
    coder: Coder, model: WalkModel, u: int, arrived: int, back: int, kind: int, last: int
) -> int:
    """Code the kind of a step from u, reached on the half-edge ``arrived``."""
    flags = model.flags
    degree, level = _depth(model, u)
    fresh = 1 if last >= KIND_NEW_NODE else 0
    if degree > 0:
        escape = code_bit(
            coder,
            flags,
            F_ESCAPE + (degree * 5 + level) * 2 + fresh,
            1 if kind >= KIND_NEW_EDGE else 0,
        )
    else:
        escape = 1
    if not escape:
        if back < 0:
            return KIND_KNOWN
        if degree == 1:
            return KIND_BACK
        seen = (
            2
            if arrived >= 0 and pair_count(model, arrived, back) > 0
            else (1 if model.count[back] > 0 else 0)
        )
        context = F_BACK + (min(degree, 4) * 3 + seen) * 2 + (1 if last == KIND_BACK else 0)
        return (
            KIND_BACK
            if code_bit(coder, flags, context, 1 if kind == KIND_BACK else 0)
            else KIND_KNOWN
        )
    if code_bit(coder, flags, F_STAY + min(last, 4) * 2 + fresh, 1 if kind == KIND_STAY else 0):
        return KIND_STAY
    if model.scalars[NODES] < 2:
        return KIND_NEW_NODE
    return (
        KIND_NEW_NODE
        if code_bit(
            coder,
            flags,
            F_NEW + min(degree, 3) * 5 + min(last, 4),
            1 if kind == KIND_NEW_NODE else 0,
        )
        else KIND_NEW_EDGE
    )
