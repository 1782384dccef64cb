"""Smoothing a density on scattered cells of a grid, and moving places to where it is high."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["blur", "find_peaks"]


@jit
def blur(values: NDArray[np.float64], near: NDArray[np.int32], passes: int) -> NDArray[np.float64]:
    """Spread values over the eight neighbours of their cells, each pass by half a cell's variance along each axis."""
    old, new = values.copy(), np.empty_like(values)
    for _ in range(passes):
        for cell in range(len(old)):
            total = 4 * old[cell]
            for k in range(8):
                other = near[cell, k]
                if other >= 0:
                    total += (2 - k % 2) * old[other]
            new[cell] = total / 16
        old, new = new, old
    return old


@jit
def find_peaks(
    places: NDArray[np.float64],
    cells: NDArray[np.int32],
    centers: NDArray[np.float64],
    near: NDArray[np.int32],
    height: NDArray[np.float64],
    reach: float,
    scale: float,
) -> NDArray[np.int32]:
    """For each place, the cell within reach that is highest after taking off distance^2 / (2 scale^2); found cell by cell from its own."""
    best = cells.copy()
    seen = np.full(len(centers), -1, np.int32)
    queue = np.empty(len(centers), np.int32)
    for i in range(len(places)):
        top = -np.inf
        queue[0] = cells[i]
        seen[cells[i]] = i
        head, size = 0, 1
        while head < size:
            cell = queue[head]
            head += 1
            dx, dy = centers[cell, 0] - places[i, 0], centers[cell, 1] - places[i, 1]
            away = dx * dx + dy * dy
            if away > reach * reach and cell != cells[i]:
                continue
            value = height[cell] - away / (2 * scale * scale)
            if value > top:
                top, best[i] = value, cell
            for k in range(8):
                other = near[cell, k]
                if other >= 0 and seen[other] != i:
                    seen[other] = i
                    queue[size] = other
                    size += 1
    return best
