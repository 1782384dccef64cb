"""Times as users give them, in seconds: dates of any kind, ISO 8601 text, or plain numbers."""

from __future__ import annotations

from datetime import UTC, date, datetime
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError

__all__ = ["EPOCH_START", "Times", "counts_from_1970", "format_span", "to_seconds", "wrong_unit"]

#: Logs whose first time is beyond this count their seconds from 1970 (this is March 1973). Smaller
#: times are seconds from a zero of the log's own, such as the start of a recording.
EPOCH_START = 1e8

#: Numbers from here on are no seconds (this is the year 5138), but milliseconds, micro- or
#: nanoseconds since 1970. The readers of logs draw the line at the same number.
_MILLISECONDS = 1e11
_MICROSECONDS = 1e14
_NANOSECONDS = 1e17

#: What functions take as times.
Times = ArrayLike | datetime | date


def to_seconds(times: Times, *, name: str = "times") -> NDArray[np.float64]:
    """Convert times to seconds.

    Parameters
    ----------
    times : array_like of any shape
        Numbers are seconds already. ``datetime``, ``date``, ``numpy.datetime64`` and ISO 8601 text
        become seconds since 1970; those without a time zone are in UTC.
    name : str
        The argument's name, for errors.

    Returns
    -------
    float64 array of the same shape
        NaN for NaT.

    Raises
    ------
    OptionError
        If a value is no time.

    Examples
    --------
    >>> to_seconds(["1970-01-01T00:00:10Z", "1970-01-02"]).tolist()
    [10.0, 86400.0]
    >>> to_seconds(np.datetime64("1970-01-01T00:00:00.250")).tolist()
    0.25
    """
    # Arrays of numbers and of datetime64 are converted at once.
    # NumPy refuses nested lists of unequal lengths.
    try:
        array = np.asarray(times)
    except ValueError as error:
        raise OptionError(f"{name} is no array of times: {error}") from None
    # Signed, unsigned and floating point numbers. Booleans go on, and are refused one by one.
    if array.dtype.kind in "iuf":
        return array.astype(np.float64)
    if array.dtype.kind == "M":
        return _datetime64_seconds(array)

    # Dates and text are converted one by one; numpy would turn numbers among text into text.
    values = np.asarray(times, dtype=object)
    seconds = [_one_in_seconds(value, name) for value in values.reshape(-1)]
    return np.array(seconds, dtype=np.float64).reshape(values.shape)


def counts_from_1970(first: float) -> bool:
    """Whether a log that begins at this time counts its seconds from 1970.

    Examples
    --------
    >>> counts_from_1970(1.4e9), counts_from_1970(0.5)
    (True, False)
    """
    return first >= EPOCH_START


def format_span(first: float, last: float) -> str:
    """Describe a span of time for people.

    Examples
    --------
    >>> format_span(0.0, 77.25)
    '0 s to 77.25 s'
    >>> format_span(1.4e9, 1.4e9 + 90)
    '2014-05-13 16:53:20 to 16:54:50 UTC'
    """
    if not counts_from_1970(first):
        # Ten digits show milliseconds for 115 days.
        return f"{first:.10g} s to {last:.10g} s"
    try:
        begin, end = datetime.fromtimestamp(first, UTC), datetime.fromtimestamp(last, UTC)
    except (OverflowError, ValueError, OSError):
        # Dates end with the year 9999.
        return f"{first:.0f} s to {last:.0f} s"

    # Don't repeat the day where both are on the same.
    day = "%H:%M:%S" if begin.date() == end.date() else "%Y-%m-%d %H:%M:%S"
    return f"{begin:%Y-%m-%d %H:%M:%S} to {end:{day}} UTC"


def wrong_unit(times: NDArray[np.float64], first: float, last: float) -> str | None:
    """Explain why times that a log doesn't cover look like another unit or another zero.

    A time before the log, after it or in a gap is a fair question, whose answer is NaN. A time that
    is off by the factor of a unit, or by the years since 1970, is a mistake.

    Parameters
    ----------
    times : float64 array
        Seconds that were asked for.
    first, last : float
        Span of the log in seconds.

    Returns
    -------
    str or None
        What the times look like, and what to do; None if any of them lies within the span, or
        nothing is wrong with their unit.

    Examples
    --------
    >>> wrong_unit(np.array([12.0, 13.5]), 1.4e9, 1.4e9 + 90)
    '12 looks like seconds from the start of the log: add 1400000000'
    >>> wrong_unit(np.array([1.5e9]), 1.4e9, 1.4e9 + 90) is None
    True
    """
    # If any of the times lies within the log, their unit is right.
    asked = times[np.isfinite(times)]
    if not asked.size or ((asked >= first) & (asked <= last)).any():
        return None
    low, high = float(asked.min()), float(asked.max())
    example = f"{float(asked.reshape(-1)[0]):.15g}"

    # Milliseconds and finer since 1970.
    if low >= _MILLISECONDS > last:
        # The finest unit first: nanoseconds are beyond the limits of the others as well.
        for limit, unit, factor in (
            (_NANOSECONDS, "nanoseconds", "1e9"),
            (_MICROSECONDS, "microseconds", "1e6"),
            (_MILLISECONDS, "milliseconds", "1000"),
        ):
            if low >= limit:
                return f"{example} looks like {unit}: divide by {factor}"

    # Seconds from the log's start where it counts from 1970, and the other way round.
    if counts_from_1970(first) and low > -EPOCH_START and high < EPOCH_START:
        return f"{example} looks like seconds from the start of the log: add {first:.15g}"
    if last < EPOCH_START and low >= EPOCH_START:
        return (
            f"{example} looks like a date, or seconds since 1970; "
            "the log counts its seconds from a zero of its own"
        )
    return None


def _datetime64_seconds(array: NDArray[np.datetime64]) -> NDArray[np.float64]:
    # Full seconds and the rest apart: nanoseconds since 1970 don't fit a float64.
    full = array.astype("datetime64[s]")
    rest = np.subtract(array, full.astype(array.dtype)) / np.timedelta64(1, "s")
    seconds: NDArray[np.float64] = full.astype(np.int64) + rest
    # NaT is the most negative integer in these sums.
    return np.asarray(np.where(np.isnat(array), np.nan, seconds), dtype=np.float64)


def _one_in_seconds(value: object, name: str) -> float:
    # Text becomes a datetime.
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value)
        except ValueError:
            raise OptionError(
                f"{name} holds {value!r}, which is no time",
                remedy="give a datetime, numpy.datetime64, seconds, or text such as "
                "2024-05-01T10:00:00Z",
            ) from None

    # Dates, in UTC where they name no zone. A datetime is a date, too, so it comes first.
    if isinstance(value, datetime):
        return (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
    # A date alone is its first second.
    if isinstance(value, date):
        return datetime(value.year, value.month, value.day, tzinfo=UTC).timestamp()
    if isinstance(value, np.datetime64):
        return float(_datetime64_seconds(np.asarray(value)))

    # Numbers. To Python, True and a timedelta64 are numbers as well.
    if isinstance(value, Real) and not isinstance(value, bool | np.timedelta64):
        return float(value)
    raise OptionError(
        f"{name} holds {value!r}, which is no time",
        remedy="give a datetime, numpy.datetime64, ISO 8601 text or seconds",
    )
