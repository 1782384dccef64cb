"""Which starts and ends of pieces have an offset from their knot, and how large it may be."""

from __future__ import annotations

import numpy as np

__all__ = ["ALWAYS", "MAX_QUOTIENT", "NEVER", "RARE_TOTAL", "SOMETIMES"]

#: Which ends have an offset.
ALWAYS = np.int8(0)  # starts and ends of tracks
SOMETIMES = np.int8(1)  # ends beside a gap, where the walk goes far within a time step
NEVER = np.int8(2)  # all others

#: The largest quotient of an offset.
MAX_QUOTIENT = 255

#: Rare things, such as a track without times, happen with a probability of one in so many.
RARE_TOTAL = 64
