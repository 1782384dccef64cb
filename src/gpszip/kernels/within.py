"""The E-step under a maximum: only parts along which no sample is too far away are considered.

From a candidate at one slot, each later sample allows a cone of velocities. The cones' intersection, kept as an interval along each
of a few directions, tells at once which candidates of later slots may be reached, and when none will be any more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["Limits", "directions", "relax_within"]

#: Directions across half a turn in the plane.
_FAN = 16


class Limits(NamedTuple):
    """The samples, and how far they may be from the walk; no limit where ``reach`` is 0."""

    ends: NDArray[np.int64]  # samples before each slot
    times: NDArray[np.float64]  # cells
    spots: NDArray[np.float64]  # quanta
    cells: NDArray[np.float64]  # time of each slot
    directions: NDArray[np.float64]
    reach: NDArray[np.float64]


def directions(dimension: int) -> tuple[NDArray[np.float64], float]:
    """Directions whose strips enclose a ball, and the share of a radius at which their corners stay within it."""
    if dimension == 2:
        angle = np.arange(_FAN) * (np.pi / _FAN)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1), float(np.cos(np.pi / (2 * _FAN)))
    return np.eye(dimension), dimension**-0.5


@jit
def _narrow(
    limits: Limits, first: int, last: int, start: float, along: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> bool:
    """Intersect the velocities with the cones of the samples first to last; tell whether any are left."""
    reach = limits.reach[0]
    dimension = limits.spots.shape[1]
    for i in range(first, last):
        span = limits.times[i] - start
        for m in range(len(along)):
            offset = -along[m]
            for axis in range(dimension):
                offset += limits.directions[m, axis] * limits.spots[i, axis]
            if span < 1e-9:
                if abs(offset) > reach:
                    return False
            else:
                low[m] = max(low[m], (offset - reach) / span)
                high[m] = min(high[m], (offset + reach) / span)
                if low[m] > high[m]:
                    return False
    return True


@jit
def relax_within(
    limits: Limits,
    first: int,
    rows: int,
    widest: int,
    spot: NDArray[np.float64],
    local: NDArray[np.int64],
    candidates: NDArray[np.int64],
    counts: NDArray[np.int64],
    table: NDArray[np.float64],
    time_price: float,
    stay_price: float,
    best: NDArray[np.float64],
    parent_row: NDArray[np.int64],
    parent_choice: NDArray[np.int64],
) -> None:
    """Fill ``best`` (bits to reach each candidate of each row) and its parents along parts that keep the limits.

    Row r stands for slot ``first`` + r; ``spot`` holds the candidates' places in quanta, ``local`` their indices in ``table``, the
    bits of a step. A step costs ``time_price`` more, one that stays at its node ``stay_price`` in all.
    """
    fan, dimension = limits.directions.shape
    low, high, along = np.empty(fan), np.empty(fan), np.empty(fan)
    for origin in range(rows - 1):
        for o in range(counts[origin]):
            reached = best[origin, o]
            if reached == np.inf:
                continue
            for m in range(fan):
                low[m], high[m], along[m] = -np.inf, np.inf, 0.0
                for axis in range(dimension):
                    along[m] += limits.directions[m, axis] * spot[origin, o, axis]
            start = limits.cells[first + origin]
            for row in range(origin + 1, min(origin + widest, rows - 1) + 1):
                if not _narrow(limits, limits.ends[first + row - 1], limits.ends[first + row], start, along, low, high):
                    break
                span = limits.cells[first + row] - start
                for c in range(counts[row]):
                    if candidates[origin, o] == candidates[row, c] and candidates[row, c] >= 0:
                        cost = reached + stay_price
                    else:
                        cost = reached + time_price + table[local[origin, o], local[row, c]]
                    if cost >= best[row, c]:
                        continue
                    inside = True
                    for m in range(fan):
                        offset = -along[m]
                        for axis in range(dimension):
                            offset += limits.directions[m, axis] * spot[row, c, axis]
                        inside &= low[m] * span <= offset <= high[m] * span
                    if inside:
                        best[row, c] = cost
                        parent_row[row, c] = origin
                        parent_choice[row, c] = o
