"""What a piecewise linear function costs on blocks of samples: an estimate, and bounds that hold for the samples themselves.

On a block, let g be its best line and r what the samples lie off it, so that r is orthogonal to every line and |r|^2 = e is the
free cost. For any line l the cost of f is

    |f - p|^2 = |f - g|^2 + e - 2 <f - l, r>,     |<f - l, r>| <= |f - l| sqrt(e).

Where f is a line on the whole block, l = f, and the cost is exact. Where f breaks, |f - g|^2 = |l - g|^2 + <f - l, f + l - 2 g>
needs sums over some of the samples. Their times are known as even steps, give or take the block's jitter; what a function's sum
can change when every time moves by so much is bounded by its slope and its jumps. Several l are tried; the bounds are the best of all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
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

#: Relative rounding of one float operation, times what a block's few dozen operations can add up to.
_ROUNDING = 64 * 1.2e-16


@jit
def block_costs(
    rows: NDArray[np.float64],
    begins: NDArray[np.float64],
    breaks: NDArray[np.float64],
    starts: NDArray[np.float64],
    speeds: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Estimate, lower and upper bound of what pieces cost on each block, shape (B, 3).

    Parameters
    ----------
    rows : float64 array, shape (B, 10 + 3 d)
        Blocks, in order of time.
    begins : float64 array, shape (k,)
        Instant at which each piece is at its start.
    breaks : float64 array, shape (k - 1,)
        Increasing instants at which the next piece takes over.
    starts, speeds : float64 arrays, shape (k, d)
        Metres and metres per second.
    """
    out, k = np.empty((len(rows), 3)), len(begins)
    lines = np.empty((k, 2, starts.shape[1]))
    j = 0
    for i in range(len(rows)):
        row = rows[i]
        while j < k - 1 and breaks[j] <= row[FIRST]:
            j += 1
        last = j
        while last < k - 1 and breaks[last] <= row[LAST]:
            last += 1
        slack = _relative_lines(row, begins, starts, speeds, j, last, lines)
        if last == j:
            cost = _line_cost(row, lines[j])
            out[i, 0] = out[i, 1] = out[i, 2] = cost
        else:
            _broken_block_costs(row, breaks, lines, j, last, out[i])
        out[i, 1] = max(out[i, 1] - slack, 0.0)
        out[i, 2] += slack
    return out


@jit
def _relative_lines(
    row: NDArray[np.float64],
    begins: NDArray[np.float64],
    starts: NDArray[np.float64],
    speeds: NDArray[np.float64],
    low: int,
    high: int,
    lines: NDArray[np.float64],
) -> float:
    """Write lines as position and speed about the block's first sample; return how far rounding can move a cost."""
    d = starts.shape[1]
    span = row[LAST] - row[FIRST]
    far, off = row[REACH], 0.0
    for j in range(low, high + 1):
        dt = row[FIRST] - begins[j]
        speed, away, moved = 0.0, 0.0, 0.0
        for c in range(d):
            lines[j, 1, c] = speeds[j, c]
            lines[j, 0, c] = (starts[j, c] - row[FIXED_COLUMNS + c]) + speeds[j, c] * dt
            speed += speeds[j, c] ** 2
            away += lines[j, 0, c] ** 2
            moved += abs(starts[j, c] - row[FIXED_COLUMNS + c]) + abs(speeds[j, c] * dt)
        far = max(far, row[REACH] + np.sqrt(away) + np.sqrt(speed) * span)
        off = max(off, moved)
    off *= _ROUNDING
    return float(row[WEIGHT] * (_ROUNDING * (row[DEPTH] + 1) * far * far + 4 * off * (far + off)))


@jit
def _line_cost(row: NDArray[np.float64], line: NDArray[np.float64]) -> float:
    """Cost of a block against a line: that of its own best line, and that of the difference of the two."""
    d = line.shape[1]
    cost = free_cost(row)
    for c in range(d):
        away = line[0, c] + line[1, c] * row[MEAN_TIME] - row[FIXED_COLUMNS + d + c]
        lean = line[1, c] - _slope(row, c)
        cost += row[WEIGHT] * away * away + row[SPREAD] * lean * lean
    return float(cost)


@jit
def _slope(row: NDArray[np.float64], c: int) -> float:
    d = (len(row) - FIXED_COLUMNS) // 3
    return float(row[FIXED_COLUMNS + 2 * d + c] / row[SPREAD] if has_slope(row) else 0.0)


@jit
def _first_step_at(row: NDArray[np.float64], step: float, instant: float) -> int:
    """Number of the first even step at or after an instant."""
    i = int(min(max(np.ceil((instant - row[FIRST]) / step), 0.0), row[COUNT]))
    while i > 0 and row[FIRST] + step * (i - 1) >= instant:
        i -= 1
    while i < row[COUNT] and row[FIRST] + step * i < instant:
        i += 1
    return i


