"""A hash table of integer keys on one array, for maps that grow while they are decoded.

Callers combine a pair of numbers, such as the two nodes of an edge, to one key.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted

__all__ = ["find_pair_slot"]


@inner_uncounted
def find_pair_slot(keys: NDArray[np.int64], key: int) -> int:
    """Index in ``keys`` that holds a key, or that a new key is to be written to.

    The table uses open addressing with linear probing. Its size is a power of two, and free slots
    hold -1. The hash takes the bits from 20 upwards of the key times 0x9E3779B97F4A7C1, the leading
    digits of the golden ratio's inverse (Knuth, The Art of Computer Programming, section 6.4).
    """
    mask = len(keys) - 1
    slot = ((key * 0x9E3779B97F4A7C1) >> 20) & mask
    while keys[slot] != -1 and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot
