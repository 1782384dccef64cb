"""Coding of when travel begins and ends within the first and last time step of each piece.

An offset o >= 0, in ticks, is a quotient and a remainder: with L levels, q = o // L times a "more"
of probability 1/64 and one "no more" of 63/64, then r = o - q L, uniform below L. Nearly all
offsets are below L, so that q takes 0.02 bits. Offsets beside a gap are mostly 0: an adaptive bit
comes first and says whether they are not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.end_kinds import MAX_QUOTIENT, NEVER, SOMETIMES
from gpszip.codec.kernels.adaptive import code_bit
from gpszip.codec.kernels.range_coder import Coder, code_interval, decode_cumulative, is_decoding
from gpszip.kernels.jit import inner_uncounted, jit_uncounted

__all__ = ["code_end_offsets"]

#: A "no more" takes all but one of so many numbers.
_QUOTIENT_TOTAL = 64


@inner_uncounted
def _code_quotient(coder: Coder, quotient: int) -> int:
    """Code a quotient, one decision at a time; return more than MAX_QUOTIENT if it is too large."""
    coded = np.int64(0)
    while coded <= MAX_QUOTIENT:
        has_more = coded < quotient
        if is_decoding(coder):
            has_more = decode_cumulative(coder, _QUOTIENT_TOTAL) == _QUOTIENT_TOTAL - 1
        if not has_more:
            code_interval(coder, 0, _QUOTIENT_TOTAL - 1, _QUOTIENT_TOTAL)
            break
        code_interval(coder, _QUOTIENT_TOTAL - 1, 1, _QUOTIENT_TOTAL)
        coded += 1
    return coded


@jit_uncounted
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
        In any direction.
    offsets : int64 array, shape (n,)
        At least 0 and below ``(MAX_QUOTIENT + 1) * levels``; a decoder fills them in. Those of kind
        ``NEVER`` are 0.
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
    decodes = is_decoding(coder)
    for i in range(len(offsets)):
        # Whether there is an offset.
        if kinds[i] == NEVER:
            offsets[i] = 0
            continue
        if kinds[i] == SOMETIMES and code_bit(coder, counts, 0, 1 if offsets[i] > 0 else 0) == 0:
            offsets[i] = 0
            continue

        # Code the quotient, which valid offsets keep small.
        quotient = _code_quotient(coder, np.int64(0) if decodes else offsets[i] // levels)
        if quotient > MAX_QUOTIENT:
            return False

        # Code the remainder; all of its L values are equally likely.
        remainder = np.int64(0)
        if decodes:
            remainder = decode_cumulative(coder, levels)
        else:
            remainder = offsets[i] - quotient * levels
        code_interval(coder, remainder, 1, levels)
        offsets[i] = quotient * levels + remainder
    return True
