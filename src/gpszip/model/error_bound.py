"""The error that an archive promises to keep."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

__all__ = [
    "DIGITS",
    "EXPONENTS",
    "GROWN_DIGITS",
    "GROWTH_STEPS",
    "LAST_OF_VERSION_2",
    "MAXIMUM_EXPONENTS_ABOVE",
    "WRITING_SHARE",
    "WRITING_SHARE_IN_METRES",
    "ErrorBound",
    "extended_bound",
    "rounded_bound",
    "rounded_bounds",
    "writing_error",
]

#: What a promise may have as digits, and as exponents of ten. Archives of version 2 could have an exponent of 7, too.
DIGITS, EXPONENTS = range(1, 1000), range(-8, 7)
LAST_OF_VERSION_2 = 7

#: By how much the exponent of the maximum may be above that of the root mean square where both are promised.
MAXIMUM_EXPONENTS_ABOVE = range(4)

#: Steps by which merges may have made a promise larger, and the digits that it has then; a factor 2 has so many steps.
GROWTH_STEPS, GROWN_DIGITS, _DOUBLE = range(1, 63), range(1, 100), 16

#: Share of the error promised by which tracks may move when they are written to a file in degrees, where lines are straight in
#: another sense, and numbers are rounded; and in metres, where only the rounding counts, and another decimal costs next to nothing.
WRITING_SHARE = 1 / 1000
WRITING_SHARE_IN_METRES = 1 / 20_000

#: Metres by which tracks may move when they are written: at most, and where nothing is promised.
_MOST_WRITING_ERROR, _WRITING_ERROR = 1.0, 0.01


@dataclass(frozen=True)
class ErrorBound:
    """No more error than this: ``digits * 10 ** exponent * 2 ** (grown / 16)`` metres.

    Parameters
    ----------
    digits : int
        1 to 999; 1 to 99 of a promise that has grown.
    exponent : int
        -8 to 6.
    maximum : bool
        Whether every sample is that near, rather than all of them in the root mean square.
    growth : int, default 0
        Steps by which merges have made it larger, up to 62.
    max_digits, max_exponent : int, default 0
        The largest distance of any sample, where that is promised beside the root mean square; no digits where it is not.
    """

    digits: int
    exponent: int
    maximum: bool
    growth: int = 0
    max_digits: int = 0
    max_exponent: int = 0

    @property
    def max_error(self) -> float | None:
        """The largest distance of any sample in metres, where that is promised beside the root mean square."""
        return (
            float(self.max_digits * Fraction(10) ** self.max_exponent) if self.max_digits else None
        )

    @property
    def metres(self) -> float:
        """The error in metres."""
        return self.before * math.pow(2.0, self.growth / _DOUBLE)

    @property
    def before(self) -> float:
        """What was promised before any merge, in metres."""
        return float(self.digits * Fraction(10) ** self.exponent)


def rounded_bound(metres: float, *, maximum: bool) -> ErrorBound | None:
    """Round a measured error up to three digits; None where it is beyond all that can be promised.

    Examples
    --------
    >>> rounded_bound(0.23941, maximum=False).metres, rounded_bound(0.4, maximum=True).metres
    (0.24, 0.4)
    """
    if not 0 <= metres < math.inf:
        return None
    # what 0.4 is written as is meant, not the float64 next to it
    exact = Fraction(repr(float(metres)))
    for exponent in EXPONENTS:
        digits = math.ceil(exact / Fraction(10) ** exponent)
        if digits < DIGITS.stop:
            return ErrorBound(max(digits, 1), exponent, maximum)
    return None


def rounded_bounds(rmse: float, maximum: float) -> ErrorBound | None:
    """Promise a root mean square error and a maximum in metres, each rounded up to three digits.

    Examples
    --------
    >>> error_bound = rounded_bounds(3.0, 12.0)
    >>> error_bound.metres, error_bound.max_error
    (3.0, 12.0)
    """
    first, second = rounded_bound(rmse, maximum=False), rounded_bound(maximum, maximum=False)
    if first is None or second is None:
        return first or rounded_bound(maximum, maximum=True)
    if second.metres <= first.metres:  # the maximum says it all
        return replace(second, maximum=True)
    over = second.exponent - first.exponent
    if over not in MAXIMUM_EXPONENTS_ABOVE:
        return first
    return replace(first, max_digits=second.digits, max_exponent=second.exponent)


def extended_bound(before: float, metres: float, *, maximum: bool) -> ErrorBound | None:
    """Promise an error of ``metres`` where merges have added to ``before``; None where that is beyond all that can be promised.

    Examples
    --------
    >>> error_bound = extended_bound(5.0, 9.9, maximum=False)
    >>> error_bound.before, error_bound.metres
    (5.0, 10.0)
    """
    if not 0 < before < metres < math.inf:
        return rounded_bound(metres, maximum=maximum)
    # what has grown beyond all steps counts as if it had been more from the start
    least = max(before, metres * 2.0 ** (-GROWTH_STEPS[-1] / _DOUBLE))
    exponent = max(math.ceil(math.log10(least / (GROWN_DIGITS.stop - 0.5))), EXPONENTS.start)
    digits = max(round(least / 10.0**exponent), 1)
    for number in range(digits, GROWN_DIGITS.stop if exponent in EXPONENTS else 0):
        for grown in GROWTH_STEPS:
            error_bound = ErrorBound(number, exponent, maximum, grown)
            if error_bound.metres >= metres:
                return error_bound
    return rounded_bound(metres, maximum=maximum)


def writing_error(error_bound: ErrorBound | None, *, geographic: bool) -> float:
    """Metres by which tracks may move when they are written to a file, so little that the promise means the file, too.

    Parameters
    ----------
    error_bound : Promise or None
        Of the archive.
    geographic : bool
        Whether they are written in degrees.

    Examples
    --------
    >>> writing_error(ErrorBound(1, 1, maximum=True), geographic=True), writing_error(None, geographic=True)
    (0.01, 0.01)
    """
    if error_bound is None:
        return _WRITING_ERROR
    share = WRITING_SHARE if geographic else WRITING_SHARE_IN_METRES
    return min(error_bound.before * share, _MOST_WRITING_ERROR)
