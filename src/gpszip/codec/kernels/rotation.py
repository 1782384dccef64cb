"""Rotation of integer vectors onto the axes of a heading, exactly reversible.

A rotation by an angle a is three shears (A. W. Paeth, 1986), with t = -tan(a / 2), s = -sin(a)::

    x += t * y;  y += s * x;  x += t * y

Each shear adds a rounded number that depends on the other coordinate only. So it can be undone
exactly, and integers stay integers.
"""

from __future__ import annotations

import numpy as np

from gpszip.kernels.jit import inner_uncounted

__all__ = ["DIRECTIONS", "nearest_direction", "rotate", "rotate_back", "sideways_offset"]

#: Directions of a full turn; a power of two and a multiple of 8.
DIRECTIONS = 256

#: Directions of a right angle.
_QUARTER = DIRECTIONS // 4

#: Binary digits of the tables below after the point, and half a unit for rounding.
_SHIFT = 14
_HALF = 1 << (_SHIFT - 1)

#: Cosine and sine of each direction.
_ANGLES = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
_COS = np.round(np.cos(_ANGLES) * (1 << _SHIFT)).astype(np.int64)
_SIN = np.round(np.sin(_ANGLES) * (1 << _SHIFT)).astype(np.int64)

#: tan(a / 2) and sin(a) of the angles from -45 to 45 degrees that remain beside right angles.
_SMALL = (np.arange(_QUARTER + 1) - _QUARTER // 2) * (2 * np.pi / DIRECTIONS)
_TAN_HALF = np.round(np.tan(_SMALL / 2) * (1 << _SHIFT)).astype(np.int64)
_SIN_SMALL = np.round(np.sin(_SMALL) * (1 << _SHIFT)).astype(np.int64)

#: Largest turn whose tangent is used: 69 degrees.
_MAX_TURN = 49
_TAN = np.round(np.tan(_ANGLES[: _MAX_TURN + 1]) * (1 << _SHIFT)).astype(np.int64)


@inner_uncounted
def sideways_offset(along: int, turn: int) -> int:
    """Offset across the heading of a point ``along`` it, on a line turned by ``turn`` directions.

    It is along * tan(turn). A turn of more than 69 degrees counts as 69 degrees.
    """
    across = (along * _TAN[min(abs(turn), _MAX_TURN)]) >> _SHIFT
    return across if turn >= 0 else -across


@inner_uncounted
def nearest_direction(x: int, y: int) -> int:
    """Direction nearest to a vector; 0 for the null vector."""
    longest = np.int64(0)
    nearest = 0
    for i in range(DIRECTIONS):
        along = x * _COS[i] + y * _SIN[i]
        if along > longest:
            longest = along
            nearest = i
    return nearest


@inner_uncounted
def _split(turn: int) -> tuple[int, int]:
    """Right angles of a turn, and the index of the small angle that remains."""
    quarters = (turn + _QUARTER // 2) // _QUARTER
    return quarters & 3, turn - quarters * _QUARTER + _QUARTER // 2


@inner_uncounted
def rotate(x: int, y: int, turn: int) -> tuple[int, int]:
    """Coordinates (along, across) of a vector on axes turned into direction ``turn``."""
    quarters, small = _split(turn)
    for _ in range(quarters):
        x, y = y, -x
    t, s = -_TAN_HALF[small], -_SIN_SMALL[small]
    x -= (t * y + _HALF) >> _SHIFT
    y += (s * x + _HALF) >> _SHIFT
    x -= (t * y + _HALF) >> _SHIFT
    return x, y


@inner_uncounted
def rotate_back(x: int, y: int, turn: int) -> tuple[int, int]:
    """Undo :func:`rotate`, exactly."""
    quarters, small = _split(turn)
    t, s = -_TAN_HALF[small], -_SIN_SMALL[small]
    x += (t * y + _HALF) >> _SHIFT
    y -= (s * x + _HALF) >> _SHIFT
    x += (t * y + _HALF) >> _SHIFT
    for _ in range(quarters):
        x, y = -y, x
    return x, y
