"""Bottom-up merging of segments, and least-squares vertices of the line that is left.

Bottom-up merging is the segmentation of Keogh et al. (ICDM 2001), here on squared synchronised
distances. The vertices are not samples: they minimise the squared distances of all samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.heap import pop, push
from gpszip.kernels.jit import inner_uncounted, jit

from .log import Floats, Integers, Log

#: Weight of the kept sample in its vertex, where no other sample decides.
RIDGE = 1e-3

#: That weight for a vertex that is pinned to its sample.
PINNED = 1e9


def simplify(log: Log, tolerance: float) -> Integers:
    """Remove samples, always the one that adds the least squared distance.

    A sample stays if the line without it would pass another sample farther than ``tolerance``.
    """
    n = len(log.clock)
    keys, items = np.empty(3 * n), np.empty(3 * n, np.int64)
    kept = _mark_kept(log.clock, log.x, log.y, log.firsts, tolerance, keys, items)
    return np.flatnonzero(kept)


def fit_vertices(
    log: Log, kept: Integers, knot_clock: Floats, pinned: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Least-squares vertices of the line with knots at the given times.

    Pinned vertices are where their samples are.
    """
    weights = np.where(pinned, PINNED, RIDGE)
    return _fit_vertices(log.clock, log.x, log.y, kept, knot_clock, weights)


@jit
def _mark_kept(
    t: Floats,
    x: Floats,
    y: Floats,
    firsts: Integers,
    tolerance: float,
    keys: Floats,
    items: Integers,
) -> NDArray[np.bool_]:
    """Mark the samples that are left.

    Removing q between its neighbours a and b costs ``E(a, b) - E(a, q) - E(q, b)``, where E is the
    sum of squared synchronised distances. A heap on ``keys`` and ``items`` holds the costs; those
    that have changed since are left in it, and skipped.
    """
    # All samples are kept; ends have no cost.
    n = len(t)
    before, after = np.arange(n) - 1, np.arange(n) + 1
    kept = np.ones(n, np.bool_)
    cost = np.full(n, np.inf)
    is_end = np.zeros(n, np.bool_)
    for track in range(len(firsts) - 1):
        is_end[firsts[track]] = is_end[firsts[track + 1] - 1] = True

    # The costs of removing one sample.
    size = 0
    for q in range(n):
        if not is_end[q]:
            cost[q] = _removal_cost(t, x, y, q - 1, q, q + 1, tolerance)
            if cost[q] < np.inf:
                size = push(keys, items, size, cost[q], q)

    # Remove the cheapest, and find the new costs of its neighbours.
    while size > 0:
        key = keys[0]
        q, size = pop(keys, items, size)
        if not kept[q] or key != cost[q]:
            continue
        kept[q] = False
        a, b = before[q], after[q]
        after[a], before[b] = b, a
        for neighbour in (a, b):
            if not is_end[neighbour]:
                cost[neighbour] = _removal_cost(
                    t, x, y, before[neighbour], neighbour, after[neighbour], tolerance
                )
                if cost[neighbour] < np.inf:
                    size = push(keys, items, size, cost[neighbour], neighbour)
    return kept


@inner_uncounted
def _removal_cost(
    t: Floats, x: Floats, y: Floats, a: int, q: int, b: int, tolerance: float
) -> float:
    """Squared distance that removing q adds; infinite if a sample would be too far."""
    merged, farthest = _chord_error(t, x, y, a, b)
    if farthest > tolerance * tolerance:
        return np.inf
    return merged - _chord_error(t, x, y, a, q)[0] - _chord_error(t, x, y, q, b)[0]


@inner_uncounted
def _chord_error(t: Floats, x: Floats, y: Floats, a: int, b: int) -> tuple[float, float]:
    """Sum, and largest, of the squared synchronised distances of the samples between a and b."""
    total = farthest = 0.0
    duration = t[b] - t[a]
    vx, vy = (x[b] - x[a]) / duration, (y[b] - y[a]) / duration
    for i in range(a + 1, b):
        dx = x[i] - x[a] - vx * (t[i] - t[a])
        dy = y[i] - y[a] - vy * (t[i] - t[a])
        squared = dx * dx + dy * dy
        total += squared
        farthest = max(farthest, squared)
    return total, farthest


@jit
def _fit_vertices(
    t: Floats, x: Floats, y: Floats, kept: Integers, knots: Floats, weights: Floats
) -> tuple[Floats, Floats]:
    """Vertices v that minimise ``sum |(1 - w) v_j + w v_{j+1} - p|^2`` over all samples.

    Sample i lies between the knots j and j + 1, at the share w of that interval. For each knot,
    ``weight |v_j - p_j|^2`` is added, with its own sample p_j. The normal equations have three
    diagonals and are solved by elimination from the first knot to the last.
    """
    # A single knot is its sample.
    count = len(knots)
    if count == 1:
        return x[kept], y[kept]

    # The diagonal, the one beside it, and both right sides.
    diagonal, beside = weights.copy(), np.zeros(count)
    right = np.empty((count, 2))
    for k in range(count):
        right[k, 0], right[k, 1] = weights[k] * x[kept[k]], weights[k] * y[kept[k]]
    j = 0
    for i in range(len(t)):
        while j + 2 < count and knots[j + 1] <= t[i]:
            j += 1
        w = min(max((t[i] - knots[j]) / (knots[j + 1] - knots[j]), 0.0), 1.0)
        diagonal[j] += (1 - w) * (1 - w)
        diagonal[j + 1] += w * w
        beside[j] += w * (1 - w)
        right[j, 0] += (1 - w) * x[i]
        right[j, 1] += (1 - w) * y[i]
        right[j + 1, 0] += w * x[i]
        right[j + 1, 1] += w * y[i]

    # Eliminate downwards, and solve upwards.
    for k in range(1, count):
        factor = beside[k - 1] / diagonal[k - 1]
        diagonal[k] -= factor * beside[k - 1]
        right[k, 0] -= factor * right[k - 1, 0]
        right[k, 1] -= factor * right[k - 1, 1]
    for k in range(count - 1, -1, -1):
        for axis in range(2):
            if k + 1 < count:
                right[k, axis] -= beside[k] * right[k + 1, axis]
            right[k, axis] /= diagonal[k]
    return right[:, 0].copy(), right[:, 1].copy()
