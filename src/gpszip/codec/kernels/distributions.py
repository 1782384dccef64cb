"""Entries of mixtures, and numbers too large for a mixture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.integer_contexts import INTEGER_CONTEXTS
from gpszip.codec.kernels.adaptive import (
    CENTERS,
    KINDS,
    SCALES,
    code_signed,
    code_unsigned,
)
from gpszip.codec.kernels.range_coder import Coder
from gpszip.codec.kernels.walk_model import MAX_MAGNITUDE, WalkModel
from gpszip.codec.kernels.walk_priors import BIT_CONTEXTS
from gpszip.kernels.jit import inner_uncounted

__all__ = [
    "FIRST_POSITION",
    "LARGE_DURATION",
    "LARGE_OFFSET",
    "MIXTURE_LIMIT",
    "START_GAP",
    "TRACK_ORDER",
    "TRACK_START",
    "ZERO",
    "add_distribution",
    "code_large_signed",
    "code_large_unsigned",
]

#: Sets of contexts for integers of any size, by what they code.
LARGE_DURATION = np.int64(0)
LARGE_OFFSET = np.int64(1)
FIRST_POSITION = np.int64(2)  # of the very first node
TRACK_START = np.int64(3)  # time step of a track's first knot, after that of the track before
START_GAP = np.int64(4)  # the same, of tracks sorted by their starts
TRACK_ORDER = np.int64(5)  # starts passed over, of those sorted

#: The compiler gives a literal number a type of its own, and compiles a kernel once more for it.
ZERO = np.int64(0)

#: Numbers at or beyond this are coded apart from the mixtures.
MIXTURE_LIMIT = np.int64(1) << 25

#: Scales are at least this, in sixteenths of a step.
_MIN_SCALE = np.int64(6)


@inner_uncounted
def code_large_signed(coder: Coder, model: WalkModel, contexts: int, value: int) -> int:
    """Code an integer of any size with one of the sets of contexts."""
    first = BIT_CONTEXTS + contexts * INTEGER_CONTEXTS
    return code_signed(coder, model.bit_counts, first, value)


@inner_uncounted
def code_large_unsigned(coder: Coder, model: WalkModel, contexts: int, value: int) -> int:
    """Code an integer >= 0 of any size with one of the sets of contexts."""
    first = BIT_CONTEXTS + contexts * INTEGER_CONTEXTS
    return code_unsigned(coder, model.bit_counts, first, value)


@inner_uncounted
def add_distribution(
    mixture: NDArray[np.int64], index: int, kind: int, center: int, scale: int
) -> int:
    """Enter a distribution in column ``index`` of a mixture; return the next index."""
    mixture[KINDS, index] = kind
    mixture[CENTERS, index] = center
    mixture[SCALES, index] = min(max(scale, _MIN_SCALE), MAX_MAGNITUDE)
    return index + 1
