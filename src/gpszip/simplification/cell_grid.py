"""A sparse grid: only the square cells along given lines exist."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CellGrid",
    "build_cell_grid",
    "count_cells",
    "find_cells",
    "line_density",
    "smooth_density",
]

#: Columns and rows to the eight neighbours, counterclockwise from the east.
_NEIGHBOUR_OFFSETS = np.array(
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]]
)


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Square cells, sorted by column and row.

    Parameters
    ----------
    origin : float64 array, shape (2,)
        Lower left corner of column 0, row 0 in metres.
    size : float
        Side of a cell in metres.
    rows : int
        Rows in a column: cell (i, j) has the key ``i * rows + j``.
    keys : int64 array, shape (c,)
        Keys of the cells, increasing.
    neighbours : int32 array, shape (c, 8)
        Numbers of the neighbours, counterclockwise from the east; -1 for a missing one.
    centers : float64 array, shape (c, 2)
        Centers of the cells in metres.
    """

    origin: NDArray[np.float64]
    size: float
    rows: int
    keys: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    centers: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.keys)


def build_cell_grid(
    starts: NDArray[np.float64], ends: NDArray[np.float64], size: float, margin: int
) -> CellGrid:
    """Build the grid of all cells near some lines.

    Parameters
    ----------
    starts, ends : float64 arrays, shape (n, 2)
        Ends of straight lines in metres.
    size : float
        Side of a cell in metres.
    margin : int
        Largest distance from a line in cells.

    Examples
    --------
    >>> len(build_cell_grid(np.array([[1.0, 1.0]]), np.array([[9.0, 1.0]]), 2.0, 1))
    18
    """
    # List the keys of all cells, block by block.
    origin, rows = _place_grid(starts, ends, size, margin)
    first, after = _find_blocks(starts, ends, size, margin)
    counts = after - first
    keys = np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())

    # Index the eight neighbours of each cell, and place its center in metres.
    steps = _NEIGHBOUR_OFFSETS[:, 0] * rows + _NEIGHBOUR_OFFSETS[:, 1]
    neighbours = np.stack([_find_keys(keys, keys + step) for step in steps], axis=1)
    centers = origin + (np.stack(np.divmod(keys, rows), axis=1) + 0.5) * size
    return CellGrid(origin, size, rows, keys, neighbours, centers)


def count_cells(
    starts: NDArray[np.float64], ends: NDArray[np.float64], size: float, margin: int
) -> int:
    """Count the cells of :func:`build_cell_grid` for the same arguments, without building them.

    Examples
    --------
    >>> count_cells(np.array([[1.0, 1.0]]), np.array([[9.0, 1.0]]), 2.0, 1)
    18
    """
    first, after = _find_blocks(starts, ends, size, margin)
    return int((after - first).sum())


