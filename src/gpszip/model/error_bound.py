"""The error bound that an archive states: how far it may be from the log."""

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

#: Digits that a bound may have, in ten bits.
DIGITS = range(1, 1000)

#: Exponents of ten that a bound may have, from 10 nm to 999 000 km.
EXPONENTS = range(-8, 7)

#: Archives of version 2 could have this exponent, too.
LAST_OF_VERSION_2 = 7

#: By how much the exponent of the maximum may be above that of the root mean square where an
#: archive states both. Two bits hold the difference.
MAXIMUM_EXPONENTS_ABOVE = range(4)

#: Steps by which merges may have extended a bound.
GROWTH_STEPS = range(1, 63)

#: Digits that an extended bound may have; it shares its bytes with the steps.
GROWN_DIGITS = range(1, 100)

#: Steps that extend a bound by a factor of 2.
_STEPS_PER_DOUBLING = 16

#: Share of the error bound by which tracks may move when they are written to a file in degrees,
#: where straight lines are straight in another sense, and numbers are rounded.
WRITING_SHARE = 1 / 1000

#: The same for a file in metres, where only the rounding counts, and another decimal costs little.
WRITING_SHARE_IN_METRES = 1 / 20_000

#: Metres by which tracks may move at most when they are written.
_MAX_WRITING_ERROR = 1.0

#: Metres by which tracks may move when they are written from an archive without an error bound.
_DEFAULT_WRITING_ERROR = 0.01


@dataclass(frozen=True, repr=False)
class ErrorBound:
    """No more error than ``digits * 10 ** exponent * 2 ** (growth / 16)`` metres.

    Parameters
    ----------
    digits : int
        1 to 999; 1 to 99 for a bound that merges have extended.
    exponent : int
        -8 to 6.
    maximum : bool
        Whether the bound holds for every sample, rather than for the root mean square of all.
    growth : int, default 0
        Steps by which merges have extended it, up to 62.
    max_digits, max_exponent : int, default 0
        The largest distance of any sample, where it is bounded beside the root mean square; no
        digits where it is not.
    """

    # Integers, as a file has them: a float could be a bound that no file can state.
    digits: int
    exponent: int
    maximum: bool
    growth: int = 0
    max_digits: int = 0
    max_exponent: int = 0

    def __str__(self) -> str:
        """Say the bound in words.

        Examples
        --------
        >>> print(rounded_bounds(3.0, 12.0))
        RMSE <= 3 m, maximum <= 12 m
        """
        kind = "maximum" if self.maximum else "RMSE"
        beside = "" if self.max_error is None else f", maximum <= {self.max_error:g} m"
        return f"{kind} <= {self.metres:.6g} m{beside}"

    def __repr__(self) -> str:
        merged = f", {self.before:g} m before merges" if self.growth else ""
        return f"ErrorBound({self}{merged})"

    @property
    def max_error(self) -> float | None:
        """Largest distance of any sample in metres, where bounded beside the root mean square."""
        return (
            float(self.max_digits * Fraction(10) ** self.max_exponent) if self.max_digits else None
        )

    @property
    def metres(self) -> float:
        """The bound in metres."""
        # digits * 10 ** exponent is the bound that was stated at first; merges multiply it.
        return self.before * math.pow(2.0, self.growth / _STEPS_PER_DOUBLING)

    @property
    def before(self) -> float:
        """The bound before any merge, in metres."""
        # A fraction is rounded once: 3 * 10.0 ** -1 is 0.30000000000000004, and 3 / 10 is 0.3.
        return float(self.digits * Fraction(10) ** self.exponent)


