"""Tables of directions and rotations, for the compiled and the plain decoder.

They are a part of the archive format (docs/format.md): all numbers are integers, so that every
machine decodes the same positions.
"""

from __future__ import annotations

import numpy as np

__all__ = [
    "COS",
    "DIRECTIONS",
    "HALF",
    "MAX_TURN",
    "QUARTER",
    "SHIFT",
    "SIN",
    "SIN_SMALL",
    "TAN",
    "TAN_HALF",
]

#: Directions of a full turn; a power of two and a multiple of 8.
DIRECTIONS = 256

#: Directions of a right angle.
QUARTER = DIRECTIONS // 4

#: Binary digits of the tables below after the point, and half a unit for rounding.
SHIFT = 14
HALF = 1 << (SHIFT - 1)

#: Cosine and sine of each direction.
_ANGLES = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
COS = np.round(np.cos(_ANGLES) * (1 << SHIFT)).astype(np.int64)
SIN = np.round(np.sin(_ANGLES) * (1 << SHIFT)).astype(np.int64)

#: tan(a / 2) and sin(a) of the angles from -45 to 45 degrees that remain beside right angles.
_SMALL = (np.arange(QUARTER + 1) - QUARTER // 2) * (2 * np.pi / DIRECTIONS)
TAN_HALF = np.round(np.tan(_SMALL / 2) * (1 << SHIFT)).astype(np.int64)
SIN_SMALL = np.round(np.sin(_SMALL) * (1 << SHIFT)).astype(np.int64)

#: Largest turn whose tangent is used: 69 degrees.
MAX_TURN = 49
TAN = np.round(np.tan(_ANGLES[: MAX_TURN + 1]) * (1 << SHIFT)).astype(np.int64)
