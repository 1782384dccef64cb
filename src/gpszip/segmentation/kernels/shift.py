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

from gpszip.kernels.jit import inner_uncounted, jit
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

#: Lower bounds are taken at each of so many samples: they take as long as the costs themselves.
_EVERY = 8

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
    m: int,
) -> float:
    """Write the costs of an interval against the first m segments of a table; return the lowest.

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
    s : float64 array, shape (2 d + 3, m or more)
        Coefficients of the segments.
    costs : float64 array, shape (m or more,)
        Written.
    m : int
        Number of segments, at least one.
    """
    d = (len(row) - 4) // 2

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


@inner_uncounted
def _right_moment_table(sums: PrefixSums, a: int, b: int, table: NDArray[np.float64]) -> None:
    """Write the moments of [c, b) for all c from a to b, each to row c - a of the table."""
    # Rows are not taken as arrays: that would take as long as the sums.
    d = sums.p.shape[1]
    p, t, weights = sums.p, sums.t, sums.w
    for column in range(2 * d + 4):
        table[b - a, column] = 0.0
    for i in range(b - 1, a - 1, -1):
        j, x, w = i - a, t[b - 1] - t[i], weights[i]
        table[j, 0] = table[j + 1, 0] + w
        table[j, 1] = table[j + 1, 1] + w * x
        table[j, 2] = table[j + 1, 2] + w * x * x
        squares = table[j + 1, 3]
        for c in range(d):
            r = p[i, c] - p[b - 1, c]
            squares += w * r * r
            table[j, 4 + c] = table[j + 1, 4 + c] + w * r
            table[j, 4 + d + c] = table[j + 1, 4 + d + c] + w * x * r
        table[j, 3] = squares


@inner_uncounted
def _left_cost(
    sums: PrefixSums,
    a: int,
    c: int,
    row: NDArray[np.float64],
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
    m: int,
) -> float:
    """Write the costs of [a, c) against the first m segments of a table; return the lowest."""
    if c == a:
        costs[:m] = 0.0
        return 0.0
    return lowest_cost(row, sums.t[c - 1] - sums.t[a], 0.0, s, costs, m)


@inner_uncounted
def _right_cost(
    sums: PrefixSums,
    c: int,
    b: int,
    row: NDArray[np.float64],
    s: NDArray[np.float64],
    costs: NDArray[np.float64],
    m: int,
) -> float:
    """Write the costs of [c, b) against the first m segments of a table; return the lowest."""
    if c == b:
        costs[:m] = 0.0
        return 0.0
    return lowest_cost(row, sums.t[b - 1] - sums.t[c], 1.0, s, costs, m)


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
    _left_cost(sums, a, c, left_row, s_left, left_costs, len(left_costs))
    _right_cost(sums, c, b, right_row, s_right, right_costs, len(right_costs))


@inner_uncounted
def _squared_distance(
    p: NDArray[np.float64],
    i: int,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    label: int,
    inverse: float,
) -> float:
    """Return the squared distance of sample i from the nearest point of a segment.

    ``inverse`` is one over the squared length of the segment, 0 if it has none.
    """
    # Share of the segment at which the nearest point lies.
    share = 0.0
    for c in range(p.shape[1]):
        share += (p[i, c] - starts[label, c]) * (ends[label, c] - starts[label, c])
    share = min(max(share * inverse, 0.0), 1.0)

    # Distance from it.
    total = 0.0
    for c in range(p.shape[1]):
        e = p[i, c] - starts[label, c] - share * (ends[label, c] - starts[label, c])
        total += e * e
    return total


@inner_uncounted
def _window_squares(sums: PrefixSums, a: int, b: int, table: NDArray[np.float64]) -> float:
    """Return the sums of squared distances of [a, b) from sample b - 1 and from sample a.

    With the moments Q, M and W about sample b - 1, and r from sample a to it, the latter is
    ``Q + 2 r M + |r|^2 W``.
    """
    squares = 2.0 * table[0, _SQUARES]
    for c in range(sums.p.shape[1]):
        r = sums.p[b - 1, c] - sums.p[a, c]
        squares += 2.0 * r * table[0, 4 + c] + r * r * table[0, 0]
    return squares


@inner_uncounted
def _invert_lengths(
    starts: NDArray[np.float64], ends: NDArray[np.float64], inverse: NDArray[np.float64]
) -> None:
    """Write one over the squared length of each segment, 0 for those without a length."""
    for label in range(len(starts)):
        total = 0.0
        for c in range(starts.shape[1]):
            total += (ends[label, c] - starts[label, c]) ** 2
        inverse[label] = 1.0 / total if total > 0 else 0.0


@inner_uncounted
def _first_right_cuts(
    sums: PrefixSums,
    a: int,
    b: int,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    inverse: NDArray[np.float64],
    limit: float,
    cuts: NDArray[np.int64],
) -> None:
    """Write the first cut from which each segment may be the right one.

    The cost of [c, b) is at least the sum over its samples of their squared distances from the
    segment, wherever it is at their times. Some of the samples suffice for a lower bound. Before
    the cut, it is above the limit.
    """
    for label in range(len(starts)):
        cuts[label] = a
        total = 0.0
        for i in range(b - 1, a - 1, -_EVERY):
            total += sums.w[i] * _squared_distance(sums.p, i, starts, ends, label, inverse[label])
            if total > limit:
                cuts[label] = i + 1
                break


