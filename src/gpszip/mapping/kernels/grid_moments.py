"""Moments of the samples between two slots of a time grid, from integer prefix sums (exact under wrap-around).

Row s of the sums holds, over all samples before slot s, each times its weight: count, T, TT, then X_i, then TX_i for each
axis, then XX, with times and positions as integer ticks. Differences are re-centred on integers before anything becomes a float.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = [
    "best_line_cost",
    "line_cost",
    "moments_between",
    "prefix_sums",
    "segment_costs",
    "segment_moments",
]


@jit
def prefix_sums(
    times: NDArray[np.int64],
    positions: NDArray[np.int64],
    weights: NDArray[np.int64],
    ends: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Weighted sums over the samples before each of ``ends`` (indices of samples, not decreasing), shape (len(ends), 2d + 4)."""
    dimension = positions.shape[1]
    sums = np.zeros((len(ends), 2 * dimension + 4), np.int64)
    running = np.zeros(2 * dimension + 4, np.int64)
    i = 0
    for slot in range(len(ends)):
        while i < ends[slot]:
            t, w = times[i], weights[i]
            running[0] += w
            running[1] += w * t
            running[2] += w * t * t
            for axis in range(dimension):
                x = positions[i, axis]
                running[3 + axis] += w * x
                running[3 + dimension + axis] += w * t * x
                running[3 + 2 * dimension] += w * x * x
            i += 1
        sums[slot] = running
    return sums


@jit
def moments_between(
    sums: NDArray[np.int64],
    a: int,
    b: int,
    start: int,
    end: int,
    center: NDArray[np.int64],
    ticks_per_step: float,
    first: NDArray[np.float64],
    cross: NDArray[np.float64],
) -> tuple[float, float, float, float]:
    """Moments (W, U1, U2, Q) of the samples of slots [a, b), in time normalised over [start, end] ticks.

    ``first`` and ``cross`` receive M and N for each axis, relative to ``center`` ticks; lengths come out in units of
    ``place_unit`` ticks.
    """
    dimension = len(center)
    count = sums[b, 0] - sums[a, 0]
    t1 = sums[b, 1] - sums[a, 1] - start * count
    t2 = sums[b, 2] - sums[a, 2] - 2 * start * (sums[b, 1] - sums[a, 1]) + start * start * count
    span = np.float64(end - start)
    square = sums[b, 3 + 2 * dimension] - sums[a, 3 + 2 * dimension]
    for axis in range(dimension):
        c = center[axis]
        dx = sums[b, 3 + axis] - sums[a, 3 + axis]
        dtx = sums[b, 3 + dimension + axis] - sums[a, 3 + dimension + axis]
        m = dx - c * count
        first[axis] = np.float64(m) / ticks_per_step
        cross[axis] = np.float64(dtx - start * dx - c * t1) / (ticks_per_step * span)
        square += c * c * count - 2 * c * dx
    return (
        np.float64(count),
        np.float64(t1) / span,
        np.float64(t2) / (span * span),
        np.float64(square) / (ticks_per_step * ticks_per_step),
    )


@jit
def best_line_cost(
    w: float, u1: float, u2: float, q: float, first: NDArray[np.float64], cross: NDArray[np.float64]
) -> float:
    """Squared error of the best line for these moments."""
    if w < 1.5:
        return 0.0
    spread = u2 - u1 * u1 / w
    cost = q
    for axis in range(len(first)):
        cost -= first[axis] * first[axis] / w
        if spread > 1e-12 * w:
            lean = cross[axis] - u1 * first[axis] / w
            cost -= lean * lean / spread
    return max(cost, 0.0)


@jit
def line_cost(
    w: float,
    u1: float,
    u2: float,
    q: float,
    first: NDArray[np.float64],
    cross: NDArray[np.float64],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    center: NDArray[np.float64],
) -> float:
    """Squared error of the line from ``start`` to ``end``."""
    cost = q
    for axis in range(len(first)):
        a = start[axis] - center[axis]
        d = end[axis] - start[axis]
        cost += (
            w * a * a + 2.0 * u1 * a * d + u2 * d * d - 2.0 * (a * first[axis] + d * cross[axis])
        )
    return max(cost, 0.0)


@jit
def segment_moments(
    sums: NDArray[np.int64],
    froms: NDArray[np.int64],
    tos: NDArray[np.int64],
    ticks: NDArray[np.int64],
    centers: NDArray[np.int64],
    ticks_per_step: float,
) -> NDArray[np.float64]:
    """Rows (W, U1, U2, Q, M..., N...) for the parts from slot ``froms`` to ``tos``, relative to the centre of their first slot."""
    dimension = centers.shape[1]
    out = np.empty((len(froms), 4 + 2 * dimension))
    for j in range(len(froms)):
        a, b = froms[j], tos[j]
        w, u1, u2, q = moments_between(
            sums,
            a,
            b,
            ticks[a],
            ticks[b],
            centers[a],
            ticks_per_step,
            out[j, 4 : 4 + dimension],
            out[j, 4 + dimension :],
        )
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = w, u1, u2, q
    return out


@jit
def segment_costs(
    moments: NDArray[np.float64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    centers: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Squared error of each part on its line."""
    dimension = starts.shape[1]
    out = np.empty(len(moments))
    for j in range(len(moments)):
        row = moments[j]
        out[j] = line_cost(
            row[0],
            row[1],
            row[2],
            row[3],
            row[4 : 4 + dimension],
            row[4 + dimension :],
            starts[j],
            ends[j],
            centers[j],
        )
    return out
