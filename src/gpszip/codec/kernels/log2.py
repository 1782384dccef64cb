"""Logarithms to base two, on integers, so that every machine computes the same."""

from __future__ import annotations

import numpy as np

from gpszip.kernels.jit import inner_uncounted

__all__ = ["fixed_log2"]

#: Binary digits of a logarithm after the point.
_FRACTION_BITS = 16

#: Binary digits of the mantissa that index the table.
_INDEX_BITS = 10

#: Binary digits of the mantissa below its leading 1.
_MANTISSA_BITS = 30

#: Digits of the mantissa that interpolate between two entries.
_REST_BITS = _MANTISSA_BITS - _INDEX_BITS

#: R[i] = log2(1 + i / 1024) in units of 2**-16, i = 0 ... 1024. No entry lies near a half.
_FRACTIONS = np.round(
    np.log2(1 + np.arange((1 << _INDEX_BITS) + 1) / (1 << _INDEX_BITS)) * (1 << _FRACTION_BITS)
).astype(np.int64)


@inner_uncounted
def fixed_log2(value: int) -> int:
    """Logarithm of an integer from 1 to 2**62, in units of 2**-16; it never falls as that grows.

    With value = 2**e * (1 + (i + r / 2**20) / 1024), the logarithm is
    e * 2**16 + R[i] + ((R[i + 1] - R[i]) * r >> 20).
    """
    # e by bisection
    exponent = 0
    for shift in (32, 16, 8, 4, 2, 1):
        if value >> (exponent + shift) > 0:
            exponent += shift

    # i and r from the mantissa
    mantissa = (
        value << (_MANTISSA_BITS - exponent)
        if exponent <= _MANTISSA_BITS
        else value >> (exponent - _MANTISSA_BITS)
    )
    i = (mantissa >> _REST_BITS) - (1 << _INDEX_BITS)
    rest = mantissa & ((1 << _REST_BITS) - 1)

    # Interpolate between two entries.
    slope = _FRACTIONS[i + 1] - _FRACTIONS[i]
    return (np.int64(exponent) << _FRACTION_BITS) + _FRACTIONS[i] + ((slope * rest) >> _REST_BITS)
