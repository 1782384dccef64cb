"""Directions and rotations of vectors; see :mod:`gpszip.codec.kernels.rotation`."""

from __future__ import annotations

import numpy as np

__all__ = ["DIRECTIONS", "nearest_direction", "rotate_back", "sideways_offset"]

#: Directions of a full turn.
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
_TAN_HALF: list[int] = np.round(np.tan(_SMALL / 2) * (1 << _SHIFT)).astype(np.int64).tolist()
_SIN_SMALL: list[int] = np.round(np.sin(_SMALL) * (1 << _SHIFT)).astype(np.int64).tolist()

#: Largest turn whose tangent is used: 69 degrees.
_MAX_TURN = 49
_TAN: list[int] = (
    np.round(np.tan(_ANGLES[: _MAX_TURN + 1]) * (1 << _SHIFT)).astype(np.int64).tolist()
)


def nearest_direction(x: int, y: int) -> int:
    """Direction nearest to a vector; 0 for the null vector.

    Examples
    --------
    >>> nearest_direction(0, 5), nearest_direction(-5, 0), nearest_direction(0, 0)
    (64, 128, 0)
    """
    return int(np.argmax(x * _COS + y * _SIN)) if x or y else 0


def rotate_back(along: int, across: int, direction: int) -> tuple[int, int]:
    """Coordinates (x, y) of a vector given along and across a direction, by three shears.

    Examples
    --------
    >>> rotate_back(5, 0, 64)
    (0, 5)
    """
    # The small angle that remains beside right angles.
    quarters = (direction + _QUARTER // 2) // _QUARTER
    small = direction - quarters * _QUARTER + _QUARTER // 2
    t, s = -_TAN_HALF[small], -_SIN_SMALL[small]
    x, y = along, across
    x += (t * y + _HALF) >> _SHIFT
    y -= (s * x + _HALF) >> _SHIFT
    x += (t * y + _HALF) >> _SHIFT

    # The right angles.
    for _ in range(quarters % 4):
        x, y = -y, x
    return x, y


def sideways_offset(along: int, turn: int) -> int:
    """Offset across the heading of a point ``along`` it, on a line turned by ``turn`` directions.

    A turn of more than 69 degrees counts as 69 degrees.
    """
    across = along * _TAN[min(abs(turn), _MAX_TURN)] >> _SHIFT
    return across if turn >= 0 else -across
