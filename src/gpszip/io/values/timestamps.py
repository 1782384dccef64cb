"""Seconds from columns of times: numbers in any unit, timestamps, dates and times of day."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.io.values.arrow import NUMBER_PATTERN, is_number, is_text, to_floats, trimmed_text
from gpszip.io.values.dates import clock_to_seconds, dates_to_seconds

__all__ = [
    "TIME_UNITS",
    "guess_unit_by_size",
    "holds_numbers",
    "holds_times_of_day",
    "numbers_to_seconds",
    "times_of_day_to_seconds",
    "times_to_seconds",
    "unit_name",
    "unit_origin",
    "unit_seconds",
]

#: Seconds in a day.
_DAY = 86400.0


class _Unit(NamedTuple):
    """A unit of numeric times: seconds in it, and its zero in seconds since 1970."""

    seconds: float
    origin: float


#: Units that a user can name.
_UNITS = {
    "s": _Unit(1.0, 0.0),
    "ms": _Unit(1e-3, 0.0),
    "us": _Unit(1e-6, 0.0),
    "ns": _Unit(1e-9, 0.0),
    "days": _Unit(_DAY, 0.0),
    "excel": _Unit(_DAY, -25_569 * _DAY),  # days since 1899-12-30, as in spreadsheets
    "matlab": _Unit(_DAY, -719_529 * _DAY),  # days since the year 0
}

#: Names of the units.
TIME_UNITS = tuple(_UNITS)

#: Units by the size of numbers, up to each bound, where no unit is named.
_UNIT_BY_SIZE = ((1e11, "s"), (1e14, "ms"), (1e17, "us"), (np.inf, "ns"))

#: Decimals of seconds to which spreadsheet days are rounded; they have no more.
_EXCEL_DECIMALS = 3

#: A date and time of day without marks, 20240131120000, which as a number would be milliseconds of
#: the 27th century.
_COMPACT = (
    r"^(19|20)\d{2}(0[1-9]|1[0-2])(0[1-9]|[12]\d|3[01])([01]\d|2[0-4])[0-5]\d([0-5]\d|60)(\.\d*)?$"
)

#: A time of day without a date.
_TIME_OF_DAY = r"^\d{1,2}:\d{2}:\d{2}"

#: Rows that are searched for a time of day before the full column is.
_PROBE_ROWS = 1000

#: Number of letters of a cell that messages show.
_MAX_SHOWN_LETTERS = 40

#: What messages suggest.
_EXAMPLES = "ISO 8601 (2024-01-31T12:00:00Z), seconds or milliseconds"

Floats = NDArray[np.float64]


def times_to_seconds(
    column: Any,
    unit: float | None,
    path: str,
    location: str,
    *,
    origin: float = 0.0,
    dates: str | None = None,
) -> Floats:
    """Turn a column of times into seconds.

    Numbers are in the given unit. Without one, the size of their median decides: seconds (up to
    1e11), milliseconds (1e14), microseconds (1e17) or nanoseconds. Dates count from 1970 in UTC;
    dates without a time zone are taken as UTC. A column holds either numbers or dates, whichever
    most of its cells are.

    Parameters
    ----------
    column : pyarrow.ChunkedArray
        Numbers, timestamps, durations, or text with numbers or dates.
    unit : float, optional
        Seconds in the unit of numbers.
    path, location : str
        Name of the log, and its column, for messages.
    origin : float, default 0
        Zero of numbers in seconds since 1970, see :func:`unit_origin`; used only with a unit.
    dates : str, optional
        Order of day, month and year, ``dmy``, ``mdy`` or ``ymd``, in dates such as 03/04/2024; by
        default found from all cells of the column.

    Returns
    -------
    float64 array, shape (n,)
        NaN for cells that are no times.

    Raises
    ------
    InputError
        If there are cells but none is a time, or dates are ambiguous.

    Examples
    --------
    >>> cells = pa.chunked_array([["1970-01-01T00:00:01.5Z", "1970-01-01 01:00:02+01:00"]])
    >>> times_to_seconds(cells, None, "a.csv", "time").tolist()
    [1.5, 2.0]
    >>> times_to_seconds(pa.chunked_array([[1700000000077]]), None, "a.csv", "t").tolist()
    [1700000000.077]
    """
    # Arrow's own types of times.
    kind = column.type
    if pa.types.is_date(kind):
        column = pc.cast(column, pa.timestamp("ms"))
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(kind):
        return _ticks_to_seconds(column)
    if not (is_text(kind) or _is_numeric(kind)):
        raise InputError(
            f"{location} holds {kind}, which is no time", path=path, remedy=f"give {_EXAMPLES}"
        )

    # Numbers, also as text.
    if unit is None and (size := guess_unit_by_size(column)):
        unit = unit_seconds(size)
    if unit is not None and holds_numbers(column):
        return _scale_to_seconds(column, unit, origin)

    # Dates.
    text = trimmed_text(column)
    times = dates_to_seconds(text, dates, path, location)
    cells = pc.fill_null(pc.not_equal(text, ""), False).to_numpy()
    if cells.any() and np.isnan(times).all():
        cell = text[int(cells.argmax())].as_py()
        raise InputError(
            f"{cell[:_MAX_SHOWN_LETTERS]!r} is no date and time",
            path=path,
            location=location,
            remedy=f"give {_EXAMPLES}",
        )
    return times


def numbers_to_seconds(values: Floats, unit: str) -> Floats:
    """Turn numbers in a unit of :data:`TIME_UNITS` into seconds.

    Examples
    --------
    >>> numbers_to_seconds(np.array([25569.5]), "excel").tolist()
    [43200.0]
    """
    factor, origin = _UNITS[unit]
    if origin:
        # The origin in days moves the zero to 1970; then days become seconds.
        since_1970 = np.round((values + origin / factor) * factor, _EXCEL_DECIMALS)
        return np.asarray(since_1970, dtype=np.float64)

    # Divide by integers rather than multiply by inexact fractions.
    return values * factor if factor >= 1 else values / round(1 / factor)


def holds_numbers(column: Any) -> bool:
    """Whether more than half of the non-empty cells of a column are numbers.

    Examples
    --------
    >>> holds_numbers(pa.chunked_array([["1.5", "2", "n/a", ""]]))
    True
    >>> holds_numbers(pa.chunked_array([["2024-05-04"]]))
    False
    """
    if not is_text(column.type):
        return _is_numeric(column.type)
    return _most_match(trimmed_text(column), NUMBER_PATTERN)


def holds_times_of_day(column: Any) -> bool:
    """Whether more than half of the non-empty cells of a column are times of day without a date.

    Examples
    --------
    >>> holds_times_of_day(pa.chunked_array([["8:00:00", "08:00:05"]]))
    True
    >>> holds_times_of_day(pa.chunked_array([["5"]]))
    False
    """
    if pa.types.is_time(column.type):
        return True
    if not is_text(column.type):
        return False

    # Look at a few rows first: most columns have no times of day at all.
    probe = trimmed_text(column.slice(0, _PROBE_ROWS))
    if not _count(pc.match_substring_regex(probe, _TIME_OF_DAY)):
        return False
    return _most_match(trimmed_text(column), _TIME_OF_DAY)


def times_of_day_to_seconds(column: Any) -> Floats:
    """Turn times of day into seconds since midnight; NaN for cells that are none.

    Examples
    --------
    >>> times_of_day_to_seconds(pa.chunked_array([["00:01:00.5", ""]])).tolist()
    [60.5, nan]
    """
    return clock_to_seconds(trimmed_text(column))


def unit_seconds(unit: str) -> float:
    """Seconds in a unit of time, by its name.

    Raises
    ------
    OptionError
        If no unit has this name.

    Examples
    --------
    >>> unit_seconds("ms"), unit_seconds("excel")
    (0.001, 86400.0)
    """
    if unit not in _UNITS:
        raise OptionError(f"time unit {unit!r} is not one of {', '.join(_UNITS)}")
    return _UNITS[unit].seconds


def unit_origin(unit: str | None) -> float:
    """Zero of a unit of time in seconds since 1970; 0 for None.

    Examples
    --------
    >>> unit_origin("ms"), unit_origin("excel")
    (0.0, -2209161600.0)
    """
    return 0.0 if unit is None else _UNITS[unit].origin


def unit_name(factor: float | None) -> str | None:
    """Name of the unit with a number of seconds, if there is one.

    Examples
    --------
    >>> unit_name(0.001), unit_name(None)
    ('ms', None)
    """
    # Days of spreadsheets and of MATLAB are as long as plain days, but count from another zero.
    names = (name for name, unit in _UNITS.items() if unit.seconds == factor and not unit.origin)
    return next(names, None)


def guess_unit_by_size(column: Any) -> str | None:
    """Guess the unit of a column from the median of its numbers; None for dates.

    Examples
    --------
    >>> guess_unit_by_size(pa.chunked_array([[1700000000077]]))
    'ms'
    >>> guess_unit_by_size(pa.chunked_array([["2024-05-04"]])) is None
    True
    """
    if not holds_numbers(column) or _is_compact(column):
        return None
    # The median holds against single bad numbers. Times before 1970 are negative.
    values = to_floats(column)
    values = np.abs(values[np.isfinite(values)])
    size = float(np.median(values)) if len(values) else 0.0
    return next(unit for bound, unit in _UNIT_BY_SIZE if size <= bound)


def _is_numeric(kind: Any) -> bool:
    """Whether a column of an Arrow type counts as numbers; one of nulls alone does."""
    return is_number(kind) or bool(pa.types.is_null(kind))


def _count(flags: Any) -> int:
    """Number of true values in a column of booleans with nulls."""
    return int(pc.sum(flags).as_py() or 0)


def _most_match(text: Any, pattern: str) -> bool:
    """Whether more than half of the non-empty cells match a regular expression."""
    matching = _count(pc.match_substring_regex(text, pattern))
    return 2 * matching > _count(pc.not_equal(text, ""))


def _is_compact(column: Any) -> bool:
    """Whether all numbers are dates without marks, such as 20240504080000."""
    if pa.types.is_floating(column.type) or not len(column):
        return False
    text = trimmed_text(column)
    dates = _count(pc.match_substring_regex(text, _COMPACT))
    return dates == _count(pc.match_substring_regex(text, NUMBER_PATTERN)) > 0


def _ticks_to_seconds(column: Any) -> Floats:
    """Seconds of Arrow's timestamps or durations, exact beyond 2**53 ticks."""
    ticks_per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[column.type.unit]
    # Nulls count as 0 for the division, and become NaN after it.
    ticks = pc.fill_null(pc.cast(column, pa.int64()), 0).to_numpy()
    seconds, rest = np.divmod(ticks, ticks_per_second)
    result: Floats = seconds + rest / ticks_per_second
    result[pc.is_null(column).to_numpy()] = np.nan
    return result


def _scale_to_seconds(column: Any, unit: float, origin: float) -> Floats:
    """Seconds of numbers in a unit, with its zero in seconds since 1970."""
    # Seconds since 1970 need no conversion.
    plain = to_floats(column)
    if unit == 1 and not origin:
        return plain

    # Days may have an origin; those of spreadsheets are rounded.
    if unit > 1:
        days = (plain + origin / unit) * unit
        return np.round(days, _EXCEL_DECIMALS) if origin else days

    # Divide integers before adding, which is exact beyond 2**53.
    ticks_per_second = round(1 / unit)
    if pa.types.is_integer(column.type) and not column.null_count:
        ticks = pc.cast(column, pa.int64(), safe=False).to_numpy()
        seconds, rest = np.divmod(ticks, ticks_per_second)
        exact: Floats = seconds + rest / ticks_per_second
        return exact
    scaled: Floats = plain / ticks_per_second
    return scaled
