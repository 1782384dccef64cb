"""The 2-segment mean against m given segments, and the boundary shifts made of it (thesis, algorithm 2 and section 6.3).

A window [a, b) is cut at c. The left part's moments grow about sample a, the right part's about sample b - 1 with time
running backward, where a segment from A to B is the segment from B to A. So no sum is ever larger than its own part,
and all costs of a cut against m segments are one product of its moments with a matrix (equation 6.14).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.kernels.sums import PrefixSums, add_sample, best_line_cost

__all__ = [
    "best_cut",
    "best_cuts",
    "lowest_cost",
    "segment_coefficients",
    "shift_boundaries",
    "shift_free_boundaries",
]

#: Share of the squared extent by which rounding could lift a lower bound above a true cost.
_SLACK = 1e-9


@jit
def segment_coefficients(
    heads: NDArray[np.float64],
    tails: NDArray[np.float64],
    p: NDArray[np.float64],
    origin: int,
    out: NDArray[np.float64],
) -> None:
    """Write the vectors s of equation 6.13 for segments from heads to tails, as columns of ``out``, shape (2 d + 3, m)."""
    m, d = heads.shape
    for s in range(m):
        out[0, s], out[1, s], out[2, s] = 0.0, 0.0, 0.0
        for c in range(d):
            a = heads[s, c] - p[origin, c]
            v = tails[s, c] - heads[s, c]
            out[0, s] += a * a
            out[1, s] += 2.0 * a * v
            out[2, s] += v * v
            out[3 + c, s] = -2.0 * a
            out[3 + d + c, s] = -2.0 * v


@jit
def lowest_cost(
    row: NDArray[np.float64],
    length: float,
    still: float,
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
) -> float:
    """Write the costs of a part against all segments (equation 6.14); return the lowest.

    A part without duration stands at a share ``still`` of the segment: 0, and 1 where time runs backward.
    """
    m, d = len(costs), (len(row) - 4) // 2
    inverse = 1.0 / length if length > 0 else 0.0
    still = 0.0 if length > 0 else still
    w, q = row[0], row[3]
    u1, u2 = row[1] * inverse + w * still, row[2] * inverse * inverse + w * still
    if d == 2:
        m1, m2 = row[4], row[5]
        n1, n2 = row[6] * inverse + m1 * still, row[7] * inverse + m2 * still
        for j in range(m):
            costs[j] = (
                q
                + w * s[0, j]
                + u1 * s[1, j]
                + u2 * s[2, j]
                + m1 * s[3, j]
                + m2 * s[4, j]
                + n1 * s[5, j]
                + n2 * s[6, j]
            )
    else:
        for j in range(m):
            costs[j] = q + w * s[0, j] + u1 * s[1, j] + u2 * s[2, j]
        for c in range(d):
            first = row[4 + c]
            second = row[4 + d + c] * inverse + first * still
            for j in range(m):
                costs[j] += first * s[3 + c, j] + second * s[3 + d + c, j]
    best: float = costs[0]
    for j in range(1, m):
        best = min(best, costs[j])
    return best


@jit
def _left_moments(sums: PrefixSums, a: int, c: int, row: NDArray[np.float64]) -> None:
    row[:] = 0.0
    for i in range(a, c):
        add_sample(row, sums.t[i] - sums.t[a], sums.w[i], sums.p, i, a)


@jit
def _right_moments(sums: PrefixSums, c: int, b: int, row: NDArray[np.float64]) -> None:
    row[:] = 0.0
    for i in range(b - 1, c - 1, -1):
        add_sample(row, sums.t[b - 1] - sums.t[i], sums.w[i], sums.p, i, b - 1)


@jit
def _right_moment_table(sums: PrefixSums, a: int, b: int, table: NDArray[np.float64]) -> None:
    table[b - a] = 0.0
    for i in range(b - 1, a - 1, -1):
        table[i - a] = table[i - a + 1]
        add_sample(table[i - a], sums.t[b - 1] - sums.t[i], sums.w[i], sums.p, i, b - 1)


@jit
def _left_cost(
    sums: PrefixSums,
    a: int,
    c: int,
    row: NDArray[np.float64],
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
) -> float:
    if c == a:
        costs[:] = 0.0
        return 0.0
    return lowest_cost(row, sums.t[c - 1] - sums.t[a], 0.0, s, costs)


@jit
def _right_cost(
    sums: PrefixSums,
    c: int,
    b: int,
    row: NDArray[np.float64],
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
) -> float:
    if c == b:
        costs[:] = 0.0
        return 0.0
    return lowest_cost(row, sums.t[b - 1] - sums.t[c], 1.0, s, costs)


@jit
def _both_costs(
    sums: PrefixSums,
    a: int,
    c: int,
    b: int,
    row: NDArray[np.float64],
    other: NDArray[np.float64],
    s_left: NDArray[np.float64],
    s_right: NDArray[np.float64],
    lefts: NDArray[np.float64],
    rights: NDArray[np.float64],
) -> None:
    _left_moments(sums, a, c, row)
    _right_moments(sums, c, b, other)
    _left_cost(sums, a, c, row, s_left, lefts)
    _right_cost(sums, c, b, other, s_right, rights)


@jit
def best_cut(
    sums: PrefixSums,
    a: int,
    b: int,
    min_samples: int,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    now: int,
    left_now: int,
    right_now: int,
    table: NDArray[np.float64],
    naive: bool,
) -> tuple[float, int, int, int]:
    """Cut [a, b) where two of the segments fit best; return the cost, the cut and both labels.

    The present state, ``now`` with its labels, is the first candidate; a negative ``now`` says that there is none.
    ``naive`` sums every candidate up anew and bounds nothing (section 6.3.1); the result is the same.
    """
    m, d = starts.shape
    s_left, s_right = np.empty((2 * d + 3, m)), np.empty((2 * d + 3, m))
    segment_coefficients(starts, ends, sums.p, a, s_left)
    segment_coefficients(ends, starts, sums.p, b - 1, s_right)
    lefts, rights = np.empty(m), np.empty(m)
    row, other = np.zeros(2 * d + 4), np.empty(2 * d + 4)
    best, at, left, right = np.inf, now, left_now, right_now
    if now >= 0:
        _both_costs(sums, a, now, b, row, other, s_left, s_right, lefts, rights)
        best = lefts[left_now] + rights[right_now]
        row[:] = 0.0
    if not naive:
        _right_moment_table(sums, a, b, table)
    for c in range(a, b + 1 - min_samples):
        if naive:
            _left_moments(sums, a, c, row)
            _right_moments(sums, c, b, other)
        else:
            if c > a:
                add_sample(row, sums.t[c - 1] - sums.t[a], sums.w[c - 1], sums.p, c - 1, a)
            other = table[c - a]
        if c - a < min_samples:
            continue
        if naive:
            bound = 0.0
        else:
            free = best_line_cost(row)
            slack = _SLACK * (row[3] + other[3])
            if free - slack >= best:
                break
            bound = best_line_cost(other) - slack
            if free + bound >= best:
                continue
        cost = _left_cost(sums, a, c, row, s_left, lefts)
        if cost + bound >= best and not naive:
            continue
        cost += _right_cost(sums, c, b, other, s_right, rights)
        if cost < best:
            best, at, left, right = cost, c, int(np.argmin(lefts)), int(np.argmin(rights))
    return best, at, left, right


@jit
def _widest_window(boundaries: NDArray[np.int64], first: int, last: int, step: int) -> np.int64:
    widest = np.int64(0)
    for j in range(first, last, step):
        widest = max(widest, boundaries[j + 1] - boundaries[j - 1])
    return widest


@jit
def shift_boundaries(
    sums: PrefixSums,
    boundaries: NDArray[np.int64],
    labels: NDArray[np.int32],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    first: int,
    last: int,
    step: int,
    min_samples: int,
    naive: bool,
) -> None:
    """Shift boundaries first, first + step, ... below last, one after the other, in place, with the labels beside them."""
    table = np.empty(
        (
            _widest_window(boundaries, first, last, step) * (2 if step == 1 else 1) + 1,
            2 * sums.p.shape[1] + 4,
        )
    )
    for j in range(first, last, step):
        a, b = boundaries[j - 1], boundaries[j + 1]
        if b - a >= len(table):
            table = np.empty((2 * (b - a), table.shape[1]))
        _, at, left, right = best_cut(
            sums,
            a,
            b,
            min_samples,
            starts,
            ends,
            boundaries[j],
            labels[j - 1],
            labels[j],
            table,
            naive,
        )
        boundaries[j], labels[j - 1], labels[j] = at, left, right


@jit
def shift_free_boundaries(
    sums: PrefixSums, boundaries: NDArray[np.int64], first: int, min_samples: int
) -> float:
    """Shift every second boundary from ``first`` to where two lines of their own fit best, in place; return the gain."""
    table = np.empty(
        (_widest_window(boundaries, first, len(boundaries) - 1, 2) + 1, 2 * sums.p.shape[1] + 4)
    )
    row = np.empty(table.shape[1])
    gain = 0.0
    for j in range(first, len(boundaries) - 1, 2):
        a, b, at = boundaries[j - 1], boundaries[j + 1], boundaries[j]
        _right_moment_table(sums, a, b, table)
        _left_moments(sums, a, at, row)
        now = best_line_cost(row) + best_line_cost(table[at - a])
        best = now
        row[:] = 0.0
        for c in range(a + 1, b + 1 - min_samples):
            add_sample(row, sums.t[c - 1] - sums.t[a], sums.w[c - 1], sums.p, c - 1, a)
            if c - a < min_samples:
                continue
            left = best_line_cost(row)
            if left >= best:
                break
            cost = left + best_line_cost(table[c - a])
            if cost < best:
                best, at = cost, c
        boundaries[j] = at
        gain += now - best
    return gain


@jit
def best_cuts(
    sums: PrefixSums,
    boundaries: NDArray[np.int64],
    labels: NDArray[np.int32],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    min_samples: int,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """Cut every part in two; return the gains (-inf where too short), the cuts and both labels."""
    k = len(labels)
    gains, at = np.full(k, -np.inf), np.zeros(k, np.int64)
    left, right = np.zeros(k, np.int32), np.zeros(k, np.int32)
    m, d = starts.shape
    s, costs, row = np.empty((2 * d + 3, m)), np.empty(m), np.empty(2 * d + 4)
    for j in range(k):
        a, b = boundaries[j], boundaries[j + 1]
        if b - a < 2 * min_samples:
            continue
        table = np.empty((b - a + 1, 2 * d + 4))
        best, at[j], left[j], right[j] = best_cut(
            sums, a, b, min_samples, starts, ends, -1, 0, 0, table, False
        )
        segment_coefficients(starts, ends, sums.p, a, s)
        _left_moments(sums, a, b, row)
        lowest_cost(row, sums.t[b - 1] - sums.t[a], 0.0, s, costs)
        gains[j] = costs[labels[j]] - best
    return gains, at, left, right
