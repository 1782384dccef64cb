"""Thinning an area on scattered cells to lines one cell wide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["thin"]


@jit
def _is_removable(ring: NDArray[np.bool_], second: bool) -> bool:
    # Zhang and Suen, A fast parallel algorithm for thinning digital patterns, 1984.
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
def thin(area: NDArray[np.bool_], near: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Peel an area until lines of its topology are left; neighbours go round from the east, -1 where there is no cell."""
    left = area.copy()
    live = np.flatnonzero(left)
    gone = np.empty(len(live), np.int64)
    ring = np.zeros(8, np.bool_)
    idle = 0
    second = False
    while idle < 2:
        count = size = 0
        for cell in live:
            for k in range(8):
                ring[k] = near[cell, k] >= 0 and left[near[cell, k]]
            if _is_removable(ring, second):
                gone[count] = cell
                count += 1
            else:
                live[size] = cell
                size += 1
        for i in range(count):
            left[gone[i]] = False
        live = live[:size]
        idle = 0 if count else idle + 1
        second = not second
    return left
