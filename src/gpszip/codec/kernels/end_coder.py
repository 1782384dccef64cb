"""Coding of where travel begins and ends within the first and last cell of each piece.

An offset o >= 0, in ticks, is coded as a quotient and a remainder: with L levels, q = o // L times a "more" of probability 1/64 and
one "no more" of 63/64, then r = o - q L, uniform below L. Nearly all offsets are below L, so that q takes 0.02 bits. Ends beside a
gap are mostly 0: an adaptive bit says whether they are not, and comes first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.adaptive import code_bit
from gpszip.codec.kernels.range_coder import Coder, code_interval, decode_cumulative
from gpszip.kernels.jit import jit

__all__ = ["ALWAYS", "MAX_QUOTIENT", "NEVER", "SOMETIMES", "code_end_offsets"]

#: Which ends have an offset: those of tracks, those beside a gap where much may happen in a cell, and all others.
ALWAYS, SOMETIMES, NEVER = np.arange(3, dtype=np.int8)

#: The largest quotient.
MAX_QUOTIENT = 255

#: A "no more" takes all but one of so many numbers.
_STOP_TOTAL = 64


@jit
def code_end_offsets(
    coder: Coder,
    offsets: NDArray[np.int64],
    kinds: NDArray[np.int8],
    counts: NDArray[np.int32],
    levels: int,
) -> bool:
    """Code offsets in place.

    Parameters
    ----------
    coder : Coder
        Writes or reads.
    offsets : int64 array, shape (n,)
        At least 0 and below ``(MOST_WRAPS + 1) * levels``; filled in when reading. Those of kind ``NEVER`` are 0.
    kinds : int8 array, shape (n,)
        ``ALWAYS``, ``SOMETIMES`` or ``NEVER``.
    counts : int32 array, shape (1, 2)
        Counts of zeros and ones of the adaptive bit; changed in place.
    levels : int
        L, at least 1 and at most 2**41.

    Returns
    -------
    bool
        False if what is read is no offset.
    """
    reads = coder.cursor[1] == 1
    for i in range(len(offsets)):
        if kinds[i] == NEVER:
            offsets[i] = 0
            continue
        if kinds[i] == SOMETIMES and code_bit(coder, counts, 0, 1 if offsets[i] > 0 else 0) == 0:
            offsets[i] = 0
            continue
        wraps = np.int64(0) if reads else offsets[i] // levels
        done = np.int64(0)

        # the quotient, one decision at a time
        while True:
            more = done < wraps
            if reads:
                more = decode_cumulative(coder, _STOP_TOTAL) == _STOP_TOTAL - 1
            if not more:
                code_interval(coder, 0, _STOP_TOTAL - 1, _STOP_TOTAL)
                break
            code_interval(coder, _STOP_TOTAL - 1, 1, _STOP_TOTAL)
            done += 1
            if done > MAX_QUOTIENT:
                return False

        # the remainder
        rest = decode_cumulative(coder, levels) if reads else offsets[i] - wraps * levels
        code_interval(coder, rest, 1, levels)
        offsets[i] = done * levels + rest
    return True