@inner_uncounted
def _order_columns(
    keys: NDArray[np.int64], order: NDArray[np.int64], s: NDArray[np.float64]
) -> None:
    """Sort keys, with the order and the columns of a table, by insertion; in place."""
    for j in range(1, len(keys)):
        i = j
        while i > 0 and keys[i - 1] > keys[i]:
            _swap_columns(keys, order, s, i - 1, i)
            i -= 1


@inner_uncounted
def _swap_columns(
    keys: NDArray[np.int64], order: NDArray[np.int64], s: NDArray[np.float64], i: int, j: int
) -> None:
    keys[i], keys[j] = keys[j], keys[i]
    order[i], order[j] = order[j], order[i]
    for row in range(len(s)):
        s[row, i], s[row, j] = s[row, j], s[row, i]


@inner_uncounted
def _drop_far_segments(
    sums: PrefixSums,
    i: int,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    inverse: NDArray[np.float64],
    limit: float,
    bounds: NDArray[np.float64],
    order: NDArray[np.int64],
    s: NDArray[np.float64],
    count: int,
) -> int:
    """Add sample i to the lower bounds of the left segments; drop those above the limit.

    Returns the number of segments that are left; they come first in the order, the bounds and the
    table.
    """
    j = 0
    while j < count:
        label = order[j]
        bounds[j] += sums.w[i] * _squared_distance(sums.p, i, starts, ends, label, inverse[label])
        if bounds[j] > limit:
            # The last one takes its place.
            count -= 1
            bounds[j], order[j], order[count] = bounds[count], order[count], label
            for row in range(len(s)):
                s[row, j] = s[row, count]
        else:
            j += 1
    return count


@inner_uncounted
def _cheapest(costs: NDArray[np.float64], order: NDArray[np.int64], count: int) -> int:
    """Return the label with the lowest cost; of equal ones the least label."""
    best = 0
    for j in range(1, count):
        if costs[j] < costs[best] or (costs[j] == costs[best] and order[j] < order[best]):
            best = j
    return int(order[best])


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
    grows, so that it ends the scan. Distances of samples from the segments as lines prune segments:
    their sums over [a, c) never fall as c grows, nor do those over [c, b) as it shrinks.

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

    # Segments that may be the left or the right one; far ones are none of them.
    left_order, right_order, inverse = np.arange(m), np.arange(m), np.empty(m)
    left_bounds, right_cuts = np.zeros(m), np.full(m, a)
    lefts, rights = m, 0
    slack, next_bound, left_bound, right_bound = 0.0, a, 0.0, 0.0
    if not naive:
        _right_moment_table(sums, a, b, table)
        slack = _SLACK * _window_squares(sums, a, b, table)
        _invert_lengths(starts, ends, inverse)
        limit = best * (1 + _SLACK) + slack
        _first_right_cuts(sums, a, b, starts, ends, inverse, limit, right_cuts)
        _order_columns(right_cuts, right_order, s_right)

    # Try all cuts c from left to right.
    for c in range(a, b + 1 - min_samples):
        # Moments of both sides.
        if naive:
            _left_moments(sums, a, c, left_row)
            _right_moments(sums, c, b, right_row)
        elif c > a:
            x = sums.t[c - 1] - sums.t[a]
            add_sample(left_row, x, sums.w[c - 1], sums.p, c - 1, a)

        # Segments of both sides.
        while rights < m and right_cuts[rights] <= c:
            rights += 1
        if not naive and c > a and (c - 1 - a) % _EVERY == 0:
            limit = best * (1 + _SLACK) + slack
            lefts = _drop_far_segments(
                sums,
                c - 1,
                starts,
                ends,
                inverse,
                limit,
                left_bounds,
                left_order,
                s_left,
                lefts,
            )
            if lefts == 0:
                break
        if c - a < min_samples or rights == 0:
            continue

        # Lower bounds, less what rounding may add to them.
        if not naive:
            if c >= next_bound:
                left_bound = best_line_cost(left_row) - slack
                if left_bound >= best:
                    break
                next_bound = min(c + _EVERY, b)
                right_bound = best_line_cost(table[next_bound - a]) - slack
                next_bound += 1
            if left_bound + right_bound >= best:
                continue
            right_row = table[c - a]

        # Costs against the segments; the right side only if the left one leaves a chance.
        cost = _left_cost(sums, a, c, left_row, s_left, left_costs, lefts)
        if cost + right_bound >= best and not naive:
            continue
        cost += _right_cost(sums, c, b, right_row, s_right, right_costs, rights)
        if cost < best:
            best, cut = cost, c
            left = _cheapest(left_costs, left_order, lefts)
            right = _cheapest(right_costs, right_order, rights)
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
        lowest_cost(row, sums.t[b - 1] - sums.t[a], 0.0, s, costs, m)
        gains[j] = costs[labels[j]] - best
    return gains, cuts, left, right
