"""Thinning of an area on sparse grid cells to lines one cell wide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit

__all__ = ["thin"]


@inner_uncounted
def _is_removable(ring: NDArray[np.bool_], second: bool) -> bool:
    """Whether a cell may go, by the conditions of Zhang and Suen on its eight neighbours.

    A cell goes if it has 2 to 6 neighbours in the area, these form a single arc of the ring, and it
    lies on the boundary that the subiteration peels: south-east in the first, north-west in the
    second.
    """
    filled = starts = 0
    for k in range(8):
        filled += ring[k]
        starts += ring[k] and not ring[k - 1]
    if filled < 2 or filled > 6 or starts != 1:
        return False

    east, north, west, south = ring[0], ring[2], ring[4], ring[6]
    if second:
        return not (north and west and (east or south))
    return not (south and east and (north or west))


@jit
def thin(area: NDArray[np.bool_], neighbours: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Thin an area to lines of the same topology.

    The two subiterations of T. Y. Zhang and C. Y. Suen, A fast parallel algorithm for thinning
    digital patterns, 1984, alternate until neither removes a cell.

    Parameters
    ----------
    area : bool array, shape (c,)
        Cells of the area.
    neighbours : int32 array, shape (c, 8)
        Neighbours counterclockwise from the east; -1 where there is no cell.
    """
    # Alternate between the subiterations until two in a row remove nothing.
    remaining = area.copy()
    candidates, found = np.empty(len(area), np.int64), 0
    for cell in range(len(area)):
        if area[cell]:
            candidates[found] = cell
            found += 1
    candidates = candidates[:found]
    removed = np.empty(found, np.int64)
    ring = np.zeros(8, np.bool_)
    idle = 0
    second = False
    while idle < 2:
        # Decide for all cells before any is removed.
        count = size = 0
        for cell in candidates:
            for k in range(8):
                ring[k] = neighbours[cell, k] >= 0 and remaining[neighbours[cell, k]]
            if _is_removable(ring, second):
                removed[count] = cell
                count += 1
            else:
                candidates[size] = cell
                size += 1

        # Remove them.
        for i in range(count):
            remaining[removed[i]] = False
        candidates = candidates[:size]
        idle = 0 if count else idle + 1
        second = not second
    return remaining
