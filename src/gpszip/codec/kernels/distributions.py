"""Distributions to mix, and numbers too far off for a mixture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import CENTERS, KINDS, SCALES, SIZES, code_size, code_whole
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import MOST, WalkModel
from gpszip.codec.kernels.walk_priors import FLAGS
from gpszip.kernels.jit import jit

__all__ = [
    "FAR_OFFSET",
    "FAR_SPAN",
    "FIRST_PLACE",
    "REACH",
    "START_GAP",
    "TRACK_ORDER",
    "TRACK_START",
    "ZERO",
    "code_count",
    "code_far",
    "fill",
]

#: Sets of contexts of whole numbers.
FAR_SPAN, FAR_OFFSET, FIRST_PLACE, TRACK_START, START_GAP, TRACK_ORDER = np.arange(6)

#: The compiler takes a number written out for a type of its own, and compiles a kernel once more for each.
ZERO = np.int64(0)

#: Numbers at or beyond this are coded apart from the mixtures.
REACH = np.int64(1) << 25


@jit
def code_far(coder: Coder, model: WalkModel, slot: int, value: int) -> int:
    """Code a number of any size with the contexts of ``slot``."""
    return code_whole(coder, model.flags, FLAGS + slot * SIZES, value)


@jit
def code_count(coder: Coder, model: WalkModel, slot: int, value: int) -> int:
    """Code a number >= 0 of any size with the contexts of ``slot``."""
    return code_size(coder, model.flags, FLAGS + slot * SIZES, value)


@jit
def fill(sheet: NDArray[np.int64], at: int, kind: int, center: int, scale: int) -> int:
    """Enter a distribution at index ``at``; return the next index."""
    sheet[KINDS, at] = kind
    sheet[CENTERS, at] = center
    sheet[SCALES, at] = min(max(scale, np.int64(6)), MOST)
    return at + 1
