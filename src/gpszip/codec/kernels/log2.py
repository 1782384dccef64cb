"""Logarithms to the base of two, on integers."""

from __future__ import annotations

import numpy as np

from gpszip.kernels.jit import jit

__all__ = ["fixed_log2"]

_PLACES = 16
_INDEX = 10
_FRACTIONS = np.round(
    np.log2(1 + np.arange((1 << _INDEX) + 1) / (1 << _INDEX)) * (1 << _PLACES)
).astype(np.int64)


@jit
def fixed_log2(value: int) -> int:
    """Logarithm of an integer from 1 to 2**62, in units of 2**-16; it never falls as the integer grows."""
    exponent = 0
    for shift in (32, 16, 8, 4, 2, 1):
        if value >> (exponent + shift) > 0:
            exponent += shift
    mantissa = value << (30 - exponent) if exponent <= 30 else value >> (exponent - 30)
    at = (mantissa >> (30 - _INDEX)) - (1 << _INDEX)
    part = mantissa & ((1 << (30 - _INDEX)) - 1)
    return (
        (np.int64(exponent) << _PLACES)
        + _FRACTIONS[at]
        + (((_FRACTIONS[at + 1] - _FRACTIONS[at]) * part) >> (30 - _INDEX))
    )
