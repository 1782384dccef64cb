"""Agglomeration of lines: join the two groups whose common line costs least more.

A group of parts is its normal matrix H = [[W, U1], [U1, U2]] and its best line x = (A, D), f(u) = A + u D. Joining two
groups costs exactly e' H_1 (H_1 + H_2)^-1 H_2 e with e = x_1 - x_2, summed over the axes: no large sums cancel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["merge_costs", "merge_pairs", "ward"]

#: Share of its trace below which a normal matrix has no slope to solve for.
_SINGULAR = 1e-14


@jit
def _merge_cost(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], i: int, j: int
) -> float:
    w, u1, u2 = h[i, 0] + h[j, 0], h[i, 1] + h[j, 1], h[i, 2] + h[j, 2]
    det = w * u2 - u1 * u1
    total = 0.0
    for c in range(a.shape[1]):
        e, s = a[i, c] - a[j, c], v[i, c] - v[j, c]
        if det <= _SINGULAR * w * u2:
            total += h[i, 0] * h[j, 0] / w * e * e
            continue
        y0, y1 = h[j, 0] * e + h[j, 1] * s, h[j, 1] * e + h[j, 2] * s
        z0, z1 = (u2 * y0 - u1 * y1) / det, (w * y1 - u1 * y0) / det
        total += (h[i, 0] * e + h[i, 1] * s) * z0 + (h[i, 1] * e + h[i, 2] * s) * z1
    return max(total, 0.0)


@jit
def _merge_groups(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], i: int, j: int
) -> None:
    """Put group j into group i, in place."""
    w, u1, u2 = h[i, 0] + h[j, 0], h[i, 1] + h[j, 1], h[i, 2] + h[j, 2]
    det = w * u2 - u1 * u1
    for c in range(a.shape[1]):
        e, s = a[j, c] - a[i, c], v[j, c] - v[i, c]
        if det <= _SINGULAR * w * u2:
            a[i, c] += h[j, 0] / w * e
            v[i, c] = 0.0
            continue
        y0, y1 = h[j, 0] * e + h[j, 1] * s, h[j, 1] * e + h[j, 2] * s
        a[i, c] += (u2 * y0 - u1 * y1) / det
        v[i, c] += (w * y1 - u1 * y0) / det
    h[i, 0], h[i, 1], h[i, 2] = w, u1, u2


@jit
def _nearest(
    h: NDArray[np.float64],
    a: NDArray[np.float64],
    v: NDArray[np.float64],
    live: NDArray[np.int64],
    count: int,
    i: int,
) -> tuple[int, float]:
    at, best = -1, np.inf
    for g in range(count):
        j = live[g]
        if j != i:
            cost = _merge_cost(h, a, v, i, j)
            if cost < best:
                at, best = j, cost
    return at, best


@jit
def ward(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Join k groups to one, in place; return the k - 1 pairs (into, from) in order and their costs. Time k^2, memory k."""
    k = len(h)
    live, count = np.arange(k), k
    pairs, costs = np.empty((k - 1, 2), np.int64), np.empty(k - 1)
    near, gap = np.empty(k, np.int64), np.empty(k)
    for i in range(k):
        near[i], gap[i] = _nearest(h, a, v, live, count, i)
    for step in range(k - 1):
        i = live[0]
        for g in range(1, count):
            if gap[live[g]] < gap[i]:
                i = live[g]
        costs[step] = gap[i]
        i, j = min(i, near[i]), max(i, near[i])
        pairs[step, 0], pairs[step, 1] = i, j
        _merge_groups(h, a, v, i, j)
        kept = 0
        for g in range(count):
            if live[g] != j:
                live[kept] = live[g]
                kept += 1
        count = kept
        for g in range(count):
            other = live[g]
            if other == i or near[other] in (i, j):
                near[other], gap[other] = _nearest(h, a, v, live, count, other)
            else:
                cost = _merge_cost(h, a, v, other, i)
                if cost < gap[other]:
                    near[other], gap[other] = i, cost
    return pairs, costs


@jit
def merge_pairs(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], pairs: NDArray[np.int64]
) -> None:
    """Put the second group of each pair into the first, in place."""
    for g in range(len(pairs)):
        _merge_groups(h, a, v, pairs[g, 0], pairs[g, 1])


@jit
def merge_costs(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], near: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Cost of joining each group with each of those named in its row of ``near``."""
    costs = np.empty(near.shape)
    for i in range(near.shape[0]):
        for g in range(near.shape[1]):
            costs[i, g] = _merge_cost(h, a, v, i, near[i, g])
    return costs
