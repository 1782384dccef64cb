"""Optimal partitions of a track against m given segments, by dynamic programming.

A row of moments has the columns of :mod:`gpszip.kernels.sums`. Intervals ``[a, b)`` grow from
their last sample backward, so that all candidates of one end b share the coefficients of the
segments about sample b - 1; time runs backward, and a segment from A to B becomes one from B to A.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, jit
from gpszip.kernels.sums import PrefixSums, add_moments, add_sample, best_line_cost
from gpszip.segmentation.kernels.shift import lowest_cost, segment_coefficients

__all__ = ["optimal_k_partition", "optimal_penalised_partition"]

#: Share of the squared extent by which rounding could lift a lower bound above a true cost.
_SLACK = 1e-9

#: Share of a segment at which an interval without duration stays, where time runs backward.
_BACKWARD = 1.0

#: Column of a row of moments that holds the sum of squared distances.
_SQUARES = 3


@inner
def _backward_moments(sums: PrefixSums, cuts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the moments of the samples between cuts about the last of them, time reversed."""
    rows = np.zeros((len(cuts) - 1, 2 * sums.p.shape[1] + 4))
    for j in range(len(rows)):
        last = cuts[j + 1] - 1
        for i in range(last, cuts[j] - 1, -1):
            add_sample(rows[j], sums.t[last] - sums.t[i], sums.w[i], sums.p, i, last)
    return rows


