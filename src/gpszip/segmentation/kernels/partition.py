"""The best partition of a whole track against m given segments, by dynamic programming."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.sums import PrefixSums, add_moments, add_sample, best_line_cost
from gpszip.segmentation.kernels.shift import lowest_cost, segment_coefficients

__all__ = ["optimal_k_partition", "optimal_penalised_partition"]

_SLACK = 1e-9


@jit
def _backward_moments(sums: PrefixSums, cuts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Moments of the samples between cuts about the last of them, with time running backward."""
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
    """Minimise cost + penalty * parts over parts that begin and end at cuts; return each cut's best last cut and label.

    F(b) = min over a of F(a) + min over l of c_l(a, b) + penalty. The scan of a runs down from b. With fr the cost of
    the samples' own best line, which is below every c_l and at least adds up when parts are joined, and
    H(a) = min over a' of F(a') + fr(a', a), every a' below a costs F(a') + fr(a', b) >= H(a) + fr(a, b): the scan
    stops where that reaches the best F(b). A part is priced against the m segments only if F(a) + fr(a, b) is below it.
    """
    d, m, count = sums.p.shape[1], len(starts), len(cuts)
    total, joined = np.full(count, np.inf), np.full(count, np.inf)
    total[0] = 0.0
    origin, label = np.zeros(count, np.int64), np.zeros(count, np.int64)
    blocks = _backward_moments(sums, cuts)
    s, costs, row = np.empty((2 * d + 3, m)), np.empty(m), np.empty(2 * d + 4)
    for h in range(1, count):
        b = cuts[h]
        segment_coefficients(ends, starts, sums.p, b - 1, s)
        row[:] = 0.0
        best, reach = np.inf, np.inf
        for g in range(h - 1, -1, -1):
            last = cuts[g + 1] - 1
            add_moments(row, blocks[g], sums.t[b - 1] - sums.t[last], sums.p, last, b - 1)
            free = best_line_cost(row)
            reach = min(reach, total[g] + free)
            bound = free + penalty - _SLACK * row[3]
            if b - cuts[g] >= min_samples and total[g] + bound < best:
                cost = (
                    total[g]
                    + penalty
                    + lowest_cost(row, sums.t[b - 1] - sums.t[cuts[g]], 1.0, s, costs)
                )
                if cost < best:
                    best, origin[h], label[h] = cost, g, int(np.argmin(costs))
            if joined[g] + bound >= best:
                break
        total[h], joined[h] = best, reach
    return origin, label


@jit
def _interval_costs(
    sums: PrefixSums, starts: NDArray[np.float64], ends: NDArray[np.float64], min_samples: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    (n, d), m = sums.p.shape, len(starts)
    table = np.full((n + 1, n + 1), np.inf)
    labels = np.zeros((n + 1, n + 1), np.int32)
    s, costs, row = np.empty((2 * d + 3, m)), np.empty(m), np.empty(2 * d + 4)
    for b in range(1, n + 1):
        segment_coefficients(ends, starts, sums.p, b - 1, s)
        row[:] = 0.0
        for a in range(b - 1, -1, -1):
            x = sums.t[b - 1] - sums.t[a]
            add_sample(row, x, sums.w[a], sums.p, a, b - 1)
            if b - a >= min_samples:
                table[b, a] = lowest_cost(row, x, 1.0, s, costs)
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
    """Minimise the cost of exactly k parts; return the cost, the boundaries and the labels. Time k n^2, memory n^2."""
    n = len(sums.t)
    table, pair_labels = _interval_costs(sums, starts, ends, min_samples)
    total, above = np.full(n + 1, np.inf), np.full(n + 1, np.inf)
    total[0] = 0.0
    origin = np.zeros((k + 1, n + 1), np.int32)
    for j in range(1, k + 1):
        above[:] = np.inf
        for b in range(j, n + 1):
            best, at = np.inf, 0
            for a in range(j - 1, b):
                cost = total[a] + table[b, a]
                if cost < best:
                    best, at = cost, a
            above[b], origin[j, b] = best, at
        total[:] = above
    boundaries, labels = np.empty(k + 1, np.int64), np.empty(k, np.int32)
    boundaries[k] = n
    for j in range(k, 0, -1):
        b = boundaries[j]
        boundaries[j - 1] = origin[j, b]
        labels[j - 1] = pair_labels[b, origin[j, b]]
    return float(total[n]), boundaries, labels
