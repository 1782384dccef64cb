"""Distributions to mix, and numbers too far off for a mixture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.adaptive import SIZES, code_whole
from gpszip.kernels.jit import jit
from gpszip.kernels.range_coder import Coder
from gpszip.kernels.walk_model import FLAGS, MOST, WalkModel

__all__ = ["REACH", "code_far", "fill"]

#: Numbers at or beyond this are coded apart from the mixtures.
REACH = np.int64(1) << 25


@jit
def code_far(coder: Coder, model: WalkModel, slot: int, value: int) -> int:
    """Code a number of any size with the contexts of ``slot``."""
    return code_whole(coder, model.flags, FLAGS + slot * SIZES, value)


@jit
def fill(
    at: int, kind: int, center: int, scale: int, kinds: NDArray[np.int64], centers: NDArray[np.int64], scales: NDArray[np.int64]
) -> int:
    """Enter a distribution at index ``at``; return the next index."""
    kinds[at] = kind
    centers[at] = center
    scales[at] = min(max(scale, np.int64(6)), MOST)
    return at + 1
