"""The E-step under a maximum: only parts along which no sample is too far away are considered.

From a candidate at one slot, each later sample allows a cone of velocities. The cones' intersection, kept as an interval along each
of a few directions, tells at once which candidates of later slots may be reached, and when none will be any more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.mapping.kernels.grid_moments import best_line_cost, line_cost, moments_between
from gpszip.mapping.kernels.time_grid import DPTable, TimeGridArrays

__all__ = ["build_directions", "fill_table_within_max_error"]

#: Directions across half a turn in the plane.
_DIRECTIONS = 16

#: Bits beyond which the squared error of a part is more than knots in between would cost.
_MAX_LINE_BITS = 45.0


def build_directions(dimension: int) -> tuple[NDArray[np.float64], float]:
    """Directions whose strips enclose a ball, and the share of a radius at which their corners stay within it."""
    if dimension == 2:
        angle = np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1), float(
            np.cos(np.pi / (2 * _DIRECTIONS))
        )
    return np.eye(dimension), dimension**-0.5


@jit
def _intersect_velocities(
    grid_arrays: TimeGridArrays,
    first: int,
    last: int,
    start: float,
    along: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> bool:
    """Intersect the velocities with the cones of the samples first to last; tell whether any are left."""
    reach = grid_arrays.reach[0]
    dimension = grid_arrays.sample_positions.shape[1]
    for i in range(first, last):
        span = grid_arrays.times[i] - start
        for m in range(len(along)):
            offset = -along[m]
            for axis in range(dimension):
                offset += grid_arrays.directions[m, axis] * grid_arrays.sample_positions[i, axis]
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
def _is_reachable(
    grid_arrays: TimeGridArrays,
    spot: NDArray[np.float64],
    span: float,
    along: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> bool:
    """Whether a place is reached after ``span`` at a velocity that is left."""
    for m in range(len(along)):
        offset = -along[m]
        for axis in range(len(spot)):
            offset += grid_arrays.directions[m, axis] * spot[axis]
        if offset < low[m] * span or offset > high[m] * span:
            return False
    return True


@jit
def fill_table_within_max_error(
    grid_arrays: TimeGridArrays,
    dp_table: DPTable,
    first: int,
    max_slots: int,
    time_price: float,
    stay_price: float,
    error_price: float = 0.0,
) -> None:
    """Fill the board from its first row on, along parts no sample of which is out of the ground's reach.

    Row r stands for slot ``first`` + r; a part spans at most ``widest`` of them and costs its step and ``time_price``, or
    ``stay_price`` if it stays at its node, and its squared error at ``error_price``.
    """
    candidates, counts, spot, local, table, best, parent_row, parent_choice = dp_table
    fan, dimension = grid_arrays.directions.shape
    rows = len(counts)
    low, high, along = np.empty(fan), np.empty(fan), np.empty(fan)
    m, n, center = np.empty(dimension), np.empty(dimension), np.empty(dimension)
    w = u1 = u2 = q = 0.0
    for origin in range(rows - 1):
        for o in range(counts[origin]):
            reached = best[origin, o]
            if reached == np.inf:
                continue
            for ray in range(fan):
                low[ray], high[ray], along[ray] = -np.inf, np.inf, 0.0
                for axis in range(dimension):
                    along[ray] += grid_arrays.directions[ray, axis] * spot[origin, o, axis]
            a = first + origin
            start = grid_arrays.time_steps[a]
            if error_price > 0.0:
                center[:] = grid_arrays.centers[a] / grid_arrays.ticks_per_step[0]
            for row in range(origin + 1, min(origin + max_slots, rows - 1) + 1):
                if not _intersect_velocities(
                    grid_arrays,
                    grid_arrays.ends[first + row - 1],
                    grid_arrays.ends[first + row],
                    start,
                    along,
                    low,
                    high,
                ):
                    break
                b = first + row
                span = grid_arrays.time_steps[b] - start
                if error_price > 0.0:
                    w, u1, u2, q = moments_between(
                        grid_arrays.sums, a, b, grid_arrays.ticks[a], grid_arrays.ticks[b], grid_arrays.centers[a], grid_arrays.ticks_per_step[0], m, n
                    )  # fmt: skip
                    least = error_price * best_line_cost(w, u1, u2, q, m, n)
                    if least > _MAX_LINE_BITS:
                        break
                    if reached + least >= np.max(best[row, : counts[row]]):
                        continue
                for c in range(counts[row]):
                    if candidates[origin, o] == candidates[row, c] and candidates[row, c] >= 0:
                        cost = reached + stay_price
                    else:
                        cost = reached + time_price + table[local[origin, o], local[row, c]]
                    if error_price > 0.0 and cost < best[row, c]:
                        cost += error_price * line_cost(
                            w, u1, u2, q, m, n, spot[origin, o], spot[row, c], center
                        )
                    if cost < best[row, c] and _is_reachable(
                        grid_arrays, spot[row, c], span, along, low, high
                    ):
                        best[row, c] = cost
                        parent_row[row, c] = origin
                        parent_choice[row, c] = o
