"""Cost of a piecewise linear function on blocks of samples: an estimate, and strict bounds.

On a block let g be its best line and r the residuals of the samples from it. r is orthogonal to
every line, and ``|r|^2 = e`` is the free cost. For any line l, the cost of a function f is

    |f - p|^2 = |f - g|^2 + e - 2 <f - l, r>,  with  |<f - l, r>| <= |f - l| sqrt(e).

Where f is a line on the entire block, take l = f: the cost is exact. Where f breaks inside,

    |f - g|^2 = |l - g|^2 + <f - l, f + l - 2 g>

needs sums over some of the samples. Their times are known as even steps, up to the block's
jitter. How much a sum can change when every time moves by the jitter is bounded by the slopes and
the jumps of its terms. Three lines l are tried; each bound is the best of the three.

Lines are arrays of shape (2, d): position and velocity, relative to the block's first sample.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit
from gpszip.sketches.kernels.blocks import (
    COUNT,
    DEPTH,
    FIRST,
    FIXED_COLUMNS,
    JITTER,
    LAST,
    MEAN_TIME,
    REACH,
    SPREAD,
    WEIGHT,
    are_times_exact,
    free_cost,
    has_slope,
)

__all__ = ["block_costs"]

#: Relative rounding of one float operation, times what a block's few dozen operations add up to.
_ROUNDING = 64 * 1.2e-16

#: Relative rounding of a time, with a margin of four.
_TIME_ROUNDING = 4 * 2.3e-16

#: Column of a result: best guess of the cost.
_ESTIMATE = 0

#: Column of a result: lower bound on the cost.
_LOWER = 1

#: Column of a result: upper bound on the cost.
_UPPER = 2


@jit
def block_costs(
    rows: NDArray[np.float64],
    start_times: NDArray[np.float64],
    breaks: NDArray[np.float64],
    starts: NDArray[np.float64],
    velocities: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return estimate, lower and upper bound of the cost of f on each block, shape (B, 3).

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks, in order of time.
    start_times : float64 array, shape (k,)
        Time at which each piece is at its start.
    breaks : float64 array, shape (k - 1,)
        Increasing times from which on the next piece counts.
    starts, velocities : float64 arrays, shape (k, d)
        Metres, and metres per second.
    """
    # Go through blocks and pieces together: both are in order of time.
    out, k = np.empty((len(rows), 3)), len(start_times)
    lines = np.empty((k, 2, starts.shape[1]))
    first = 0
    for i in range(len(rows)):
        row = rows[i]

        # Pieces that the samples of the block fall in.
        while first < k - 1 and breaks[first] <= row[FIRST]:
            first += 1
        last = first
        while last < k - 1 and breaks[last] <= row[LAST]:
            last += 1
        rounding = _relative_lines(row, start_times, starts, velocities, first, last, lines)

        # Exact on one piece; bounds where f breaks.
        if last == first:
            cost = _line_cost(row, lines[first])
            out[i, _ESTIMATE] = out[i, _LOWER] = out[i, _UPPER] = cost
        else:
            _broken_block_costs(row, breaks, lines, first, last, out[i])
        out[i, _LOWER] = max(out[i, _LOWER] - rounding, 0.0)
        out[i, _UPPER] += rounding
    return out


@inner_uncounted
def _relative_lines(
    row: NDArray[np.float64],
    start_times: NDArray[np.float64],
    starts: NDArray[np.float64],
    velocities: NDArray[np.float64],
    first: int,
    last: int,
    lines: NDArray[np.float64],
) -> float:
    """Write pieces first to last as lines relative to the block's first sample.

    Returns a bound on the rounding error of a cost.
    """
    # Each line about the first sample: its position there in metres, and its velocity in m/s.
    d = starts.shape[1]
    duration = row[LAST] - row[FIRST]
    max_distance, max_terms = row[REACH], 0.0
    for j in range(first, last + 1):
        dt = row[FIRST] - start_times[j]
        speed_square, distance_square, terms = 0.0, 0.0, 0.0
        for c in range(d):
            lines[j, 1, c] = velocities[j, c]
            lines[j, 0, c] = (starts[j, c] - row[FIXED_COLUMNS + c]) + velocities[j, c] * dt
            speed_square += velocities[j, c] ** 2
            distance_square += lines[j, 0, c] ** 2
            terms += abs(starts[j, c] - row[FIXED_COLUMNS + c]) + abs(velocities[j, c] * dt)

        # Largest distance of a sample from the line, and size of the terms that may cancel.
        distance = row[REACH] + np.sqrt(distance_square) + np.sqrt(speed_square) * duration
        max_distance = max(max_distance, distance)
        max_terms = max(max_terms, terms)

    # Rounding of the moments, and of the lines.
    shift = max_terms * _ROUNDING
    return float(
        row[WEIGHT]
        * (
            _ROUNDING * (row[DEPTH] + 1) * max_distance * max_distance
            + 4 * shift * (max_distance + shift)
        )
    )


