"""Directions and rotations of vectors; see :mod:`gpszip.codec.kernels.rotation`."""

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

__all__ = ["DIRECTIONS", "nearest_direction", "rotate_back", "sideways_offset"]

#: The tables as Python's integers, which are faster one by one.
_TAN_HALF: list[int] = TAN_HALF.tolist()
_SIN_SMALL: list[int] = SIN_SMALL.tolist()
_TAN: list[int] = TAN.tolist()


def nearest_direction(x: int, y: int) -> int:
    """Direction nearest to a vector; 0 for the null vector.

    Examples
    --------
    >>> nearest_direction(0, 5), nearest_direction(-5, 0), nearest_direction(0, 0)
    (64, 128, 0)
    """
    # The largest scalar product; of equal ones argmax takes the first, as the format has it.
    return int(np.argmax(x * COS + y * SIN)) if x or y else 0


def rotate_back(along: int, across: int, direction: int) -> tuple[int, int]:
    """Coordinates (x, y) of a vector given along and across a direction, by three shears.

    Examples
    --------
    >>> rotate_back(5, 0, 64)
    (0, 5)
    """
    # The small angle that remains beside right angles.
    quarters = (direction + QUARTER // 2) // QUARTER
    small = direction - quarters * QUARTER + QUARTER // 2
    # Shears by tan(a/2), sin(a) and tan(a/2). Each can be undone exactly in spite of the rounding,
    # so that rotating there and back loses nothing.
    t, s = -_TAN_HALF[small], -_SIN_SMALL[small]
    x, y = along, across
    x += (t * y + HALF) >> SHIFT
    y -= (s * x + HALF) >> SHIFT
    x += (t * y + HALF) >> SHIFT

    # The right angles.
    for _ in range(quarters % 4):
        x, y = -y, x
    return x, y


def sideways_offset(along: int, turn: int) -> int:
    """Offset across the heading of a point ``along`` it, on a line turned by ``turn`` directions.

    A turn of more than 69 degrees counts as 69 degrees.
    """
    across = along * _TAN[min(abs(turn), MAX_TURN)] >> SHIFT
    return across if turn >= 0 else -across
