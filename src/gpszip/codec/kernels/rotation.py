"""Rotation of integer vectors into the frame of a heading, exactly reversible."""

from __future__ import annotations

import numpy as np

from gpszip.kernels.jit import jit

__all__ = ["DIRECTIONS", "nearest_direction", "rotate", "rotate_back", "sideways_offset"]

#: Directions of a full turn; two's power, a multiple of 8.
DIRECTIONS = 256
_QUARTER = DIRECTIONS // 4
_SHIFT = 14
_HALF = 1 << (_SHIFT - 1)

_ANGLES = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
_COS = np.round(np.cos(_ANGLES) * (1 << _SHIFT)).astype(np.int64)
_SIN = np.round(np.sin(_ANGLES) * (1 << _SHIFT)).astype(np.int64)
_SMALL = (np.arange(_QUARTER + 1) - _QUARTER // 2) * (2 * np.pi / DIRECTIONS)
_TAN_HALF = np.round(np.tan(_SMALL / 2) * (1 << _SHIFT)).astype(np.int64)
_SIN_SMALL = np.round(np.sin(_SMALL) * (1 << _SHIFT)).astype(np.int64)

_BENDS = 49
_TAN = np.round(np.tan(_ANGLES[: _BENDS + 1]) * (1 << _SHIFT)).astype(np.int64)


@jit
def sideways_offset(along: int, turn: int) -> int:
    """How far to the side one comes ``along`` a line that is turned by so many directions; 69 degrees stand for any larger turn."""
    across = (along * _TAN[min(abs(turn), _BENDS)]) >> _SHIFT
    return across if turn >= 0 else -across


@jit
def nearest_direction(x: int, y: int) -> int:
    """Nearest of the directions to a vector; 0 for the null vector."""
    best = np.int64(0)
    chosen = 0
    for i in range(DIRECTIONS):
        along = x * _COS[i] + y * _SIN[i]
        if along > best:
            best = along
            chosen = i
    return chosen


@jit
def _split(turn: int) -> tuple[int, int]:
    quarters = (turn + _QUARTER // 2) // _QUARTER
    return quarters & 3, turn - quarters * _QUARTER + _QUARTER // 2


@jit
def rotate(x: int, y: int, turn: int) -> tuple[int, int]:
    """Coordinates (along, across) of a vector in the frame of direction ``turn``, by three shears."""
    quarters, small = _split(turn)
    for _ in range(quarters):
        x, y = y, -x
    t, s = -_TAN_HALF[small], -_SIN_SMALL[small]
    x -= (t * y + _HALF) >> _SHIFT
    y += (s * x + _HALF) >> _SHIFT
    x -= (t * y + _HALF) >> _SHIFT
    return x, y


@jit
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