@inner_uncounted
def _line_cost(row: NDArray[np.float64], line: NDArray[np.float64]) -> float:
    """Return the cost of a block against a line: its free cost, and |line - best line|^2."""
    d = line.shape[1]
    mean_column = FIXED_COLUMNS + d
    cost = free_cost(row)
    for c in range(d):
        difference = line[0, c] + line[1, c] * row[MEAN_TIME] - row[mean_column + c]
        slope_difference = line[1, c] - _slope(row, c)
        cost += (
            row[WEIGHT] * difference * difference
            + row[SPREAD] * slope_difference * slope_difference
        )
    return float(cost)


@inner_uncounted
def _slope(row: NDArray[np.float64], c: int) -> float:
    """Return the slope of the best line along axis c: drift / SPREAD."""
    d = (len(row) - FIXED_COLUMNS) // 3
    drift_column = FIXED_COLUMNS + 2 * d
    return float(row[drift_column + c] / row[SPREAD] if has_slope(row) else 0.0)


@inner_uncounted
def _first_step_at(row: NDArray[np.float64], step: float, time: float) -> int:
    """Return the number of the first even step at or after a time."""
    i = int(min(max(np.ceil((time - row[FIRST]) / step), 0.0), row[COUNT]))
    # The division may have rounded to a neighbour.
    while i > 0 and row[FIRST] + step * (i - 1) >= time:
        i -= 1
    while i < row[COUNT] and row[FIRST] + step * i < time:
        i += 1
    return i


@inner
def _broken_block_costs(
    row: NDArray[np.float64],
    breaks: NDArray[np.float64],
    lines: NDArray[np.float64],
    first: int,
    last: int,
    out: NDArray[np.float64],
) -> None:
    """Write estimate and bounds of the cost on a block in which f breaks."""
    # Free cost of the block, and its mean time step in seconds.
    d = lines.shape[2]
    mean_column = FIXED_COLUMNS + d
    free, step = free_cost(row), (row[LAST] - row[FIRST]) / (row[COUNT] - 1)

    # Even steps at which the pieces start.
    cuts = np.empty(last - first + 2, np.int64)
    cuts[0], cuts[-1] = 0, int(row[COUNT])
    for j in range(first, last):
        cuts[j - first + 1] = _first_step_at(row, step, breaks[j])

    # The best line g.
    g = np.empty((2, d))
    for c in range(d):
        g[1, c] = _slope(row, c)
        g[0, c] = row[mean_column + c] - g[1, c] * row[MEAN_TIME]

    # Lines l: the one nearest to f, the first piece and the last one.
    nearest = _project_pieces(row, lines, cuts, first, step)
    out[_ESTIMATE], out[_LOWER], out[_UPPER] = 0.0, 0.0, np.inf
    for attempt in range(3):
        line = nearest if attempt == 0 else lines[first] if attempt == 1 else lines[last]

        # |f - p|^2 = (|l - g|^2 + e) + <f - l, f + l - 2 g> - 2 <f - l, r>
        even, lowest, highest = _sum_bounds(row, breaks, lines, cuts, first, step, line, g)
        _, _, square = _sum_bounds(row, breaks, lines, cuts, first, step, line, line)
        cost, cross = _line_cost(row, line), 2.0 * np.sqrt(max(square, 0.0) * free)
        if attempt == 0:
            out[_ESTIMATE] = max(cost + even, 0.0)
        out[_LOWER] = max(out[_LOWER], cost + lowest - cross)
        out[_UPPER] = min(out[_UPPER], cost + highest + cross)

    # The estimate is from the first l only: keep it within the best bounds of all three.
    out[_ESTIMATE] = min(max(out[_ESTIMATE], out[_LOWER]), out[_UPPER])


@inner
def _project_pieces(
    row: NDArray[np.float64],
    lines: NDArray[np.float64],
    cuts: NDArray[np.int64],
    first: int,
    step: float,
) -> NDArray[np.float64]:
    """Return the line nearest to f over even steps, by least squares."""
    d = lines.shape[2]

    # n even steps have the mean time step (n - 1) / 2 and the spread step^2 n (n^2 - 1) / 12
    count = row[COUNT]
    mean_time = step * (count - 1) / 2
    spread = step * step * count * (count * count - 1) / 12

    # Mean and drift of f, piece by piece.
    mean, drift = np.zeros(d), np.zeros(d)
    for j in range(len(cuts) - 1):
        m = float(cuts[j + 1] - cuts[j])
        x = step * (cuts[j] + cuts[j + 1] - 1) / 2
        piece_spread = step * step * m * (m * m - 1) / 12
        for c in range(d):
            position = lines[first + j, 0, c] + lines[first + j, 1, c] * x
            mean[c] += m * position
            drift[c] += m * position * (x - mean_time) + lines[first + j, 1, c] * piece_spread

    # Slope from drift and spread, and position at the block's first sample from the means.
    out = np.empty((2, d))
    for c in range(d):
        out[1, c] = drift[c] / spread
        out[0, c] = mean[c] / count - out[1, c] * mean_time
    return out


