"""Segments filed in the cells of a grid, and the nearest of them to a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["Grid", "count_cells", "fill_cells", "nearest_segments"]


class Grid(NamedTuple):
    """Segments by cell: ``members[offsets[c]:offsets[c + 1]]`` cross the cell whose key is ``keys[c]``.

    A cell's key is ``column * rows + row``; columns and rows are counted from ``origin``, over the first two axes.
    """

    origin: NDArray[np.float64]
    cell: float
    columns: int
    rows: int
    keys: NDArray[np.int64]
    offsets: NDArray[np.int64]
    members: NDArray[np.int32]


@jit
def _column(x: float, origin: float, cell: float, columns: int) -> int:
    return int(min(max(np.floor((x - origin) / cell), 0.0), columns - 1.0))


@jit
def _rows_within(
    start: NDArray[np.float64], end: NDArray[np.float64], column: int, origin: NDArray[np.float64], cell: float, rows: int
) -> tuple[int, int]:
    # The part of the segment over one column, a little widened: a cell too many does no harm, one too few would.
    low, high = 0.0, 1.0
    across = end[0] - start[0]
    if across != 0:
        one = (origin[0] + (column - 1e-6) * cell - start[0]) / across
        other = (origin[0] + (column + 1 + 1e-6) * cell - start[0]) / across
        low, high = min(max(min(one, other), 0.0), 1.0), min(max(one, other, 0.0), 1.0)
    one = start[1] + low * (end[1] - start[1])
    other = start[1] + high * (end[1] - start[1])
    margin = 1e-6 * cell
    return _column(min(one, other) - margin, origin[1], cell, rows), _column(max(one, other) + margin, origin[1], cell, rows)


@jit
def count_cells(
    starts: NDArray[np.float64], ends: NDArray[np.float64], origin: NDArray[np.float64], cell: float, columns: int, rows: int
) -> int:
    """Number of (segment, cell) pairs that :func:`fill_cells` will list."""
    count = 0
    for segment in range(len(starts)):
        first = _column(min(starts[segment, 0], ends[segment, 0]) - 1e-6 * cell, origin[0], cell, columns)
        last = _column(max(starts[segment, 0], ends[segment, 0]) + 1e-6 * cell, origin[0], cell, columns)
        for column in range(first, last + 1):
            bottom, top = _rows_within(starts[segment], ends[segment], column, origin, cell, rows)
            count += top - bottom + 1
    return count


@jit
def fill_cells(
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell: float,
    columns: int,
    rows: int,
    keys: NDArray[np.int64],
    members: NDArray[np.int32],
) -> None:
    """List the cells that each segment crosses."""
    place = 0
    for segment in range(len(starts)):
        first = _column(min(starts[segment, 0], ends[segment, 0]) - 1e-6 * cell, origin[0], cell, columns)
        last = _column(max(starts[segment, 0], ends[segment, 0]) + 1e-6 * cell, origin[0], cell, columns)
        for column in range(first, last + 1):
            bottom, top = _rows_within(starts[segment], ends[segment], column, origin, cell, rows)
            for row in range(bottom, top + 1):
                keys[place] = column * rows + row
                members[place] = segment
                place += 1


@jit
def _project(point: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[float, float]:
    """Fraction along the segment that is nearest to the point, and the squared distance there."""
    along = 0.0
    length = 0.0
    for axis in range(len(point)):
        along += (point[axis] - start[axis]) * (end[axis] - start[axis])
        length += (end[axis] - start[axis]) ** 2
    fraction = min(max(along / length, 0.0), 1.0) if length > 0 else 0.0
    square = 0.0
    for axis in range(len(point)):
        square += (start[axis] + fraction * (end[axis] - start[axis]) - point[axis]) ** 2
    return fraction, square


@jit
def _insert(
    segment: int,
    fraction: float,
    square: float,
    segments: NDArray[np.int32],
    fractions: NDArray[np.float64],
    squares: NDArray[np.float64],
) -> None:
    count = len(segments)
    place = count
    while place > 0 and (square < squares[place - 1] or (square == squares[place - 1] and segment < segments[place - 1])):
        place -= 1
    if place == count or (place > 0 and segments[place - 1] == segment):
        return
    for after in range(count - 1, place, -1):
        segments[after], fractions[after], squares[after] = segments[after - 1], fractions[after - 1], squares[after - 1]
    segments[place], fractions[place], squares[place] = segment, fraction, square


@jit
def nearest_segments(
    points: NDArray[np.float64],
    radius: float,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    grid: Grid,
    segments: NDArray[np.int32],
    fractions: NDArray[np.float64],
    squares: NDArray[np.float64],
) -> None:
    """Fill each row with the nearest segments within the radius, by squared distance, then index.

    Rows come with no segment as the largest index, at an infinite distance.
    """
    for point in range(len(points)):
        left = _column(points[point, 0] - radius, grid.origin[0], grid.cell, grid.columns)
        right = _column(points[point, 0] + radius, grid.origin[0], grid.cell, grid.columns)
        bottom = _column(points[point, 1] - radius, grid.origin[1], grid.cell, grid.rows)
        top = _column(points[point, 1] + radius, grid.origin[1], grid.cell, grid.rows)
        for column in range(left, right + 1):
            begin = np.searchsorted(grid.keys, column * grid.rows + bottom)
            end = np.searchsorted(grid.keys, column * grid.rows + top + 1)
            for member in grid.members[grid.offsets[begin] : grid.offsets[end]]:
                fraction, square = _project(points[point], starts[member], ends[member])
                if square <= radius * radius:
                    _insert(member, fraction, square, segments[point], fractions[point], squares[point])
