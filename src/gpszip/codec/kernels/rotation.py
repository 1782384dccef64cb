"""Rotation of integer vectors onto the axes of a heading, exactly reversible.

A rotation by an angle a is three shears (A. W. Paeth, 1986), with t = -tan(a / 2), s = -sin(a)::

    x += t * y;  y += s * x;  x += t * y

Each shear adds a rounded number that depends on the other coordinate only. So it can be undone
exactly, and integers stay integers.
"""

from __future__ import annotations

import numpy as np

from gpszip.codec.rotation_tables import (
    COS,
    DIRECTIONS,
    HALF,
    MAX_TURN,
    QUARTER,
    SHIFT,
    SIN,
    SIN_SMALL,
    TAN,
    TAN_HALF,
)
from gpszip.kernels.jit import inner_uncounted

__all__ = ["DIRECTIONS", "nearest_direction", "rotate", "rotate_back", "sideways_offset"]


@inner_uncounted
def sideways_offset(along: int, turn: int) -> int:
    """Offset across the heading of a point ``along`` it, on a line turned by ``turn`` directions.

    It is along * tan(turn). A turn of more than 69 degrees counts as 69 degrees.
    """
    across = (along * TAN[min(abs(turn), MAX_TURN)]) >> SHIFT
    return across if turn >= 0 else -across


@inner_uncounted
def nearest_direction(x: int, y: int) -> int:
    """Direction nearest to a vector; 0 for the null vector."""
    longest = np.int64(0)
    nearest = 0
    for i in range(DIRECTIONS):
        along = x * COS[i] + y * SIN[i]
        if along > longest:
            longest = along
            nearest = i
    return nearest


@inner_uncounted
def _split(turn: int) -> tuple[int, int]:
    """Right angles of a turn, and the index of the small angle that remains."""
    quarters = (turn + QUARTER // 2) // QUARTER
    return quarters & 3, turn - quarters * QUARTER + QUARTER // 2


@inner_uncounted
def rotate(x: int, y: int, turn: int) -> tuple[int, int]:
    """Coordinates (along, across) of a vector on axes turned into direction ``turn``."""
    quarters, small = _split(turn)
    for _ in range(quarters):
        x, y = y, -x
    t, s = -TAN_HALF[small], -SIN_SMALL[small]
    x -= (t * y + HALF) >> SHIFT
    y += (s * x + HALF) >> SHIFT
    x -= (t * y + HALF) >> SHIFT
    return x, y


@inner_uncounted
def rotate_back(x: int, y: int, turn: int) -> tuple[int, int]:
    """Undo :func:`rotate`, exactly."""
    quarters, small = _split(turn)
    t, s = -TAN_HALF[small], -SIN_SMALL[small]
    x += (t * y + HALF) >> SHIFT
    y -= (s * x + HALF) >> SHIFT
    x += (t * y + HALF) >> SHIFT
    for _ in range(quarters):
        x, y = -y, x
    return x, y