@jit
def optimal_penalised_partition(
    sums: PrefixSums,
    cuts: NDArray[np.int64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    penalty: float,
    min_samples: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Minimise cost + penalty * intervals over all partitions at given cuts.

    With ``c_l(a, b)`` the cost of the samples of [a, b) against segment l, the recurrence is

        F(b) = min over a < b of F(a) + min over l of c_l(a, b) + penalty,  F(0) = 0.

    The scan over a runs down from b. Two bounds prune it. Let ``free(a, b)`` be the cost against
    the samples' own best line: it is below every ``c_l(a, b)``, and
    ``free(a', b) >= free(a', a) + free(a, b)``. With

        H(a) = min over a' < a of F(a') + free(a', a),

    every a' < a costs at least ``H(a) + free(a, b) + penalty``. The scan stops where that reaches
    the best cost so far. And the m costs ``c_l(a, b)`` are computed only where
    ``F(a) + free(a, b) + penalty`` is below it.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    cuts : int64 array, shape (g + 1,)
        Samples at which intervals may start, increasing from 0, and the number of samples.
    starts, ends : float64 array, shape (m, d)
        The segments in position ticks.
    penalty : float
        Cost of an interval in squared position ticks.
    min_samples : int
        Fewest samples of an interval.

    Returns
    -------
    origin : int64 array, shape (g + 1,)
        For each cut b, the index of the start of the last interval in the best partition of
        [0, b).
    label : int64 array, shape (g + 1,)
        Segment of that interval.
    """
    d, m, count = sums.p.shape[1], len(starts), len(cuts)

    # F and H by index of cut, and how each F was reached
    best_costs, free_costs = np.full(count, np.inf), np.full(count, np.inf)
    best_costs[0] = 0.0
    origin, label = np.zeros(count, np.int64), np.zeros(count, np.int64)

    # For each cut b, find the last interval [a, b) of the best partition of [0, b).
    blocks = _backward_moments(sums, cuts)
    s, costs, row = np.empty((2 * d + 3, m)), np.empty(m), np.empty(2 * d + 4)
    for h in range(1, count):
        b = cuts[h]
        segment_coefficients(ends, starts, sums.p, b - 1, s)
        row[:] = 0.0
        best, best_free = np.inf, np.inf

        # Grow the interval backward from b, cut by cut.
        for g in range(h - 1, -1, -1):
            # Moments of [a, b) with a = cuts[g].
            last = cuts[g + 1] - 1
            add_moments(row, blocks[g], sums.t[b - 1] - sums.t[last], sums.p, last, b - 1)

            # Lower bound on the cost of any segment.
            free = best_line_cost(row)
            best_free = min(best_free, best_costs[g] + free)
            bound = free + penalty - _SLACK * row[_SQUARES]

            # The exact cost, where the bound leaves a chance.
            if b - cuts[g] >= min_samples and best_costs[g] + bound < best:
                length = sums.t[b - 1] - sums.t[cuts[g]]
                lowest = lowest_cost(row, length, _BACKWARD, s, costs, len(costs))
                cost = best_costs[g] + penalty + lowest
                if cost < best:
                    best, origin[h], label[h] = cost, g, int(np.argmin(costs))

            # No earlier start can be better.
            if free_costs[g] + bound >= best:
                break

        # Store F(b) and H(b).
        best_costs[h], free_costs[h] = best, best_free
    return origin, label


@inner
def _interval_costs(
    sums: PrefixSums, starts: NDArray[np.float64], ends: NDArray[np.float64], min_samples: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return tables ``[b, a]`` of the lowest cost and its segment for all intervals [a, b)."""
    # Measure positions from the last sample of [a, b), which is the same for all a.
    (n, d), m = sums.p.shape, len(starts)
    table = np.full((n + 1, n + 1), np.inf)
    labels = np.zeros((n + 1, n + 1), np.int32)
    s, costs, row = np.empty((2 * d + 3, m)), np.empty(m), np.empty(2 * d + 4)
    for b in range(1, n + 1):
        segment_coefficients(ends, starts, sums.p, b - 1, s)
        row[:] = 0.0

        # Grow [a, b) backward.
        for a in range(b - 1, -1, -1):
            x = sums.t[b - 1] - sums.t[a]
            add_sample(row, x, sums.w[a], sums.p, a, b - 1)
            if b - a >= min_samples:
                table[b, a] = lowest_cost(row, x, _BACKWARD, s, costs, len(costs))
                labels[b, a] = np.argmin(costs)
    return table, labels


@jit
def optimal_k_partition(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    k: int,
    min_samples: int,
) -> tuple[float, NDArray[np.int64], NDArray[np.int32]]:
    """Minimise the cost of exactly k intervals.

    With ``c(a, b)`` the lowest cost of [a, b) against any segment, the recurrence is

        F_j(b) = min over a < b of F_{j-1}(a) + c(a, b),  F_0(0) = 0.

    Time k n^2, memory n^2.

    Parameters
    ----------
    sums, starts, ends, min_samples
        As for :func:`optimal_penalised_partition`.
    k : int
        Number of intervals.

    Returns
    -------
    cost : float
        Squared position ticks.
    boundaries : int64 array, shape (k + 1,)
    labels : int32 array, shape (k,)
    """
    # Costs c(a, b) of all intervals.
    n = len(sums.t)
    table, table_labels = _interval_costs(sums, starts, ends, min_samples)

    # F_{j-1} and F_j, and the start of the last interval
    previous, current = np.full(n + 1, np.inf), np.full(n + 1, np.inf)
    previous[0] = 0.0
    origin = np.zeros((k + 1, n + 1), np.int32)
    for j in range(1, k + 1):
        current[:] = np.inf
        for b in range(j, n + 1):
            best, best_start = np.inf, 0
            for a in range(j - 1, b):
                cost = previous[a] + table[b, a]
                if cost < best:
                    best, best_start = cost, a
            current[b], origin[j, b] = best, best_start
        previous[:] = current

    # Trace back from the end.
    boundaries, labels = np.empty(k + 1, np.int64), np.empty(k, np.int32)
    boundaries[k] = n
    for j in range(k, 0, -1):
        b = boundaries[j]
        boundaries[j - 1] = origin[j, b]
        labels[j - 1] = table_labels[b, origin[j, b]]
    return float(previous[n]), boundaries, labels