def find_cells(grid: CellGrid, points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Number of the cell that contains each point, shape (n,); -1 if the grid has no such cell."""
    return _find_keys(grid.keys, _cell_keys(points, grid.origin, grid.size, grid.rows))


def line_density(
    grid: CellGrid,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Weighted length of lines in each cell, shape (c,), in sides of a cell.

    Parameters
    ----------
    grid : CellGrid
        A grid that contains the lines.
    starts, ends : float64 arrays, shape (n, 2)
        Ends of straight lines in metres.
    weights : float64 array, shape (n,)
        Weight of each line.
    """
    line, counts, points = _sample_lines(starts, ends, grid.size)
    length = np.linalg.norm(ends - starts, axis=1)
    length_per_point = (weights * length / counts / grid.size)[line]
    return np.bincount(
        find_cells(grid, points), weights=length_per_point, minlength=len(grid)
    ).astype(np.float64)


def smooth_density(
    grid: CellGrid, density: NDArray[np.float64], deviation: float
) -> NDArray[np.float64]:
    """Smooth a density of lines by a Gaussian.

    The result is scaled so that it is 1 on a long straight line of weight 1.

    Parameters
    ----------
    grid : CellGrid
        The grid.
    density : float64 array, shape (c,)
        Density of lines, see :func:`line_density`.
    deviation : float
        Standard deviation of the Gaussian in metres.
    """
    from gpszip.simplification.kernels.density import blur

    # Each pass adds a variance of half a cell squared.
    passes = max(1, round(2 * (deviation / grid.size) ** 2))
    return blur(density, grid.neighbours, passes) * math.sqrt(math.pi * passes)


def _place_grid(
    starts: NDArray[np.float64], ends: NDArray[np.float64], size: float, margin: int
) -> tuple[NDArray[np.float64], int]:
    """Origin of the grid, and its rows: all columns and rows of the margin are non-negative."""
    corner = np.minimum(starts.min(axis=0), ends.min(axis=0))
    origin = (np.floor(corner / size) - margin - 1.5) * size
    top = max(starts[:, 1].max(), ends[:, 1].max())
    return origin, int((top - origin[1]) / size) + margin + 3


def _find_blocks(
    starts: NDArray[np.float64], ends: NDArray[np.float64], size: float, margin: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Blocks of consecutive cells of a column: the first key of each, and the one after its last.

    A block takes the place of some ``2 * margin + 1`` cells, so the margin is added block by block.
    The parameters are those of :func:`build_cell_grid`.
    """
    # The cells on the lines, and the margin above and below them.
    origin, rows = _place_grid(starts, ends, size, margin)
    _, _, points = _sample_lines(starts, ends, size)
    keys = _sort_unique(_cell_keys(points, origin, size, rows))
    first, after = _join_blocks(keys - margin, keys + margin + 1)

    # The margin on the left and right, column by column.
    for _ in range(margin):
        first = np.concatenate([first - rows, first, first + rows])
        after = np.concatenate([after - rows, after, after + rows])
        first, after = _join_blocks(first, after)
    return first, after


def _join_blocks(
    first: NDArray[np.int64], after: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Join blocks that touch or overlap.

    With firsts and ends each sorted, a block starts at ``first[i]`` if all blocks before it,
    which are i, have ended.
    """
    first, after = np.sort(first, kind="stable"), np.sort(after, kind="stable")
    is_apart = first[1:] > after[:-1]
    return first[np.append(True, is_apart)], after[np.append(is_apart, True)]


def _sample_lines(
    starts: NDArray[np.float64], ends: NDArray[np.float64], size: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Sample lines at points at most half a cell apart.

    Returns
    -------
    line : int64 array, shape (p,)
        Line of each point.
    counts : int64 array, shape (n,)
        Number of points on each line.
    points : float64 array, shape (p, 2)
        The points in metres.
    """
    counts = np.ceil(2 * np.linalg.norm(ends - starts, axis=1) / size).astype(np.int64) + 1
    line = np.repeat(np.arange(len(counts)), counts)
    position = np.arange(len(line)) - np.repeat(np.cumsum(counts) - counts, counts)
    fraction = ((position + 0.5) / counts[line])[:, None]
    return line, counts, starts[line] + (ends - starts)[line] * fraction


def _cell_keys(
    points: NDArray[np.float64], origin: NDArray[np.float64], size: float, rows: int
) -> NDArray[np.int64]:
    """Key of the cell that contains each point."""
    cells = np.floor((points - origin) / size).astype(np.int64)
    keys: NDArray[np.int64] = cells[:, 0] * rows + cells[:, 1]
    return keys


def _sort_unique(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sort keys and drop duplicates. Much faster than hashing, because keys are nearly sorted."""
    ordered = np.sort(keys, kind="stable")
    distinct: NDArray[np.int64] = ordered[np.append(True, ordered[1:] != ordered[:-1])]
    return distinct


def _find_keys(keys: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int32]:
    """Index of each wanted key; -1 for a missing one."""
    index = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[index] == wanted, index, -1).astype(np.int32)
