"""Distributions to mix, and numbers too far off for a mixture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import (
    CENTERS,
    INTEGER_CONTEXTS,
    KINDS,
    SCALES,
    code_signed,
    code_unsigned,
)
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import MAX_MAGNITUDE, WalkModel
from gpszip.codec.kernels.walk_priors import BIT_CONTEXTS
from gpszip.kernels.jit import jit

__all__ = [
    "FAR_OFFSET",
    "FAR_SPAN",
    "FIRST_PLACE",
    "MIXTURE_LIMIT",
    "START_GAP",
    "TRACK_ORDER",
    "TRACK_START",
    "ZERO",
    "add_distribution",
    "code_large_signed",
    "code_large_unsigned",
]

#: Sets of contexts of whole numbers.
FAR_SPAN, FAR_OFFSET, FIRST_PLACE, TRACK_START, START_GAP, TRACK_ORDER = np.arange(6)

#: The compiler takes a number written out for a type of its own, and compiles a kernel once more for each.
ZERO = np.int64(0)

#: Numbers at or beyond this are coded apart from the mixtures.
MIXTURE_LIMIT = np.int64(1) << 25


@jit
def code_large_signed(coder: Coder, model: WalkModel, slot: int, value: int) -> int:
    """Code a number of any size with the contexts of ``slot``."""
    return code_signed(coder, model.flags, BIT_CONTEXTS + slot * INTEGER_CONTEXTS, value)


@jit
def code_large_unsigned(coder: Coder, model: WalkModel, slot: int, value: int) -> int:
    """Code a number >= 0 of any size with the contexts of ``slot``."""
    return code_unsigned(coder, model.flags, BIT_CONTEXTS + slot * INTEGER_CONTEXTS, value)


@jit
def add_distribution(sheet: NDArray[np.int64], at: int, kind: int, center: int, scale: int) -> int:
    """Enter a distribution at index ``at``; return the next index."""
    sheet[KINDS, at] = kind
    sheet[CENTERS, at] = center
    sheet[SCALES, at] = min(max(scale, np.int64(6)), MAX_MAGNITUDE)
    return at + 1
