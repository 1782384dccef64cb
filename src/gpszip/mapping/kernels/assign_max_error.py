"""The E-step under a maximum error: only segments on which no sample is too far away.

From a candidate at one slot, each later sample allows a cone of velocities. The intersection of
the cones, kept as an interval along each of a few directions, tells at once which candidates of
later slots are within reach, and when none will be any more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted
from gpszip.mapping.kernels.grid_moments import best_line_cost, line_cost, moments_between
from gpszip.mapping.kernels.time_grid import DPTable, TimeGridArrays

__all__ = ["build_directions", "fill_table_within_max_error"]

#: Directions across half a turn in the plane.
_DIRECTIONS = 16

#: Bits of squared error beyond which no segment pays: knots in between cost less.
_MAX_LINE_BITS = 45.0

#: Time steps below which a sample counts as so much after the knot.
_MIN_SPAN = 1e-9


def build_directions(dimension: int, count: int = _DIRECTIONS) -> tuple[NDArray[np.float64], float]:
    """Directions whose strips enclose a ball.

    Parameters
    ----------
    dimension : int
        Dimension d.
    count : int, default 16
        Number of directions in the plane; in other dimensions, they are the axes.

    Returns
    -------
    directions : float64 array, shape (m, d)
        Unit vectors.
    share : float
        Share of a radius at which the corners of the strips' intersection are within the ball.
    """
    if dimension == 2:
        angle = np.arange(count) * (np.pi / count)
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return directions, float(np.cos(np.pi / (2 * count)))
    return np.eye(dimension), dimension**-0.5


@inner
def _project_samples(
    positions: NDArray[np.float64], directions: NDArray[np.float64], first: int, last: int
) -> NDArray[np.float64]:
    """Offsets of the samples ``first`` to ``last`` - 1 along each direction, a row for each."""
    offsets = np.zeros((last - first, len(directions)))
    for i in range(last - first):
        for axis in range(positions.shape[1]):
            for m in range(len(directions)):
                offsets[i, m] += directions[m, axis] * positions[first + i, axis]
    return offsets


@inner_uncounted
def _intersect_velocities(
    times: NDArray[np.float64],
    offsets: NDArray[np.float64],
    reach: float,
    first: int,
    last: int,
    before: int,
    start: float,
    along: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> bool:
    """Intersect the allowed velocities with the cones of the samples ``first`` to ``last`` - 1.

    The cone of a sample at time t and offset y along a direction, from a knot at time ``start``
    and offset ``along``, is [(y - along - r) / (t - start), (y - along + r) / (t - start)] for the
    largest distance r. Row 0 of ``offsets`` is that of sample ``before``.

    Returns
    -------
    bool
        Whether any velocities remain.
    """
    # Narrow the ranges of all directions at once: the processor handles several in one step. At
    # the knot's own time no velocity makes up for an offset: nearly all are ruled out.
    for i in range(first, last):
        rate = 1.0 / max(times[i] - start, _MIN_SPAN)
        row = i - before
        for m in range(len(along)):
            offset = offsets[row, m] - along[m]
            least, most = (offset - reach) * rate, (offset + reach) * rate
            low[m] = least if least > low[m] else low[m]
            high[m] = most if most < high[m] else high[m]

    # Velocities remain where no range is empty.
    is_empty = False
    for m in range(len(along)):
        is_empty |= low[m] > high[m]
    return not is_empty


@inner_uncounted
def _is_reachable(
    directions: NDArray[np.float64],
    position: NDArray[np.float64],
    span: float,
    along: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> bool:
    """Whether an allowed velocity leads to a position in ``span`` time steps."""
    for m in range(len(along)):
        offset = -along[m]
        for axis in range(len(position)):
            offset += directions[m, axis] * position[axis]
        if offset < low[m] * span or offset > high[m] * span:
            return False
    return True


@inner_uncounted
def _open_cone(
    directions: NDArray[np.float64],
    position: NDArray[np.float64],
    along: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> None:
    """Allow all velocities from a knot, and note its offset along each direction."""
    for m in range(len(directions)):
        low[m], high[m], along[m] = -np.inf, np.inf, 0.0
        for axis in range(len(position)):
            along[m] += directions[m, axis] * position[axis]


@inner
def fill_table_within_max_error(
    grid_arrays: TimeGridArrays,
    dp_table: DPTable,
    first: int,
    max_slots: int,
    move_price: float,
    stay_price: float,
    error_price: float = 0.0,
    beam: float = np.inf,
) -> None:
    """Fill a table from its first row on, along segments within ``grid_arrays.max_distance``.

    Row r stands for slot ``first`` + r; a segment spans at most ``max_slots`` slots. Recurrence,
    with B[r, c] the least bits to reach candidate c of row r:

        B[r, c] = min over o < r and k of  B[o, k] + step bits + error_price * E(o, k, r, c)

    A step costs ``stay_price`` if it stays at its node, else ``move_price`` and the bits in the
    table. E is the squared error of the segment's samples. The minimum is over those (o, k) from
    which an allowed velocity leads to (r, c), and that cost at most ``beam`` bits more than the
    cheapest candidate of their slot.
    """
    candidates, counts = dp_table.candidates, dp_table.counts
    positions, numbers = dp_table.positions, dp_table.numbers
    step_bits, arrivals, best = dp_table.step_bits, dp_table.arrivals, dp_table.bits
    parent_rows, parent_choices = dp_table.parent_rows, dp_table.parent_choices
    times, ends, time_steps = grid_arrays.times, grid_arrays.ends, grid_arrays.time_steps
    directions = grid_arrays.directions
    fan, dimension = directions.shape
    rows = len(counts)
    low, high, along = np.empty(fan), np.empty(fan), np.empty(fan)
    m, n, center = np.empty(dimension), np.empty(dimension), np.empty(dimension)
    w = u1 = u2 = q = 0.0

    # Every cone needs the offsets of samples: all are computed once.
    before = ends[first]
    offsets = _project_samples(
        grid_arrays.sample_positions, directions, before, ends[first + rows - 1]
    )

    # Open a cone of velocities at each candidate that a path reaches.
    for origin in range(rows - 1):
        a = first + origin
        limit = np.inf
        for o in range(counts[origin]):
            limit = min(limit, best[origin, o] + beam)
        for o in range(counts[origin]):
            reached = best[origin, o]
            if reached == np.inf or reached > limit:
                continue
            _open_cone(directions, positions[origin, o], along, low, high)
            start = time_steps[a]
            if error_price > 0.0:
                for axis in range(len(center)):
                    center[axis] = grid_arrays.centers[a, axis] / grid_arrays.ticks_per_step

            # Follow the cone from slot to slot, as far as a segment may span.
            for row in range(origin + 1, min(origin + max_slots, rows - 1) + 1):
                # Narrow the cone by the samples before this slot; an empty one stays empty.
                if not _intersect_velocities(
                    times,
                    offsets,
                    grid_arrays.max_distance,
                    ends[first + row - 1],
                    ends[first + row],
                    before,
                    start,
                    along,
                    low,
                    high,
                ):
                    break
                b = first + row
                span = time_steps[b] - start

                # The best line bounds the error of each segment between the two slots, and the
                # arrival bits bound its step.
                if error_price > 0.0:
                    w, u1, u2, q = moments_between(
                        grid_arrays.sums,
                        a,
                        b,
                        grid_arrays.ticks[a],
                        grid_arrays.ticks[b],
                        grid_arrays.centers[a],
                        grid_arrays.ticks_per_step,
                        m,
                        n,
                    )
                    line_bits = error_price * best_line_cost(w, u1, u2, q, m, n)
                    if line_bits > _MAX_LINE_BITS:
                        break
                    gain = -np.inf
                    for c in range(counts[row]):
                        gain = max(gain, best[row, c] - arrivals[row, c])
                    if reached + line_bits >= gain:
                        continue

                # Relax the candidates of this slot that the cone reaches.
                for c in range(counts[row]):
                    if candidates[origin, o] == candidates[row, c] and candidates[row, c] >= 0:
                        cost = reached + stay_price
                    else:
                        cost = reached + move_price + step_bits[numbers[origin, o], numbers[row, c]]
                    if error_price > 0.0 and cost < best[row, c]:
                        cost += error_price * line_cost(
                            w, u1, u2, q, m, n, positions[origin, o], positions[row, c], center
                        )
                    if cost < best[row, c] and _is_reachable(
                        directions, positions[row, c], span, along, low, high
                    ):
                        best[row, c] = cost
                        parent_rows[row, c] = origin
                        parent_choices[row, c] = o
