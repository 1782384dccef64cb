"""Smoothing of a density on sparse grid cells, and search for its peaks near given positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["blur", "find_peaks"]


@jit
def blur(
    values: NDArray[np.float64], neighbours: NDArray[np.int32], passes: int
) -> NDArray[np.float64]:
    """Smooth values over the eight neighbours of each cell.

    Each pass applies the kernel [1 2 1; 2 4 2; 1 2 1] / 16, which adds a variance of half a cell
    squared along each axis. Missing cells count as 0.

    Parameters
    ----------
    values : float64 array, shape (c,)
        Value of each cell.
    neighbours : int32 array, shape (c, 8)
        Neighbours counterclockwise from the east; -1 where there is no cell.
    passes : int
        Number of passes.
    """
    old, new = values.copy(), np.empty_like(values)
    for _ in range(passes):
        for cell in range(len(old)):
            total = 4 * old[cell]
            for k in range(8):
                neighbour = neighbours[cell, k]
                if neighbour >= 0:
                    # Even k are side neighbours (weight 2), odd k diagonal ones (weight 1).
                    total += (2 - k % 2) * old[neighbour]
            new[cell] = total / 16

        old, new = new, old
    return old


@jit
def find_peaks(
    positions: NDArray[np.float64],
    cells: NDArray[np.int32],
    centers: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    height: NDArray[np.float64],
    reach: float,
    scale: float,
) -> NDArray[np.int32]:
    """For each position p, the cell c that maximises ``height[c] - |c - p|^2 / (2 scale^2)``.

    A breadth-first search from the position's own cell visits all connected cells within reach.

    Parameters
    ----------
    positions : float64 array, shape (n, 2)
        Metres.
    cells : int32 array, shape (n,)
        Cell of each position.
    centers, neighbours : arrays, shape (c, 2) and (c, 8)
        The grid, as for :class:`gpszip.simplification.cell_grid.CellGrid`.
    height : float64 array, shape (c,)
        Logarithm of the density in each cell.
    reach : float
        Largest distance from the position in metres.
    scale : float
        Standard deviation of the Gaussian prior about the position in metres.
    """
    # Cells that a search has seen are marked with its position's index.
    best = cells.copy()
    seen = np.full(len(centers), -1, np.int32)
    queue = np.empty(len(centers), np.int32)
    for i in range(len(positions)):
        # Start at the position's own cell, which counts however far its center is.
        top = -np.inf
        queue[0] = cells[i]
        seen[cells[i]] = i
        head, size = 0, 1

        # Visit the connected cells within reach, breadth first.
        while head < size:
            cell = queue[head]
            head += 1
            dx, dy = centers[cell, 0] - positions[i, 0], centers[cell, 1] - positions[i, 1]
            square = dx * dx + dy * dy
            if square > reach * reach and cell != cells[i]:
                continue

            # Keep the best cell. Earlier cells win ties.
            value = height[cell] - square / (2 * scale * scale)
            if value > top:
                top, best[i] = value, cell

            # Queue the neighbours not seen yet.
            for k in range(8):
                neighbour = neighbours[cell, k]
                if neighbour >= 0 and seen[neighbour] != i:
                    seen[neighbour] = i
                    queue[size] = neighbour
                    size += 1
    return best
