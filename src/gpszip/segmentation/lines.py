"""Best lines of intervals and of groups of intervals, in normalised time.

The normalised time u of an interval runs from 0 at its first sample to 1 at its last one. A row
of moments has the columns ``[W, U1, U2, Q, M_1..M_d, N_1..N_d]`` of :mod:`gpszip.kernels.sums`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums, segment_moments

__all__ = ["FittedLines", "best_lines", "excess_costs", "pooled_lines"]

#: A spread of time below this share of its second moment is rounding: the slope is 0.
_SINGULAR = 1e-14


class FittedLines(NamedTuple):
    """Lines ``f(u) = start + u slope``, each with the normal matrix of its fit.

    Parameters
    ----------
    normal : float64 array, shape (g, 3)
        W, U1 and U2 of each group: the sums of w, w u and w u^2.
    starts, slopes : float64 array, shape (g, d)
        In position ticks.
    """

    normal: NDArray[np.float64]
    starts: NDArray[np.float64]
    slopes: NDArray[np.float64]


def best_lines(sums: PrefixSums, boundaries: NDArray[np.int64]) -> FittedLines:
    """Fit a line to each interval."""
    k = len(boundaries) - 1
    return pooled_lines(sums, boundaries, np.arange(k, dtype=np.int32), k)


def pooled_lines(
    sums: PrefixSums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], groups: int
) -> FittedLines:
    """Fit a line to each group of intervals, by least squares over all their samples.

    An empty group has weight 0.
    """
    rows, d = segment_moments(sums, boundaries), sums.p.shape[1]

    # Moments about the origin of each interval's group: M + W o and N + U1 o.
    origins = _group_origins(sums, boundaries, labels, groups)
    offset = sums.p[boundaries[:-1]] - origins[labels]
    rows[:, 4 : 4 + d] += rows[:, :1] * offset
    rows[:, 4 + d :] += rows[:, 1:2] * offset

    pooled = np.zeros((groups, rows.shape[1]))
    np.add.at(pooled, labels, rows)
    return _solve_lines(pooled, origins)


def _group_origins(
    sums: PrefixSums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], groups: int
) -> NDArray[np.float64]:
    """Return the first sample of each group: it is near all others, so that little cancels."""
    origins = np.zeros((groups, sums.p.shape[1]))
    # The last assignment to a label counts, hence the reversed order.
    origins[labels[::-1]] = sums.p[boundaries[:-1]][::-1]
    return origins


def _solve_lines(pooled: NDArray[np.float64], origins: NDArray[np.float64]) -> FittedLines:
    """Solve the normal equations of each group, centred on the mean time."""
    d = origins.shape[1]
    weight = np.where(pooled[:, 0] > 0, pooled[:, 0], 1.0)[:, None]
    mean_time, mean_position = pooled[:, 1:2] / weight, pooled[:, 4 : 4 + d] / weight

    # Slope = cov(u, p) / var(u).
    spread = pooled[:, 2:3] - mean_time * pooled[:, 1:2]
    covariance = pooled[:, 4 + d :] - mean_time * pooled[:, 4 : 4 + d]
    has_slope = spread > _SINGULAR * pooled[:, 2:3]
    slopes = np.where(has_slope, covariance / np.where(has_slope, spread, 1.0), 0.0)
    return FittedLines(pooled[:, :3].copy(), origins + mean_position - mean_time * slopes, slopes)


def excess_costs(
    lines: FittedLines, starts: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the cost of each group against each of l lines, less its cost against its best line.

    With the difference e = (a, v) of start and slope it is ``e' H e = W a^2 + 2 U1 a v + U2 v^2``,
    summed over the axes; shape (g, l).
    """
    normal = lines.normal
    costs = np.zeros((len(normal), len(starts)))
    for axis in range(starts.shape[1]):
        a = lines.starts[:, axis, None] - starts[None, :, axis]
        v = lines.slopes[:, axis, None] - slopes[None, :, axis]
        costs += normal[:, :1] * a * a + 2 * normal[:, 1:2] * a * v + normal[:, 2:] * v * v
    # Rounding may leave a little less than nothing.
    return np.maximum(costs, 0.0)
