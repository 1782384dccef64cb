"""Best lines of parts and of groups of parts in normalised time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums, segment_moments

__all__ = ["FittedLines", "best_lines", "excess_costs", "pooled_lines"]

#: Share of the second moment below which time has no spread to fit a slope to.
_SINGULAR = 1e-14

#: ``(normal, starts, slopes)``: W, U1, U2 of each group, shape (g, 3), and f(u) = start + u slope, shapes (g, d), in ticks.
FittedLines = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def best_lines(sums: PrefixSums, boundaries: NDArray[np.int64]) -> FittedLines:
    """Best line of each part."""
    parts = len(boundaries) - 1
    return pooled_lines(sums, boundaries, np.arange(parts, dtype=np.int32), parts)


def pooled_lines(
    sums: PrefixSums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], groups: int
) -> FittedLines:
    """Best line of each group of parts, by least squares over all their samples; an empty group has weight 0."""
    rows, d = segment_moments(sums, boundaries), sums.p.shape[1]
    origins = _origins(sums, boundaries, labels, groups)
    offset = sums.p[boundaries[:-1]] - origins[labels]
    rows[:, 4 : 4 + d] += rows[:, :1] * offset
    rows[:, 4 + d :] += rows[:, 1:2] * offset
    pooled = np.zeros((groups, rows.shape[1]))
    np.add.at(pooled, labels, rows)
    return _solve_lines(pooled, origins)


def _origins(
    sums: PrefixSums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], groups: int
) -> NDArray[np.float64]:
    """First sample of each group's first part: near its samples, so that little cancels."""
    origins = np.zeros((groups, sums.p.shape[1]))
    origins[labels[::-1]] = sums.p[boundaries[:-1]][::-1]
    return origins


def _solve_lines(pooled: NDArray[np.float64], origins: NDArray[np.float64]) -> FittedLines:
    d = origins.shape[1]
    weight = np.where(pooled[:, 0] > 0, pooled[:, 0], 1.0)[:, None]
    mean_time, mean_place = pooled[:, 1:2] / weight, pooled[:, 4 : 4 + d] / weight
    spread = pooled[:, 2:3] - mean_time * pooled[:, 1:2]
    cross = pooled[:, 4 + d :] - mean_time * pooled[:, 4 : 4 + d]
    sloped = spread > _SINGULAR * pooled[:, 2:3]
    slopes = np.where(sloped, cross / np.where(sloped, spread, 1.0), 0.0)
    return pooled[:, :3].copy(), origins + mean_place - mean_time * slopes, slopes


def excess_costs(
    lines: FittedLines, starts: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cost of each group against each line above the cost against its own: e' H e, shape (g, lines)."""
    normal, own_starts, own_slopes = lines
    total = np.zeros((len(normal), len(starts)))
    for axis in range(starts.shape[1]):
        a = own_starts[:, axis, None] - starts[None, :, axis]
        v = own_slopes[:, axis, None] - slopes[None, :, axis]
        total += normal[:, :1] * a * a + 2 * normal[:, 1:2] * a * v + normal[:, 2:] * v * v
    return np.maximum(total, 0.0)