@jit
def _broken_block_costs(
    row: NDArray[np.float64],
    breaks: NDArray[np.float64],
    lines: NDArray[np.float64],
    low: int,
    high: int,
    out: NDArray[np.float64],
) -> None:
    d = lines.shape[2]
    free, step = free_cost(row), (row[LAST] - row[FIRST]) / (row[COUNT] - 1)
    cuts = np.empty(high - low + 2, np.int64)
    cuts[0], cuts[-1] = 0, int(row[COUNT])
    for j in range(low, high):
        cuts[j - low + 1] = _first_step_at(row, step, breaks[j])
    g = np.empty((2, d))
    for c in range(d):
        g[1, c] = _slope(row, c)
        g[0, c] = row[FIXED_COLUMNS + d + c] - g[1, c] * row[MEAN_TIME]
    mean = _project_pieces(row, lines, cuts, low, step)
    out[0], out[1], out[2] = 0.0, 0.0, np.inf
    for attempt in range(3):
        line = mean if attempt == 0 else lines[low] if attempt == 1 else lines[high]
        even, least, most = _sum_bounds(row, breaks, lines, cuts, low, step, line, g)
        _, _, square = _sum_bounds(row, breaks, lines, cuts, low, step, line, line)
        own, cross = _line_cost(row, line), 2.0 * np.sqrt(max(square, 0.0) * free)
        if attempt == 0:
            out[0] = max(own + even, 0.0)
        out[1] = max(out[1], own + least - cross)
        out[2] = min(out[2], own + most + cross)
    out[0] = min(max(out[0], out[1]), out[2])


@jit
def _project_pieces(
    row: NDArray[np.float64],
    lines: NDArray[np.float64],
    cuts: NDArray[np.int64],
    low: int,
    step: float,
) -> NDArray[np.float64]:
    """The line nearest to the pieces over even steps."""
    d = lines.shape[2]
    count = row[COUNT]
    middle = step * (count - 1) / 2
    spread = step * step * count * (count * count - 1) / 12
    mean, drift = np.zeros(d), np.zeros(d)
    for j in range(len(cuts) - 1):
        m = float(cuts[j + 1] - cuts[j])
        x = step * (cuts[j] + cuts[j + 1] - 1) / 2
        own = step * step * m * (m * m - 1) / 12
        for c in range(d):
            at = lines[low + j, 0, c] + lines[low + j, 1, c] * x
            mean[c] += m * at
            drift[c] += m * at * (x - middle) + lines[low + j, 1, c] * own
    out = np.empty((2, d))
    for c in range(d):
        out[1, c] = drift[c] / spread
        out[0, c] = mean[c] / count - out[1, c] * middle
    return out


@jit
def _product_at(
    a: NDArray[np.float64], line: NDArray[np.float64], g: NDArray[np.float64], x: float
) -> tuple[float, float]:
    """Value and slope at x of <f - l, f + l - 2 g>, f being the line ``a``."""
    value, slope = 0.0, 0.0
    for c in range(a.shape[1]):
        p, dp = a[0, c] - line[0, c], a[1, c] - line[1, c]
        q, dq = a[0, c] + line[0, c] - 2 * g[0, c], a[1, c] + line[1, c] - 2 * g[1, c]
        value += (p + dp * x) * (q + dq * x)
        slope += dp * (q + dq * x) + dq * (p + dp * x)
    return value, slope


@jit
def _sum_bounds(
    row: NDArray[np.float64],
    breaks: NDArray[np.float64],
    lines: NDArray[np.float64],
    cuts: NDArray[np.int64],
    low: int,
    step: float,
    line: NDArray[np.float64],
    g: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Sum over even steps, and least and greatest sum over the samples, of <f - l, f + l - 2 g>; with g = l it is |f - l|^2."""
    d = lines.shape[2]
    span, jitter, each = row[LAST] - row[FIRST], row[JITTER], row[WEIGHT] / row[COUNT]
    if not are_times_exact(row[FIRST], step, span):
        jitter += 4 * 2.3e-16 * (span + abs(row[FIRST]))
    total, error, least, most = 0.0, 0.0, np.inf, -np.inf
    several = np.floor(2 * jitter / step) + 1.0
    for j in range(len(cuts) - 1):
        piece = lines[low + j]
        m = float(cuts[j + 1] - cuts[j])
        x = step * (cuts[j] + cuts[j + 1] - 1) / 2
        curve = 0.0
        for c in range(d):
            curve += (piece[1, c] - line[1, c]) * (piece[1, c] + line[1, c] - 2 * g[1, c])
        total += m * _product_at(piece, line, g, x)[0] + curve * step * step * m * (m * m - 1) / 12
        a = max(breaks[low + j - 1] - row[FIRST], 0.0) if j > 0 else 0.0
        b = min(breaks[low + j] - row[FIRST], span) if j < len(cuts) - 2 else span
        (at_a, slope_a), (at_b, slope_b) = (
            _product_at(piece, line, g, a),
            _product_at(piece, line, g, b),
        )
        bottom = (
            at_a - slope_a * slope_a / (4 * curve) if slope_a * slope_b < 0 and curve != 0 else at_a
        )
        low_end, high_end = min(at_a, at_b, bottom), max(at_a, at_b, bottom)
        least, most = min(least, low_end), max(most, high_end)
        steepest = max(abs(slope_a), abs(slope_b))
        change = abs(at_a - bottom) + abs(at_b - bottom)
        error += min(several * change, steepest * 2 * jitter * ((b - a + 2 * jitter) / step + 2))
        if j > 0:
            near = _first_step_at(row, step, breaks[low + j - 1] + jitter) - _first_step_at(
                row, step, breaks[low + j - 1] - jitter
            )
            jump = abs(at_a - _product_at(lines[low + j - 1], line, g, a)[0])
            error += jump * near if jitter > 0 and near > 0 else 0.0
    whole = row[WEIGHT]
    even = each * total
    if not np.isfinite(jitter):
        return min(max(even, whole * least), whole * most), whole * least, whole * most
    return even, max(even - each * error, whole * least), min(even + each * error, whole * most)
