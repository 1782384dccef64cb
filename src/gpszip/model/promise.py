"""The error that an archive promises to keep."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

__all__ = [
    "DIGITS",
    "EXPONENTS",
    "FEW_DIGITS",
    "GROWN",
    "LAST_OF_VERSION_2",
    "MOST_OVER",
    "WRITING_SHARE",
    "WRITING_SHARE_IN_METRES",
    "Promise",
    "grown_promise",
    "promise_of",
    "promise_of_both",
    "writing_error",
]

#: What a promise may have as digits, and as exponents of ten. Archives of version 2 could have an exponent of 7, too.
DIGITS, EXPONENTS = range(1, 1000), range(-8, 7)
LAST_OF_VERSION_2 = 7

#: By how much the exponent of the maximum may be above that of the root mean square where both are promised.
MOST_OVER = range(4)

#: Steps by which merges may have made a promise larger, and the digits that it has then; a factor 2 has so many steps.
GROWN, FEW_DIGITS, _DOUBLE = range(1, 63), range(1, 100), 16

#: Share of the error promised by which tracks may move when they are written to a file in degrees, where lines are straight in
#: another sense, and numbers are rounded; and in metres, where only the rounding counts, and another decimal costs next to nothing.
WRITING_SHARE = 1 / 1000
WRITING_SHARE_IN_METRES = 1 / 20_000

#: Metres by which tracks may move when they are written: at most, and where nothing is promised.
_MOST_WRITING_ERROR, _WRITING_ERROR = 1.0, 0.01


@dataclass(frozen=True)
class Promise:
    """No more error than this: ``digits * 10 ** exponent * 2 ** (grown / 16)`` metres.

    Parameters
    ----------
    digits : int
        1 to 999; 1 to 99 of a promise that has grown.
    exponent : int
        -8 to 6.
    maximum : bool
        Whether every sample is that near, rather than all of them in the root mean square.
    grown : int, default 0
        Steps by which merges have made it larger, up to 62.
    most_digits, most_exponent : int, default 0
        The largest distance of any sample, where that is promised beside the root mean square; no digits where it is not.
    """

    digits: int
    exponent: int
    maximum: bool
    grown: int = 0
    most_digits: int = 0
    most_exponent: int = 0

    @property
    def most(self) -> float | None:
        """The largest distance of any sample in metres, where that is promised beside the root mean square."""
        return float(self.most_digits * Fraction(10) ** self.most_exponent) if self.most_digits else None

    @property
    def metres(self) -> float:
        """The error in metres."""
        return self.before * math.pow(2.0, self.grown / _DOUBLE)

    @property
    def before(self) -> float:
        """What was promised before any merge, in metres."""
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


def promise_of_both(rmse: float, maximum: float) -> Promise | None:
    """Promise a root mean square error and a maximum in metres, each rounded up to three digits.

    Examples
    --------
    >>> promise = promise_of_both(3.0, 12.0)
    >>> promise.metres, promise.most
    (3.0, 12.0)
    """
    first, second = promise_of(rmse, maximum=False), promise_of(maximum, maximum=False)
    if first is None or second is None:
        return first or promise_of(maximum, maximum=True)
    if second.metres <= first.metres:  # the maximum says it all
        return replace(second, maximum=True)
    over = second.exponent - first.exponent
    if over not in MOST_OVER:
        return first
    return replace(first, most_digits=second.digits, most_exponent=second.exponent)


def grown_promise(before: float, metres: float, *, maximum: bool) -> Promise | None:
    """Promise an error of ``metres`` where merges have added to ``before``; None where that is beyond all that can be promised.

    Examples
    --------
    >>> promise = grown_promise(5.0, 9.9, maximum=False)
    >>> promise.before, promise.metres
    (5.0, 10.0)
    """
    if not 0 < before < metres < math.inf:
        return promise_of(metres, maximum=maximum)
    # what has grown beyond all steps counts as if it had been more from the start
    least = max(before, metres * 2.0 ** (-GROWN[-1] / _DOUBLE))
    exponent = max(math.ceil(math.log10(least / (FEW_DIGITS.stop - 0.5))), EXPONENTS.start)
    digits = max(round(least / 10.0**exponent), 1)
    for number in range(digits, FEW_DIGITS.stop if exponent in EXPONENTS else 0):
        for grown in GROWN:
            promise = Promise(number, exponent, maximum, grown)
            if promise.metres >= metres:
                return promise
    return promise_of(metres, maximum=maximum)


def writing_error(promise: Promise | None, *, geographic: bool) -> float:
    """Metres by which tracks may move when they are written to a file, so little that the promise means the file, too.

    Parameters
    ----------
    promise : Promise or None
        Of the archive.
    geographic : bool
        Whether they are written in degrees.

    Examples
    --------
    >>> writing_error(Promise(1, 1, maximum=True), geographic=True), writing_error(None, geographic=True)
    (0.01, 0.01)
    """
    if promise is None:
        return _WRITING_ERROR
    share = WRITING_SHARE if geographic else WRITING_SHARE_IN_METRES
    return min(promise.before * share, _MOST_WRITING_ERROR)
