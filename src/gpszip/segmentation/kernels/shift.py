"""The 2-segment mean against m given segments, and boundary shifts by it.

Source: the thesis, algorithm 2 and section 6.3. A window ``[a, b)`` of samples is cut at c. The
moments of the left interval ``[a, c)`` are about sample a. Those of the right interval ``[c, b)``
are about sample b - 1 with time running backward, where a segment from A to B becomes one from B
to A. So no sum is larger than its own interval, and all costs of a cut against m segments are one
product of its moments with a matrix (equation 6.14).

Names: ``row`` is a row of moments ``[W, X1, X2, Q, M_1..M_d, N_1..N_d]`` as in
:mod:`gpszip.kernels.sums`; ``s`` is the matrix of :func:`segment_coefficients`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit
from gpszip.kernels.sums import PrefixSums, add_sample, best_line_cost

__all__ = [
    "NO_CUT",
    "best_cut",
    "best_cuts",
    "lowest_cost",
    "segment_coefficients",
    "shift_boundaries",
    "shift_free_boundaries",
]

#: Share of the squared extent by which rounding could lift a lower bound above a true cost.
_SLACK = 1e-9

#: Column of a row of moments that holds the sum of squared distances.
_SQUARES = 3

#: Cut of :func:`best_cut` that stands for "no current state".
NO_CUT = -1


@inner_uncounted
def segment_coefficients(
    heads: NDArray[np.float64],
    tails: NDArray[np.float64],
    p: NDArray[np.float64],
    origin: int,
    out: NDArray[np.float64],
) -> None:
    """Write the vectors s of equation 6.13, one column for each segment.

    With A = head - origin and V = tail - head, a column is ``|A|^2, 2 A V, |V|^2, -2 A, -2 V``.

    Parameters
    ----------
    heads, tails : float64 array, shape (m, d)
        First and last points of the segments in the direction in which time runs.
    p : float64 array, shape (n, d)
        Positions of the samples.
    origin : int
        Sample about which the moments are taken.
    out : float64 array, shape (2 d + 3, m)
        Written.
    """
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


@inner_uncounted
def lowest_cost(
    row: NDArray[np.float64],
    length: float,
    still: float,
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
) -> float:
    """Write the costs of an interval against all segments; return the lowest.

    Equation 6.14: with the moments W, U1, U2, Q, M and N in normalised time u from 0 to 1,

        cost = Q + W |A|^2 + 2 U1 A V + U2 |V|^2 - 2 (A M + V N)

    Parameters
    ----------
    row : float64 array, shape (2 d + 4,)
        Moments of the interval, in time ticks.
    length : float
        Duration of the interval in time ticks.
    still : float
        Share of the segment at which an interval without duration stays: 0, or 1 where time runs
        backward.
    s : float64 array, shape (2 d + 3, m)
        Coefficients of the segments.
    costs : float64 array, shape (m,)
        Written.
    """
    m, d = len(costs), (len(row) - 4) // 2

    # Moments in normalised time.
    inverse = 1.0 / length if length > 0 else 0.0
    still = 0.0 if length > 0 else still
    w, q = row[0], row[3]
    u1, u2 = row[1] * inverse + w * still, row[2] * inverse * inverse + w * still

    # Equation 6.14: the moments times the coefficients of each segment.
    if d == 2:
        # Two axes in one loop over segments, which vectorises.
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
        # Any number of axes.
        for j in range(m):
            costs[j] = q + w * s[0, j] + u1 * s[1, j] + u2 * s[2, j]
        for c in range(d):
            m_c = row[4 + c]
            n_c = row[4 + d + c] * inverse + m_c * still
            for j in range(m):
                costs[j] += m_c * s[3 + c, j] + n_c * s[3 + d + c, j]

    # Take the lowest cost; its segment is sought only where a caller needs it.
    best: float = costs[0]
    for j in range(1, m):
        best = min(best, costs[j])
    return best


@inner_uncounted
def _left_moments(sums: PrefixSums, a: int, c: int, row: NDArray[np.float64]) -> None:
    """Write the moments of [a, c) about sample a."""
    row[:] = 0.0
    for i in range(a, c):
        add_sample(row, sums.t[i] - sums.t[a], sums.w[i], sums.p, i, a)


@inner_uncounted
def _right_moments(sums: PrefixSums, c: int, b: int, row: NDArray[np.float64]) -> None:
    """Write the moments of [c, b) about sample b - 1, with time running backward."""
    row[:] = 0.0
    for i in range(b - 1, c - 1, -1):
        add_sample(row, sums.t[b - 1] - sums.t[i], sums.w[i], sums.p, i, b - 1)


@inner
def _right_moment_table(sums: PrefixSums, a: int, b: int, table: NDArray[np.float64]) -> None:
    """Write the moments of [c, b) for all c from a to b, each to row c - a of the table."""
    table[b - a] = 0.0
    for i in range(b - 1, a - 1, -1):
        table[i - a] = table[i - a + 1]
        add_sample(table[i - a], sums.t[b - 1] - sums.t[i], sums.w[i], sums.p, i, b - 1)


@inner_uncounted
def _left_cost(
    sums: PrefixSums,
    a: int,
    c: int,
    row: NDArray[np.float64],
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
) -> float:
    """Write the costs of [a, c) against all segments; return the lowest."""
    if c == a:
        costs[:] = 0.0
        return 0.0
    return lowest_cost(row, sums.t[c - 1] - sums.t[a], 0.0, s, costs)


@inner_uncounted
def _right_cost(
    sums: PrefixSums,
    c: int,
    b: int,
    row: NDArray[np.float64],
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
) -> float:
    """Write the costs of [c, b) against all segments; return the lowest."""
    if c == b:
        costs[:] = 0.0
        return 0.0
    return lowest_cost(row, sums.t[b - 1] - sums.t[c], 1.0, s, costs)


@inner_uncounted
def _both_costs(
    sums: PrefixSums,
    a: int,
    c: int,
    b: int,
    left_row: NDArray[np.float64],
    right_row: NDArray[np.float64],
    s_left: NDArray[np.float64],
    s_right: NDArray[np.float64],
    left_costs: NDArray[np.float64],
    right_costs: NDArray[np.float64],
) -> None:
    """Write the moments and the costs of both sides of a cut."""
    _left_moments(sums, a, c, left_row)
    _right_moments(sums, c, b, right_row)
    _left_cost(sums, a, c, left_row, s_left, left_costs)
    _right_cost(sums, c, b, right_row, s_right, right_costs)


@jit
def best_cut(
    sums: PrefixSums,
    a: int,
    b: int,
    min_samples: int,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    current_cut: int,
    current_left: int,
    current_right: int,
    table: NDArray[np.float64],
    naive: bool,
) -> tuple[float, int, int, int]:
    """Cut [a, b) where two of the segments fit best (algorithm 2).

    Minimises ``min_l c_l(a, c) + min_r c_r(c, b)`` over c, both ends included. Costs against the
    samples' own best lines are lower bounds and prune the search: the left one never falls as c
    grows, so that it ends the scan.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    a, b : int
        The window.
    min_samples : int
        Fewest samples on each side.
    starts, ends : float64 array, shape (m, d)
        The segments in position ticks.
    current_cut, current_left, current_right : int
        The current cut and its labels, which win a tie; ``NO_CUT`` if there is none.
    table : float64 array, shape (b - a + 1 or more, 2 d + 4)
        Scratch.
    naive : bool
        Whether to recompute the sums of every candidate and to prune nothing (6.3.1). The result is
        the same.

    Returns
    -------
    cost : float
        Squared position ticks.
    cut : int
    left, right : int
        Labels of both sides.
    """
    # Coefficients of the segments about either end of the window.
    m, d = starts.shape
    s_left, s_right = np.empty((2 * d + 3, m)), np.empty((2 * d + 3, m))
    segment_coefficients(starts, ends, sums.p, a, s_left)
    segment_coefficients(ends, starts, sums.p, b - 1, s_right)
    left_costs, right_costs = np.empty(m), np.empty(m)
    left_row, right_row = np.zeros(2 * d + 4), np.empty(2 * d + 4)

    # The current state is the first candidate: without it, descent would be lost.
    best, cut, left, right = np.inf, current_cut, current_left, current_right
    if current_cut != NO_CUT:
        _both_costs(
            sums,
            a,
            current_cut,
            b,
            left_row,
            right_row,
            s_left,
            s_right,
            left_costs,
            right_costs,
        )
        best = left_costs[current_left] + right_costs[current_right]
        left_row[:] = 0.0

    # Try all cuts c from left to right.
    if not naive:
        _right_moment_table(sums, a, b, table)
    for c in range(a, b + 1 - min_samples):
        # Moments of both sides.
        if naive:
            _left_moments(sums, a, c, left_row)
            _right_moments(sums, c, b, right_row)
        else:
            if c > a:
                x = sums.t[c - 1] - sums.t[a]
                add_sample(left_row, x, sums.w[c - 1], sums.p, c - 1, a)
            right_row = table[c - a]
        if c - a < min_samples:
            continue

        # Lower bounds, less what rounding may add to them.
        if naive:
            right_bound = 0.0
        else:
            free = best_line_cost(left_row)
            slack = _SLACK * (left_row[_SQUARES] + right_row[_SQUARES])
            if free - slack >= best:
                break
            right_bound = best_line_cost(right_row) - slack
            if free + right_bound >= best:
                continue

        # Costs against the segments; the right side only if the left one leaves a chance.
        cost = _left_cost(sums, a, c, left_row, s_left, left_costs)
        if cost + right_bound >= best and not naive:
            continue
        cost += _right_cost(sums, c, b, right_row, s_right, right_costs)
        if cost < best:
            best, cut = cost, c
            left, right = int(np.argmin(left_costs)), int(np.argmin(right_costs))
    return best, cut, left, right


@inner_uncounted
def _widest_window(boundaries: NDArray[np.int64], first: int, last: int, step: int) -> np.int64:
    """Return the most samples between the neighbours of any boundary that is shifted."""
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
    """Shift boundaries one after the other to the best cut between their neighbours, in place.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    boundaries : int64 array, shape (k + 1,)
        Changed.
    labels : int32 array, shape (k,)
        Changed with the boundaries beside them.
    starts, ends : float64 array, shape (m, d)
        The segments in position ticks.
    first, last, step : int
        Range of the boundaries to shift.
    min_samples, naive
        As for :func:`best_cut`.
    """
    # Windows grow where every boundary is shifted, as the left neighbour moves first.
    widest = _widest_window(boundaries, first, last, step)
    table = np.empty((widest * (2 if step == 1 else 1) + 1, 2 * sums.p.shape[1] + 4))

    # Shift from left to right; each window ends at the neighbours as they are by then.
    for j in range(first, last, step):
        a, b = boundaries[j - 1], boundaries[j + 1]
        if b - a >= len(table):
            table = np.empty((2 * (b - a), table.shape[1]))
        _, cut, left, right = best_cut(
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
        boundaries[j], labels[j - 1], labels[j] = cut, left, right


@jit
def shift_free_boundaries(
    sums: PrefixSums, boundaries: NDArray[np.int64], first: int, min_samples: int
) -> float:
    """Shift every second boundary to where the best lines of both sides cost least, in place.

    Each side has its own best line instead of one of m segments: minimises
    ``free(a, c) + free(c, b)`` over c.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    boundaries : int64 array, shape (k + 1,)
        Changed.
    first : int
        First boundary to shift; then every second one.
    min_samples : int
        Fewest samples on each side.

    Returns
    -------
    float
        Decrease of the cost in squared position ticks.
    """
    # Take every second boundary, so that the ends of the windows stay in place.
    widest = _widest_window(boundaries, first, len(boundaries) - 1, 2)
    table = np.empty((widest + 1, 2 * sums.p.shape[1] + 4))
    row = np.empty(table.shape[1])
    gain = 0.0
    for j in range(first, len(boundaries) - 1, 2):
        a, b, cut = boundaries[j - 1], boundaries[j + 1], boundaries[j]

        # Cost of the current cut.
        _right_moment_table(sums, a, b, table)
        _left_moments(sums, a, cut, row)
        current = best_line_cost(row) + best_line_cost(table[cut - a])
        best = current

        # All others; the cost of the left side never falls as c grows.
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
                best, cut = cost, c

        # Move the boundary, and add up what that saves.
        boundaries[j] = cut
        gain += current - best
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
    """Find the best cut of every interval in two.

    Parameters
    ----------
    sums, boundaries, labels, starts, ends, min_samples
        As for :func:`shift_boundaries`; nothing is changed.

    Returns
    -------
    gains : float64 array, shape (k,)
        Decrease of the cost by each cut; -inf for intervals that are too short.
    cuts : int64 array, shape (k,)
    left, right : int32 array, shape (k,)
        Labels of both sides.
    """
    # Cut only intervals with enough samples for two.
    k = len(labels)
    gains, cuts = np.full(k, -np.inf), np.zeros(k, np.int64)
    left, right = np.zeros(k, np.int32), np.zeros(k, np.int32)
    m, d = starts.shape
    s, costs, row = np.empty((2 * d + 3, m)), np.empty(m), np.empty(2 * d + 4)
    for j in range(k):
        a, b = boundaries[j], boundaries[j + 1]
        if b - a < 2 * min_samples:
            continue

        # Cost of two intervals.
        table = np.empty((b - a + 1, 2 * d + 4))
        best, cuts[j], left[j], right[j] = best_cut(
            sums, a, b, min_samples, starts, ends, NO_CUT, 0, 0, table, False
        )

        # Cost of one.
        segment_coefficients(starts, ends, sums.p, a, s)
        _left_moments(sums, a, b, row)
        lowest_cost(row, sums.t[b - 1] - sums.t[a], 0.0, s, costs)
        gains[j] = costs[labels[j]] - best
    return gains, cuts, left, right
