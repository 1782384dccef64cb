"""Columns of times as seconds: numbers in any unit, timestamps, dates and times of day."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.io.values.arrow import NUMBER_PATTERN, is_text, to_floats, trimmed_text
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

#: Seconds of a day.
_DAY = 86400.0

#: Units of numbers that a user can name: seconds in each, and seconds from 1970 to its zero.
_UNITS = {
    "s": (1.0, 0.0),
    "ms": (1e-3, 0.0),
    "us": (1e-6, 0.0),
    "ns": (1e-9, 0.0),
    "days": (_DAY, 0.0),
    "excel": (_DAY, -25_569 * _DAY),  # days from 1899-12-30, as spreadsheets count them
    "matlab": (_DAY, -719_529 * _DAY),  # days from the year 0
}

#: Names of the units.
TIME_UNITS = tuple(_UNITS)

#: Numbers up to the first are seconds, up to the next milliseconds, and so on, where nobody names the unit.
_UNIT_BY_SIZE = ((1e11, "s"), (1e14, "ms"), (1e17, "us"), (np.inf, "ns"))

#: Decimals of seconds that spreadsheets tell, whose days are rounded.
_EXCEL_DECIMALS = 3

#: A date and time of day without marks, which would be milliseconds of the 27th century.
_COMPACT = (
    r"^(19|20)\d{2}(0[1-9]|1[0-2])(0[1-9]|[12]\d|3[01])([01]\d|2[0-4])[0-5]\d([0-5]\d|60)(\.\d*)?$"
)

_MAX_SHOWN_LETTERS = 40  # letters of a cell in messages
_EXAMPLES = "ISO 8601 (2024-01-31T12:00:00Z), seconds or milliseconds"

Floats = NDArray[np.float64]


def times_to_seconds(
    column: Any, unit: float | None, where: str, *, origin: float = 0.0, dates: str | None = None
) -> Floats:
    """Turn a column of times into seconds.

    Numbers are in the unit given, or else, by the size of their median, in seconds (up to 1e11), milliseconds (1e14),
    microseconds (1e17) or nanoseconds. Dates count from 1970 in UTC; one without a zone is taken as UTC. A column holds either
    numbers or dates: what most of its cells are.

    Parameters
    ----------
    column : pyarrow.ChunkedArray
        Numbers, timestamps, durations, or text that holds numbers or dates.
    unit : float, optional
        Seconds in the unit of numbers.
    where : str
        Name of the log and column for messages.
    origin : float, default 0
        Seconds from 1970 to the zero of numbers, see :func:`unit_origin`; used with a unit only.
    dates : str, optional
        Order of day, month and year, ``dmy``, ``mdy`` or ``ymd``, in dates such as 03/04/2024. Told from the column as a whole
        where left out.

    Returns
    -------
    float64 array, shape (n,)
        NaN for what is no time.

    Raises
    ------
    InputError
        If there are cells but none is a time, or dates can be read in several ways.

    Examples
    --------
    >>> times_to_seconds(pa.chunked_array([["1970-01-01T00:00:01.5Z", "1970-01-01 01:00:02+01:00"]]), None, "a").tolist()
    [1.5, 2.0]
    >>> times_to_seconds(pa.chunked_array([[1700000000077]]), None, "a").tolist()
    [1700000000.077]
    """
    # Types that say what they are.
    kind = column.type
    if pa.types.is_date(kind):
        column = pc.cast(column, pa.timestamp("ms"))
    if pa.types.is_timestamp(column.type) or pa.types.is_duration(kind):
        return _ticks_to_seconds(column)
    if not (is_text(kind) or _is_numeric(kind)):
        raise InputError(f"{where} holds {kind}, which is no time; give {_EXAMPLES}")

    # Numbers, and texts that hold them.
    if unit is None and (size := guess_unit_by_size(column)):
        unit = unit_seconds(size)
    if unit is not None and holds_numbers(column):
        return _scale_to_seconds(column, unit, origin)

    # Dates.
    text = trimmed_text(column)
    times = dates_to_seconds(text, dates, where)
    cells = pc.fill_null(pc.not_equal(text, ""), False).to_numpy()
    if cells.any() and np.isnan(times).all():
        cell = text[int(cells.argmax())].as_py()
        raise InputError(
            f"{where}: {cell[:_MAX_SHOWN_LETTERS]!r} is no date and time; give {_EXAMPLES}"
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
        from_1970 = np.round((values + origin / factor) * factor, _EXCEL_DECIMALS)
        return np.asarray(from_1970, dtype=np.float64)
    return values * factor if factor >= 1 else values / round(1 / factor)


def holds_numbers(column: Any) -> bool:
    """Whether most cells of a column that are not empty are numbers.

    Examples
    --------
    >>> holds_numbers(pa.chunked_array([["1.5", "2", "n/a", ""]])), holds_numbers(pa.chunked_array([["2024-05-04"]]))
    (True, False)
    """
    if not is_text(column.type):
        return _is_numeric(column.type)
    text = trimmed_text(column)
    return 2 * _count(pc.match_substring_regex(text, NUMBER_PATTERN)) > _count(
        pc.not_equal(text, "")
    )


def holds_times_of_day(column: Any) -> bool:
    """Whether most cells of a column that are not empty are times of day without a date.

    Examples
    --------
    >>> holds_times_of_day(pa.chunked_array([["8:00:00", "08:00:05"]])), holds_times_of_day(pa.chunked_array([["5"]]))
    (True, False)
    """
    if pa.types.is_time(column.type):
        return True
    if not is_text(column.type) or not _count(
        pc.match_substring_regex(trimmed_text(column.slice(0, 1000)), r"^\d{1,2}:\d{2}:\d{2}")
    ):
        return False
    text = trimmed_text(column)
    return 2 * _count(pc.match_substring_regex(text, r"^\d{1,2}:\d{2}:\d{2}")) > _count(
        pc.not_equal(text, "")
    )


def times_of_day_to_seconds(column: Any) -> Floats:
    """Turn times of day into seconds from midnight; NaN for what is none.

    Examples
    --------
    >>> times_of_day_to_seconds(pa.chunked_array([["00:01:00.5", ""]])).tolist()
    [60.5, nan]
    """
    return clock_to_seconds(trimmed_text(column))


def unit_seconds(unit: str) -> float:
    """Seconds in a unit of time that a user names.

    Raises
    ------
    OptionError
        If there is no such unit.

    Examples
    --------
    >>> unit_seconds("ms"), unit_seconds("excel")
    (0.001, 86400.0)
    """
    if unit not in _UNITS:
        raise OptionError(f"time unit {unit!r} is not one of {', '.join(_UNITS)}")
    return _UNITS[unit][0]


def unit_origin(unit: str | None) -> float:
    """Seconds from 1970 to the zero of a unit that a user names; 0 where none is named.

    Examples
    --------
    >>> unit_origin("ms"), unit_origin("excel")
    (0.0, -2209161600.0)
    """
    return 0.0 if unit is None else _UNITS[unit][1]


def unit_name(factor: float | None) -> str | None:
    """Name of the unit of so many seconds; None for none.

    Examples
    --------
    >>> unit_name(0.001), unit_name(None)
    ('ms', None)
    """
    return next(
        (name for name, (own, origin) in _UNITS.items() if own == factor and not origin), None
    )


def guess_unit_by_size(column: Any) -> str | None:
    """Unit that the size of most numbers in a column tells; None where it holds dates.

    Examples
    --------
    >>> guess_unit_by_size(pa.chunked_array([[1700000000077]])), guess_unit_by_size(pa.chunked_array([["2024-05-04"]]))
    ('ms', None)
    """
    if not holds_numbers(column) or _is_compact(column):
        return None
    values = to_floats(column)
    values = np.abs(values[np.isfinite(values)])
    size = float(np.median(values)) if len(values) else 0.0
    return next(unit for top, unit in _UNIT_BY_SIZE if size <= top)


def _is_numeric(kind: Any) -> bool:
    return bool(
        pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_decimal(kind)
        or pa.types.is_null(kind)
    )


def _count(flags: Any) -> int:
    return int(pc.sum(flags).as_py() or 0)


def _is_compact(column: Any) -> bool:
    """Whether all numbers are dates without marks, such as 20240504080000."""
    if pa.types.is_floating(column.type) or not len(column):
        return False
    text = trimmed_text(column)
    return (
        _count(pc.match_substring_regex(text, _COMPACT))
        == _count(pc.match_substring_regex(text, NUMBER_PATTERN))
        > 0
    )


def _ticks_to_seconds(column: Any) -> Floats:
    ticks = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[column.type.unit]
    whole, part = np.divmod(pc.fill_null(pc.cast(column, pa.int64()), 0).to_numpy(), ticks)
    result: Floats = whole + part / ticks
    result[pc.is_null(column).to_numpy()] = np.nan
    return result


def _scale_to_seconds(column: Any, unit: float, origin: float) -> Floats:
    """Seconds of numbers in a unit."""
    plain = to_floats(column)
    if unit == 1 and not origin:
        return plain

    # Days have an origin, and seconds rounded as spreadsheets do.
    if unit > 1:
        days = (plain + origin / unit) * unit
        return np.round(days, _EXCEL_DECIMALS) if origin else days

    # Parts of seconds are split from whole ones, which is exact beyond 2**53.
    ticks = round(1 / unit)
    if pa.types.is_integer(column.type) and not column.null_count:
        whole, part = np.divmod(pc.cast(column, pa.int64(), safe=False).to_numpy(), ticks)
        exact: Floats = whole + part / ticks
        return exact
    scaled: Floats = plain / ticks
    return scaled