@inner_uncounted
def _product_at(
    piece: NDArray[np.float64], line: NDArray[np.float64], g: NDArray[np.float64], x: float
) -> tuple[float, float]:
    """Return value and slope at time x of <f - l, f + l - 2 g>, where f is the line ``piece``."""
    value, slope = 0.0, 0.0
    for c in range(piece.shape[1]):
        p, dp = piece[0, c] - line[0, c], piece[1, c] - line[1, c]
        q, dq = piece[0, c] + line[0, c] - 2 * g[0, c], piece[1, c] + line[1, c] - 2 * g[1, c]
        value += (p + dp * x) * (q + dq * x)
        slope += dp * (q + dq * x) + dq * (p + dp * x)
    return value, slope


@inner_uncounted
def _sum_bounds(
    row: NDArray[np.float64],
    breaks: NDArray[np.float64],
    lines: NDArray[np.float64],
    cuts: NDArray[np.int64],
    first: int,
    step: float,
    line: NDArray[np.float64],
    g: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Bound the weighted sum of h = <f - l, f + l - 2 g> over the samples of a block.

    With g = l it is ``|f - l|^2``. On each piece h is a parabola in time.

    Returns
    -------
    even : float
        The sum over even steps.
    lowest, highest : float
        Bounds on the sum over the samples, whose times are off even steps by the jitter.
    """
    # Each sample counts with the mean weight; if weights differ, the jitter is infinite.
    d = lines.shape[2]
    duration, weight_each = row[LAST] - row[FIRST], row[WEIGHT] / row[COUNT]

    # Rounding of the times adds to the jitter.
    jitter = row[JITTER]
    if not are_times_exact(row[FIRST], step, duration):
        jitter += _TIME_ROUNDING * (duration + abs(row[FIRST]))

    # Sum over even steps, bound on its change as times move, and extremes of h.
    total, error, minimum, maximum = 0.0, 0.0, np.inf, -np.inf
    # At most this many samples pass any point when all times move by the jitter.
    passing = np.floor(2 * jitter / step) + 1.0
    for j in range(len(cuts) - 1):
        piece = lines[first + j]

        # Sum over the piece's m even steps about their mean x; curve is half the second derivative.
        m = float(cuts[j + 1] - cuts[j])
        x = step * (cuts[j] + cuts[j + 1] - 1) / 2
        curve = 0.0
        for c in range(d):
            curve += (piece[1, c] - line[1, c]) * (piece[1, c] + line[1, c] - 2 * g[1, c])
        total += m * _product_at(piece, line, g, x)[0] + curve * step * step * m * (m * m - 1) / 12

        # h at both ends of the piece, and at the vertex of the parabola if it lies between
        a = max(breaks[first + j - 1] - row[FIRST], 0.0) if j > 0 else 0.0
        b = min(breaks[first + j] - row[FIRST], duration) if j < len(cuts) - 2 else duration
        at_a, slope_a = _product_at(piece, line, g, a)
        at_b, slope_b = _product_at(piece, line, g, b)
        vertex = (
            at_a - slope_a * slope_a / (4 * curve) if slope_a * slope_b < 0 and curve != 0 else at_a
        )
        piece_minimum, piece_maximum = min(at_a, at_b, vertex), max(at_a, at_b, vertex)
        minimum, maximum = min(minimum, piece_minimum), max(maximum, piece_maximum)

        # Change of the sum as times move: by the total variation of h, or by its steepest slope.
        steepest = max(abs(slope_a), abs(slope_b))
        variation = abs(at_a - vertex) + abs(at_b - vertex)
        error += min(passing * variation, steepest * 2 * jitter * ((b - a + 2 * jitter) / step + 2))

        # Change by samples that may cross the jump at the start of the piece.
        if j > 0:
            crossing = _first_step_at(row, step, breaks[first + j - 1] + jitter) - _first_step_at(
                row, step, breaks[first + j - 1] - jitter
            )
            jump = abs(at_a - _product_at(lines[first + j - 1], line, g, a)[0])
            error += jump * crossing if jitter > 0 and crossing > 0 else 0.0

    # Whatever the times, each sample has a value between the extremes.
    weight = row[WEIGHT]
    even = weight_each * total
    if not np.isfinite(jitter):
        return (
            min(max(even, weight * minimum), weight * maximum),
            weight * minimum,
            weight * maximum,
        )
    return (
        even,
        max(even - weight_each * error, weight * minimum),
        min(even + weight_each * error, weight * maximum),
    )
