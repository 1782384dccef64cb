"""Moments of the samples between two slots of a time grid, from prefix sums of whole numbers.

Row s of the sums holds weighted sums over all samples before slot s: count, T, TT, then X_i and
TX_i for each axis, then XX. Times and positions are whole ticks, so that sums are exact even where
64 bits wrap around. Differences are re-centred as whole numbers before they become floats.

The moments of a segment between the slots a and b are sums over its samples with weights w,
positions x relative to a centre, and times s normalised to [0, 1]:

    W = sum w,  U1 = sum w s,  U2 = sum w s^2,  Q = sum w |x|^2,  M = sum w x,  N = sum w s x
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.copying import copy_values
from gpszip.kernels.jit import inner_uncounted, jit

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
    """Weighted sums over the samples before each of ``ends``.

    Parameters
    ----------
    times : int64 array, shape (n,)
        Ticks of the samples.
    positions : int64 array, shape (n, d)
        Positions of the samples, in ticks.
    weights : int64 array, shape (n,)
        Weights of the samples.
    ends : int64 array, shape (S,)
        Sample counts, not decreasing.

    Returns
    -------
    int64 array, shape (S, 2d + 4)
        Rows of count, T, TT, X..., TX..., XX.
    """
    # Keep running sums, so that the difference of two rows sums the samples between their slots.
    dimension = positions.shape[1]
    sums = np.zeros((len(ends), 2 * dimension + 4), np.int64)
    running = np.zeros(2 * dimension + 4, np.int64)
    i = 0
    for slot in range(len(ends)):
        # Add the samples since the slot before.
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
        copy_values(running, sums[slot])
    return sums


@inner_uncounted
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
    """Moments (W, U1, U2, Q) of the samples of slots [a, b); M and N go to two arrays.

    Parameters
    ----------
    sums : int64 array, shape (S, 2d + 4)
        Prefix sums.
    a, b : int
        First slot, and the slot after the last.
    start, end : int
        Ticks at which the normalised time is 0 and 1.
    center : int64 array, shape (d,)
        Position in ticks that positions are relative to.
    ticks_per_step : float
        Ticks of a grid step; the moments come in grid steps.
    first, cross : float64 arrays, shape (d,)
        Receive M and N.
    """
    # Normalised time runs from 0 to 1 over ``span`` ticks.
    dimension = len(center)
    span = np.float64(end - start)

    # Moments of time about ``start``: t1 = sum w (t - start), t2 = sum w (t - start)^2.
    count = sums[b, 0] - sums[a, 0]
    t1 = sums[b, 1] - sums[a, 1] - start * count
    t2 = sums[b, 2] - sums[a, 2] - 2 * start * (sums[b, 1] - sums[a, 1]) + start * start * count

    # Moments of position about ``center``, alone and with time.
    square = sums[b, 3 + 2 * dimension] - sums[a, 3 + 2 * dimension]
    for axis in range(dimension):
        c = center[axis]
        dx = sums[b, 3 + axis] - sums[a, 3 + axis]
        dtx = sums[b, 3 + dimension + axis] - sums[a, 3 + dimension + axis]
        m = dx - c * count
        first[axis] = np.float64(m) / ticks_per_step
        cross[axis] = np.float64(dtx - start * dx - c * t1) / (ticks_per_step * span)
        square += c * c * count - 2 * c * dx

    # Scale to normalised time and grid steps only here: sums of whole ticks are exact.
    return (
        np.float64(count),
        np.float64(t1) / span,
        np.float64(t2) / (span * span),
        np.float64(square) / (ticks_per_step * ticks_per_step),
    )


@inner_uncounted
def best_line_cost(
    w: float, u1: float, u2: float, q: float, first: NDArray[np.float64], cross: NDArray[np.float64]
) -> float:
    """Squared error of the least-squares line: Q - |M|^2 / W - |N - U1 M / W|^2 / (U2 - U1^2 / W).

    No segment between these slots has a smaller error.
    """
    # A line meets a single sample.
    cost = 0.0
    if w >= 1.5:
        spread = u2 - u1 * u1 / w
        cost = q
        for axis in range(len(first)):
            cost -= first[axis] * first[axis] / w
            # Samples at one time have no slope to fit.
            if spread > 1e-12 * w:
                slope = cross[axis] - u1 * first[axis] / w
                cost -= slope * slope / spread
    return max(cost, 0.0)


@inner_uncounted
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
    """Squared error of the line from ``start`` to ``end``, in grid steps.

    With a = start - center and d = end - start, it is
    Q + W |a|^2 + 2 U1 a.d + U2 |d|^2 - 2 (a.M + d.N).
    """
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
    first_slots: NDArray[np.int64],
    last_slots: NDArray[np.int64],
    ticks: NDArray[np.int64],
    centers: NDArray[np.int64],
    ticks_per_step: float,
) -> NDArray[np.float64]:
    """Rows (W, U1, U2, Q, M..., N...) of segments, each about the centre of its first slot."""
    # Sum over the samples from each segment's first slot to before its last one.
    dimension = centers.shape[1]
    moments = np.empty((len(first_slots), 4 + 2 * dimension))
    for j in range(len(first_slots)):
        a, b = first_slots[j], last_slots[j]
        w, u1, u2, q = moments_between(
            sums,
            a,
            b,
            ticks[a],
            ticks[b],
            centers[a],
            ticks_per_step,
            moments[j, 4 : 4 + dimension],
            moments[j, 4 + dimension :],
        )
        moments[j, 0], moments[j, 1], moments[j, 2], moments[j, 3] = w, u1, u2, q
    return moments


@jit
def segment_costs(
    moments: NDArray[np.float64],
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    centers: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Squared error of each segment on its line from ``starts`` to ``ends``."""
    # Evaluate the moments on each segment's line, in squared grid steps.
    dimension = starts.shape[1]
    costs = np.empty(len(moments))
    for j in range(len(moments)):
        row = moments[j]
        costs[j] = line_cost(
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
    return costs
