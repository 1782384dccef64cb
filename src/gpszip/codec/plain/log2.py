"""Logarithms on Python's integers; see :mod:`gpszip.codec.kernels.log2`."""

from __future__ import annotations

import math

__all__ = ["fixed_log2"]

#: Logarithms to the base of two of 1 ... 2 in 1024ths, in units of 2**-16. No entry lies near a
#: half.
_FRACTIONS = [round(65536 * math.log2(1 + i / 1024)) for i in range(1025)]


def fixed_log2(value: int) -> int:
    """Logarithm of a positive integer to base two, in units of 2**-16.

    Examples
    --------
    >>> fixed_log2(1), fixed_log2(8), fixed_log2(3)
    (0, 196608, 103872)
    """
    # The value is 2**exponent times a mantissa from 1 to 2, in units of 2**-30: a leading one, ten
    # digits that index the table, and twenty between two entries.
    exponent = value.bit_length() - 1
    mantissa = (value << 30) >> exponent
    i, rest = (mantissa >> 20) - 1024, mantissa & 0xFFFFF
    low = _FRACTIONS[i]
    return (exponent << 16) + low + ((_FRACTIONS[i + 1] - low) * rest >> 20)
