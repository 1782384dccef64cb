"""Ward's agglomeration of lines: merge the two groups whose common line costs least more.

A group of intervals is given by its normal matrix ``H = [[W, U1], [U1, U2]]``, as a row
``(W, U1, U2)`` of the array ``h``, and by its best line ``f(u) = A + u D``, as rows of the arrays
``a`` and ``v``, shape (k, d). Merging two groups increases the cost by exactly

    e' H_1 (H_1 + H_2)^-1 H_2 e  with  e = (A_1 - A_2, D_1 - D_2),

summed over the axes. No large sums cancel in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit, jit_uncounted

__all__ = ["merge_costs", "merge_pairs", "ward"]

#: A determinant below this share of W U2 is rounding: time has no spread, and the slope is 0.
_SINGULAR = 1e-14


@inner_uncounted
def _merge_cost(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], i: int, j: int
) -> float:
    """Return the increase of cost if groups i and j are merged."""
    # H_i + H_j
    w, u1, u2 = h[i, 0] + h[j, 0], h[i, 1] + h[j, 1], h[i, 2] + h[j, 2]
    det = w * u2 - u1 * u1

    # Add up e' H_i (H_i + H_j)^-1 H_j e over the axes, with e the difference of the lines.
    # If time has no spread, only the positions differ.
    increase = 0.0
    for c in range(a.shape[1]):
        e, s = a[i, c] - a[j, c], v[i, c] - v[j, c]
        if det <= _SINGULAR * w * u2:
            increase += h[i, 0] * h[j, 0] / w * e * e
            continue

        # y = H_j e, z = (H_i + H_j)^-1 y, and the product (H_i e)' z
        y0, y1 = h[j, 0] * e + h[j, 1] * s, h[j, 1] * e + h[j, 2] * s
        z0, z1 = (u2 * y0 - u1 * y1) / det, (w * y1 - u1 * y0) / det
        increase += (h[i, 0] * e + h[i, 1] * s) * z0 + (h[i, 1] * e + h[i, 2] * s) * z1
    return max(increase, 0.0)


@inner_uncounted
def _merge_groups(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], i: int, j: int
) -> None:
    """Merge group j into group i, in place: x_i += (H_i + H_j)^-1 H_j (x_j - x_i)."""
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


@inner_uncounted
def _nearest(
    h: NDArray[np.float64],
    a: NDArray[np.float64],
    v: NDArray[np.float64],
    live: NDArray[np.int64],
    count: int,
    i: int,
) -> tuple[int, float]:
    """Return the group among ``live[:count]`` that is cheapest to merge with i, and the cost."""
    nearest, best = -1, np.inf
    for g in range(count):
        j = live[g]
        if j != i:
            cost = _merge_cost(h, a, v, i, j)
            if cost < best:
                nearest, best = j, cost
    return nearest, best


@jit
def ward(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Merge k groups to one, in place; time k^2, memory k.

    Parameters
    ----------
    h, a, v : float64 arrays, shapes (k, 3), (k, d), (k, d)
        Normal matrices and best lines of the groups.

    Returns
    -------
    pairs : int64 array, shape (k - 1, 2)
        The merges in order: the second group was merged into the first one.
    costs : float64 array, shape (k - 1,)
        Increase of cost at each merge.
    """
    # Groups that are left, live[:count], and the merges.
    k = len(h)
    live, count = np.arange(k), k
    pairs, costs = np.empty((k - 1, 2), np.int64), np.empty(k - 1)

    # Nearest neighbour of each group, and the cost of merging with it.
    nearest, nearest_cost = np.empty(k, np.int64), np.empty(k)
    for i in range(k):
        nearest[i], nearest_cost[i] = _nearest(h, a, v, live, count, i)

    # Merge the cheapest pair until one group is left.
    for step in range(k - 1):
        # Cheapest merge.
        i = live[0]
        for g in range(1, count):
            if nearest_cost[live[g]] < nearest_cost[i]:
                i = live[g]
        costs[step] = nearest_cost[i]
        i, j = min(i, nearest[i]), max(i, nearest[i])
        pairs[step, 0], pairs[step, 1] = i, j
        _merge_groups(h, a, v, i, j)

        # Take j off the list.
        kept = 0
        for g in range(count):
            if live[g] != j:
                live[kept] = live[g]
                kept += 1
        count = kept

        # Neighbours that changed; the merged group may be nearer than others' neighbours.
        for g in range(count):
            other = live[g]
            if other == i or nearest[other] in (i, j):
                nearest[other], nearest_cost[other] = _nearest(h, a, v, live, count, other)
            else:
                cost = _merge_cost(h, a, v, other, i)
                if cost < nearest_cost[other]:
                    nearest[other], nearest_cost[other] = i, cost
    return pairs, costs


@jit_uncounted
def merge_pairs(
    h: NDArray[np.float64], a: NDArray[np.float64], v: NDArray[np.float64], pairs: NDArray[np.int64]
) -> None:
    """Merge the second group of each pair into the first one, in place."""
    for g in range(len(pairs)):
        _merge_groups(h, a, v, pairs[g, 0], pairs[g, 1])


@jit
def merge_costs(
    h: NDArray[np.float64],
    a: NDArray[np.float64],
    v: NDArray[np.float64],
    neighbours: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return the cost of merging each group with each of the groups in its row of neighbours."""
    costs = np.empty(neighbours.shape)
    for i in range(neighbours.shape[0]):
        for g in range(neighbours.shape[1]):
            costs[i, g] = _merge_cost(h, a, v, i, neighbours[i, g])
    return costs
