"""The error that an archive promises to keep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

__all__ = ["DIGITS", "EXPONENTS", "Promise", "promise_of"]

#: What a promise may have as digits, and as exponents of ten.
DIGITS, EXPONENTS = range(1, 1000), range(-8, 8)


@dataclass(frozen=True)
class Promise:
    """No more error than this: ``digits * 10 ** exponent`` metres.

    Parameters
    ----------
    digits : int
        1 to 999.
    exponent : int
        -8 to 7.
    maximum : bool
        Whether every sample is that near, rather than all of them in the root mean square.
    """

    digits: int
    exponent: int
    maximum: bool

    @property
    def metres(self) -> float:
        """The error in metres."""
        return float(self.digits * Fraction(10) ** self.exponent)


def promise_of(metres: float, *, maximum: bool) -> Promise | None:
    """Round a measured error up to three digits; None where it is beyond all that can be promised.

    Examples
    --------
    >>> promise_of(0.23941, maximum=False).metres, promise_of(0.4, maximum=True).metres
    (0.24, 0.4)
    """
    if not 0 <= metres < math.inf:
        return None
    # what 0.4 is written as is meant, not the float64 next to it
    exact = Fraction(repr(float(metres)))
    for exponent in EXPONENTS:
        digits = math.ceil(exact / Fraction(10) ** exponent)
        if digits < DIGITS.stop:
            return Promise(max(digits, 1), exponent, maximum)
    return None
