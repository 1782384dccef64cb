"""A table of pairs of numbers by open addressing, for maps that grow while they are read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["find_pair_slot"]


@jit
def find_pair_slot(keys: NDArray[np.int64], key: int) -> int:
    """Where in ``keys`` (a power of two of them, -1 where free) a key is, or would be entered."""
    mask = len(keys) - 1
    at = ((key * 0x9E3779B97F4A7C1) >> 20) & mask
    while keys[at] != -1 and keys[at] != key:
        at = (at + 1) & mask
    return at