def rounded_bound(metres: float, *, maximum: bool) -> ErrorBound | None:
    """Round a measured error up to three digits; None where it is too large for any bound.

    Examples
    --------
    >>> rounded_bound(0.23941, maximum=False).metres, rounded_bound(0.4, maximum=True).metres
    (0.24, 0.4)
    """
    if not 0 <= metres < math.inf:
        return None
    # The decimal number that is written counts, not the float64 next to it.
    exact = Fraction(repr(float(metres)))

    # Take the finest unit in which three digits suffice, so that least is added by rounding up. An
    # error of 0 is stated as one unit, since no digits stand for no bound.
    for exponent in EXPONENTS:
        digits = math.ceil(exact / Fraction(10) ** exponent)
        if digits < DIGITS.stop:
            return ErrorBound(max(digits, 1), exponent, maximum)
    return None


def rounded_bounds(rmse: float, maximum: float) -> ErrorBound | None:
    """Bound a root mean square error and a maximum in metres, each rounded up to three digits.

    Examples
    --------
    >>> error_bound = rounded_bounds(3.0, 12.0)
    >>> error_bound.metres, error_bound.max_error
    (3.0, 12.0)
    """
    first, second = rounded_bound(rmse, maximum=False), rounded_bound(maximum, maximum=False)

    # State what can be stated where the other is too large for any bound.
    if first is None or second is None:
        return first or rounded_bound(maximum, maximum=True)
    if second.metres <= first.metres:  # the maximum bounds the root mean square, too
        return replace(second, maximum=True)

    # Both have a place in the file only if their exponents are near each other.
    exponents_above = second.exponent - first.exponent
    if exponents_above not in MAXIMUM_EXPONENTS_ABOVE:
        return first
    return replace(first, max_digits=second.digits, max_exponent=second.exponent)


def extended_bound(before: float, metres: float, *, maximum: bool) -> ErrorBound | None:
    """Bound an error that merges have made larger.

    Parameters
    ----------
    before : float
        Bound in metres before any merge.
    metres : float
        Error that is to be bounded now.
    maximum : bool
        Whether both are of every sample, rather than of the root mean square.

    Returns
    -------
    ErrorBound or None
        The smallest one that holds; None where the error is too large for any bound.

    Examples
    --------
    >>> error_bound = extended_bound(5.0, 9.9, maximum=False)
    >>> error_bound.before, error_bound.metres
    (5.0, 10.0)
    """
    # An error within the bound before, or a bound of no size, leaves nothing to extend.
    if not 0 < before < metres < math.inf:
        return rounded_bound(metres, maximum=maximum)

    # A bound that outgrows all steps counts as if it had been larger from the start.
    least = max(before, metres * 2.0 ** (-GROWTH_STEPS[-1] / _STEPS_PER_DOUBLING))
    # The finest unit in which that has at most two digits: least / 10 ** exponent rounds to 99 or
    # less if it is below 99.5.
    exponent = max(math.ceil(math.log10(least / (GROWN_DIGITS.stop - 0.5))), EXPONENTS.start)
    digits = max(round(least / 10.0**exponent), 1)

    # Take the first digits and steps that reach the error.
    for more_digits in range(digits, GROWN_DIGITS.stop if exponent in EXPONENTS else 0):
        for growth in GROWTH_STEPS:
            error_bound = ErrorBound(more_digits, exponent, maximum, growth)
            if error_bound.metres >= metres:
                return error_bound
    return rounded_bound(metres, maximum=maximum)


def writing_error(error_bound: ErrorBound | None, *, geographic: bool) -> float:
    """Metres by which tracks may move when they are written to a file that keeps the error bound.

    Parameters
    ----------
    error_bound : ErrorBound or None
        Of the archive.
    geographic : bool
        Whether they are written in degrees.

    Examples
    --------
    >>> ten = ErrorBound(1, 1, maximum=True)
    >>> writing_error(ten, geographic=True), writing_error(None, geographic=True)
    (0.01, 0.01)
    """
    if error_bound is None:
        return _DEFAULT_WRITING_ERROR

    # The bound before any merge counts, so that a merge doesn't make written files coarser.
    share = WRITING_SHARE if geographic else WRITING_SHARE_IN_METRES
    return min(error_bound.before * share, _MAX_WRITING_ERROR)
