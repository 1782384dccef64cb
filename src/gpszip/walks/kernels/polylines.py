"""Fréchet distances of polylines, and distances of points from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit_uncounted

__all__ = ["discrete_frechet_square", "frechet_within", "nearest_squares"]

#: Larger than any parameter of a segment: nothing of it is reached.
_UNREACHED = 2.0


@inner_uncounted
def square_between(a: NDArray[np.float64], i: int, b: NDArray[np.float64], j: int) -> float:
    """Square of the distance of a_i and b_j."""
    square = 0.0
    for axis in range(a.shape[1]):
        difference = a[i, axis] - b[j, axis]
        square += difference * difference
    return square


@inner_uncounted
def first_free(
    p: NDArray[np.float64], i: int, q: NDArray[np.float64], j: int, square: float, low: float
) -> float:
    """Smallest s >= low with |q_j + s (q_{j+1} - q_j) - p_i|^2 <= square and s <= 1.

    With e = q_{j+1} - q_j and f = q_j - p_i, this is the quadratic inequality
    s^2 e.e + 2 s e.f + f.f - square <= 0. Where there is no such s, 2 is returned.
    """
    # Coefficients of the inequality.
    ee, ef, ff = 0.0, 0.0, 0.0
    for axis in range(p.shape[1]):
        e = q[j + 1, axis] - q[j, axis]
        f = q[j, axis] - p[i, axis]
        ee, ef, ff = ee + e * e, ef + e * f, ff + f * f
    rest = ff - square

    # A segment of one point is free as a whole or not at all.
    if ee <= 0.0:
        return low if rest <= 0.0 else _UNREACHED
    discriminant = ef * ef - ee * rest
    if discriminant < 0.0:
        return _UNREACHED
    root = np.sqrt(discriminant)
    first, last = (-ef - root) / ee, (-ef + root) / ee
    # The ends are compared by their distances, which rounding touches less.
    if rest <= 0.0 and first > 0.0:
        first = 0.0
    begin = max(first, low)
    return begin if begin <= min(last, 1.0) else _UNREACHED


@jit_uncounted
def frechet_within(
    p: NDArray[np.float64], q: NDArray[np.float64], radius: float, bottom: NDArray[np.float64]
) -> bool:
    """Whether the Fréchet distance of two polylines is at most ``radius``.

    The free space of the cell (i, j) are the pairs of points of the segments p_i p_{i+1} and
    q_j q_{j+1} that are at most ``radius`` apart; it is convex. What a monotone path reaches on the
    border above, from what it reaches on the left and below (Alt and Godau 1995):

        above(i, j) = free(p_{i+1}, q_j q_{j+1}), as a whole if something on the left is reached,
                      else from the first parameter that is reached below

    and alike on the right with p and q exchanged. Of each border only the first parameter that is
    reached is needed.

    Parameters
    ----------
    p, q : float64 arrays, shape (n, d) and (m, d)
        Vertices, n and m at least 2.
    radius : float
        Metres.
    bottom : float64 array, shape (m - 1,)
        Workspace: the first parameter that is reached below each cell of a row.
    """
    # Both ends must be near each other.
    n, m = len(p), len(q)
    square = radius * radius
    if square_between(p, 0, q, 0) > square or square_between(p, n - 1, q, m - 1) > square:
        return False

    # Below the first row: from the corner on, as far as there is no interruption.
    reaches = True
    for j in range(m - 1):
        bottom[j] = 0.0 if reaches else _UNREACHED
        reaches = reaches and square_between(p, 0, q, j + 1) <= square
    reaches = True

    # Row by row, cell by cell.
    is_end_reached = False
    for i in range(n - 1):
        left = 0.0 if reaches else _UNREACHED
        reaches = reaches and square_between(p, i + 1, q, 0) <= square
        any_reached = reaches
        for j in range(m - 1):
            below = bottom[j]
            is_end_reached = left < _UNREACHED or below < _UNREACHED
            if not is_end_reached:
                continue
            right = first_free(q, j + 1, p, i, square, 0.0 if below < _UNREACHED else left)
            bottom[j] = first_free(p, i + 1, q, j, square, 0.0 if left < _UNREACHED else below)
            any_reached = any_reached or bottom[j] < _UNREACHED
            left = right
        if not any_reached and i < n - 2:
            return False
    return is_end_reached


@jit_uncounted
def discrete_frechet_square(
    p: NDArray[np.float64], q: NDArray[np.float64], row: NDArray[np.float64]
) -> float:
    """Square of the discrete Fréchet distance of two sequences of vertices.

    c(i, j) = max(|p_i - q_j|^2, min(c(i - 1, j), c(i - 1, j - 1), c(i, j - 1))) (Eiter and Mannila
    1994).

    Parameters
    ----------
    p, q : float64 arrays, shape (n, d) and (m, d)
        Vertices.
    row : float64 array, shape (m,)
        Workspace: c(i, .).
    """
    for i in range(len(p)):
        diagonal = np.inf
        for j in range(len(q)):
            # The cheapest way to here; the first pair has none before it.
            before = min(row[j], diagonal) if i else np.inf
            if j:
                before = min(before, row[j - 1])
            diagonal = row[j]
            square = square_between(p, i, q, j)
            row[j] = square if i == 0 and j == 0 else max(square, before)
    return row[len(q) - 1]


@inner_uncounted
def square_from_segment(
    points: NDArray[np.float64], k: int, q: NDArray[np.float64], j: int
) -> float:
    """Square of the distance of the point k from the segment q_j q_{j+1}.

    With e = q_{j+1} - q_j and f = point - q_j it is |f - s e|^2, s = f.e / e.e cut to [0, 1].
    """
    ee, ef = 0.0, 0.0
    for axis in range(points.shape[1]):
        e = q[j + 1, axis] - q[j, axis]
        ee += e * e
        ef += e * (points[k, axis] - q[j, axis])
    s = min(max(ef / ee, 0.0), 1.0) if ee > 0.0 else 0.0
    square = 0.0
    for axis in range(points.shape[1]):
        e = q[j + 1, axis] - q[j, axis]
        difference = points[k, axis] - q[j, axis] - s * e
        square += difference * difference
    return square


@inner_uncounted
def square_from_box(
    points: NDArray[np.float64],
    k: int,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    block: int,
) -> float:
    """Square of the distance of the point k from the box between two corners."""
    square = 0.0
    for axis in range(points.shape[1]):
        x = points[k, axis]
        outside = max(low[block, axis] - x, x - high[block, axis], 0.0)
        square += outside * outside
    return square


@jit_uncounted
def nearest_squares(
    points: NDArray[np.float64],
    q: NDArray[np.float64],
    size: int,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    squares: NDArray[np.float64],
    nearest: NDArray[np.int64],
) -> int:
    """Write the number of the segment nearest to each point, and the square of its distance.

    Successive segments lie in blocks. A block whose box is no nearer than the nearest segment so
    far is left out. The block that holds the segment nearest to the point before comes first.

    Parameters
    ----------
    points, q : float64 arrays, shape (k, d) and (m, d)
        Metres; the segments are those between successive vertices of q.
    size : int
        Segments of a block.
    low, high : float64 arrays, shape (b, d)
        Corners of the box around each block.
    squares, nearest : float64 and int64 arrays, shape (k,)
        Filled in.

    Returns
    -------
    int
        Number of boxes and segments whose distance was computed.
    """
    computed, of_best = 0, 0
    for k in range(len(points)):
        likely, best = of_best // size, np.inf
        for turn in range(-1, len(low)):
            # The likely block is the first one, and comes only once.
            block = likely if turn < 0 else turn
            if turn == likely:
                continue
            computed += 1
            if square_from_box(points, k, low, high, block) >= best:
                continue

            # The nearest segment of the block.
            first, end = block * size, min((block + 1) * size, len(q) - 1)
            computed += end - first
            for j in range(first, end):
                square = square_from_segment(points, k, q, j)
                if square < best:
                    best, of_best = square, j
        squares[k], nearest[k] = best, of_best
    return computed
