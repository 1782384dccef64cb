"""The cells of a grid along straight lines; nothing is kept of the empty rest of the world."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["CellGrid", "build_cell_grid", "find_cells", "line_density", "smooth_density"]

#: Steps to the eight neighbours, going round from the east.
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
        The cells, increasing.
    neighbours : int32 array, shape (c, 8)
        Numbers of the neighbours, going round from the east; -1 where there is none.
    centers : float64 array, shape (c, 2)
        Metres.
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
    """Make the grid of all cells that are at most ``margin`` cells away from one of the lines, shape (n, 2) in metres.

    Examples
    --------
    >>> len(build_cell_grid(np.array([[1.0, 1.0]]), np.array([[9.0, 1.0]]), 2.0, 1))
    18
    """
    corner = np.minimum(starts.min(axis=0), ends.min(axis=0))
    origin = (np.floor(corner / size) - margin - 1.5) * size
    top = max(starts[:, 1].max(), ends[:, 1].max())
    rows = int((top - origin[1]) / size) + margin + 3
    _, _, points = _sample_lines(starts, ends, size)
    keys = _sort_unique(_cell_keys(points, origin, size, rows))
    steps = _NEIGHBOUR_OFFSETS[:, 0] * rows + _NEIGHBOUR_OFFSETS[:, 1]
    for _ in range(margin):
        keys = _sort_unique(np.concatenate([keys, *(keys + step for step in steps)]))
    near = np.stack([_find_keys(keys, keys + step) for step in steps], axis=1)
    centers = origin + (np.stack(np.divmod(keys, rows), axis=1) + 0.5) * size
    return CellGrid(origin, size, rows, keys, near, centers)


def find_cells(grid: CellGrid, points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Number of the cell that holds each point, shape (n,); -1 where there is none."""
    return _find_keys(grid.keys, _cell_keys(points, grid.origin, grid.size, grid.rows))


def line_density(
    grid: CellGrid,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Weighted length of lines in each cell, in sides of a cell."""
    line, pieces, points = _sample_lines(starts, ends, grid.size)
    length = np.linalg.norm(ends - starts, axis=1)
    share = (weights * length / pieces / grid.size)[line]
    return np.bincount(find_cells(grid, points), weights=share, minlength=len(grid)).astype(
        np.float64
    )


def smooth_density(
    grid: CellGrid, density: NDArray[np.float64], deviation: float
) -> NDArray[np.float64]:
    """Smooth a density of lines by a bell of this deviation in metres, so that a straight line of weight 1 is 1 high."""
    from gpszip.simplification.kernels.density import blur

    passes = max(1, round(2 * (deviation / grid.size) ** 2))
    return blur(density, grid.neighbours, passes) * math.sqrt(math.pi * passes)


def _sample_lines(
    starts: NDArray[np.float64], ends: NDArray[np.float64], size: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Line of each point, number of points of each line, and points no farther apart than half a cell."""
    pieces = np.ceil(2 * np.linalg.norm(ends - starts, axis=1) / size).astype(np.int64) + 1
    line = np.repeat(np.arange(len(pieces)), pieces)
    place = np.arange(len(line)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return (
        line,
        pieces,
        starts[line] + (ends - starts)[line] * ((place + 0.5) / pieces[line])[:, None],
    )


def _cell_keys(
    points: NDArray[np.float64], origin: NDArray[np.float64], size: float, rows: int
) -> NDArray[np.int64]:
    cells = np.floor((points - origin) / size).astype(np.int64)
    keys: NDArray[np.int64] = cells[:, 0] * rows + cells[:, 1]
    return keys


def _sort_unique(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sort and drop repetitions: nearly sorted keys take a fraction of the time that hashing them does."""
    ordered = np.sort(keys, kind="stable")
    distinct: NDArray[np.int64] = ordered[np.append(True, ordered[1:] != ordered[:-1])]
    return distinct


def _find_keys(keys: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int32]:
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[place] == wanted, place, -1).astype(np.int32)
