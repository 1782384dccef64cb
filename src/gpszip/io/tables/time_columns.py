"""The times of a table, from one column or from separate dates and times of day."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.io.logs.raw import GuessedUnit, Request, UnreadableCell
from gpszip.io.tables.roles import Roles, time_unit_in_name
from gpszip.io.values.arrow import is_text, to_floats, trimmed_text
from gpszip.io.values.date_and_time import join_date_and_time
from gpszip.io.values.dates import DATE_ORDERS, plain_iso_to_seconds
from gpszip.io.values.timestamps import (
    guess_unit_by_size,
    holds_numbers,
    holds_times_of_day,
    times_of_day_to_seconds,
    times_to_seconds,
    unit_name,
    unit_origin,
    unit_seconds,
)
from gpszip.model.read_result import Repair

__all__ = ["TimeColumn", "find_date_order", "join_time_columns", "read_times"]

#: Least number of rows that show whether numbers are times of day.
_MIN_CLOCK_ROWS = 10

#: Rows that are read as hours, minutes and seconds at a time.
_CLOCK_ROWS = 1 << 14

#: Midnight at the end of a day, as hours, minutes and seconds.
_CLOCK_END = 240_000

#: Number of letters of a cell that messages show.
_MAX_SHOWN_LETTERS = 80

#: Day, month and year in a column's name, such as ``Date (DD/MM/YYYY)``.
_ORDER_IN_NAME = (
    r"(?i)(?<![a-z])(d{1,2}|m{1,2}|y{2,4})[-/. ]?(d{1,2}|m{1,2})[-/. ]?(d{1,2}|y{2,4})(?![a-z])"
)

#: Six digits with a leading zero, as in 080059.
_PADDED_CLOCK = r"^0\d{5}(\D|$)"


@dataclass(frozen=True, eq=False)
class TimeColumn:
    """Times of a table, and how they were read.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds; NaN for cells that are no times.
    guessed_unit : GuessedUnit, optional
        Unit of numbers, if the user hasn't given it.
    time_of_day : bool
        Whether times count from midnight, because there is no date.
    repairs : tuple of Repair
        Repairs to report.
    unreadable : tuple of UnreadableCell
        The first cell that is no time; empty if there is none.
    """

    times: NDArray[np.float64]
    guessed_unit: GuessedUnit | None = None
    time_of_day: bool = False
    repairs: tuple[Repair, ...] = ()
    unreadable: tuple[UnreadableCell, ...] = ()


def read_times(
    columns: Mapping[int, Any],
    names: Sequence[str],
    roles: Roles,
    request: Request,
    where: str,
    *,
    decimal_comma: bool = False,
) -> TimeColumn:
    """Read the times of a table.

    Parameters
    ----------
    columns : mapping of int to pyarrow.ChunkedArray
        Columns by index, at least those of the time.
    names : sequence of str
        Names of all columns of the table.
    roles : Roles
        Roles of the columns.
    request : Request
        The unit of numbers and the order of dates.
    where : str
        Name of the log for messages.
    decimal_comma : bool, default False
        Whether text has decimal commas, as in 1,5.

    Raises
    ------
    InputError
        If no cell is a time, or dates are ambiguous.
    """
    # Join date and time of day if they have their own columns.
    name = names[roles.time[-1]]
    location = f"column {name!r}"
    cells = join_time_columns(columns, names, roles, request, where, decimal_comma=decimal_comma)

    # Most texts are dates in ISO 8601, which no other notation looks like.
    dates = find_date_order(names, roles, request)
    if is_text(cells.type):
        plain = plain_iso_to_seconds(trimmed_text(cells))
        if plain is not None and np.isfinite(plain).any():
            return TimeColumn(plain, unreadable=_first_unreadable(name, cells, plain))

    # Times of day count from midnight.
    if holds_times_of_day(cells):
        times = times_of_day_to_seconds(cells)
        repair = Repair(
            "times of day without a date read as seconds from midnight",
            int(np.isfinite(times).sum()),
            f"{where}: {location}",
            drops=False,
        )
        return TimeColumn(
            times,
            time_of_day=True,
            repairs=(repair,),
            unreadable=_first_unreadable(name, cells, times),
        )

    # The unit of numbers is given by the user, or else by the column's name, or else by their size.
    guess = _guess_unit(cells, name) if request.time_unit is None else None
    if guess is not None and guess.unit == "s" and not guess.from_name:
        _refuse_clock_numbers(cells, where, location)
    unit = request.time_unit if guess is None else guess.unit
    factor = None if unit is None else unit_seconds(unit)
    times = times_to_seconds(
        cells,
        factor,
        where,
        location,
        origin=unit_origin(unit),
        dates=dates,
    )
    return TimeColumn(times, guessed_unit=guess, unreadable=_first_unreadable(name, cells, times))


def join_time_columns(
    columns: Mapping[int, Any],
    names: Sequence[str],
    roles: Roles,
    request: Request,
    where: str,
    *,
    decimal_comma: bool = False,
) -> Any:
    """The column of times, joined from dates and times of day if these are separate.

    Parameters are those of :func:`read_times`. Decimal commas become points.
    """
    # Of two columns, the date comes first and the time of day last.
    time_columns = [_unwrap_column(columns[i], names[i], where) for i in roles.time]
    cells = time_columns[-1]
    if len(time_columns) == 2:
        name = names[roles.time[-1]]
        cells = join_date_and_time(
            time_columns[0],
            cells,
            where,
            f"column {name!r}",
            numbers_are_seconds=request.time_unit is not None,
        )
    # Where coordinates have decimal commas, so have times.
    if decimal_comma and is_text(cells.type):
        cells = pc.replace_substring(trimmed_text(cells), ",", ".")
    return cells


def _unwrap_column(column: Any, name: str, where: str) -> Any:
    """A column without dictionaries and extension types, and with bytes decoded as text."""
    kind = column.type
    if isinstance(kind, pa.BaseExtensionType):
        column, kind = pc.cast(column, kind.storage_type), kind.storage_type
    if pa.types.is_dictionary(kind):
        column, kind = pc.cast(column, kind.value_type), kind.value_type
    if not (pa.types.is_binary(kind) or pa.types.is_large_binary(kind)):
        return column

    # Old Parquet files have text as bytes.
    try:
        return pc.cast(column, pa.string())
    except pa.ArrowInvalid:
        raise InputError(
            f"column {name!r} holds bytes that are no text",
            path=where,
            remedy="name another with --columns t=COLUMN",
        ) from None


def find_date_order(names: Sequence[str], roles: Roles, request: Request) -> str | None:
    """Order of day, month and year, given by the user or else by the column's name, if at all.

    A column ``Date (DD/MM/YYYY)`` has the order ``dmy``. A table without times has none.

    Raises
    ------
    OptionError
        If the user has given an order that doesn't exist.
    """
    if request.dates is not None:
        if request.dates not in DATE_ORDERS:
            raise OptionError(
                f"order of dates {request.dates!r} is not one of {', '.join(DATE_ORDERS)}"
            )
        return request.dates

    if not roles.time:
        return None

    # The first letters of DD, MM and YYYY make `dmy`. Of two columns,
    # the first one is that of dates.
    match = re.search(_ORDER_IN_NAME, names[roles.time[0]])
    order = "".join(group[0].lower() for group in match.groups()) if match else ""
    return order if order in DATE_ORDERS else None


def _refuse_clock_numbers(cells: Any, where: str, location: str) -> None:
    """Refuse numbers that are hours, minutes and seconds (hhmmss) rather than seconds.

    In such numbers 80059 is followed by 80100. So regular times have more distinct steps when they
    are read as seconds.

    Raises
    ------
    InputError
        If numbers step like hhmmss, or have a leading zero.
    """
    # All of them must be possible times of day.
    values = to_floats(cells)
    values = values[np.isfinite(values)]
    clock = _read_clock_numbers(values)
    if len(values) < _MIN_CLOCK_ROWS or clock is None:
        return

    # Count the distinct steps of both readings.
    steps_as_seconds, steps_as_clock = (
        len(np.unique(np.round(np.diff(times), 3))) for times in (values, clock)
    )
    is_padded = (
        is_text(cells.type)
        and pc.any(pc.match_substring_regex(trimmed_text(cells), _PADDED_CLOCK)).as_py()
    )
    if steps_as_clock < steps_as_seconds or is_padded:
        first = f"{int(values[0]):06d}"
        raise InputError(
            f"{first} and the numbers after it step like hours, minutes and seconds, "
            "not like seconds",
            path=where,
            location=location,
            remedy=f"write {first[:2]}:{first[2:4]}:{first[4:]}, "
            "or say that they are seconds: --time-unit s",
        )


def _read_clock_numbers(values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the seconds since midnight of numbers hhmmss; None if one of them is none."""
    # Most columns show in their first rows that they hold something else.
    clock = np.empty(len(values))
    for first in range(0, len(values), _CLOCK_ROWS):
        rows = slice(first, first + _CLOCK_ROWS)
        part = values[rows]
        if part.min() < 0 or part.max() >= _CLOCK_END:
            return None
        hours, minutes, secs = part // 10_000, part // 100 % 100, part % 100
        if minutes.max() >= 60 or secs.max() >= 60:
            return None
        clock[rows] = 3600 * hours + 60 * minutes + secs
    return clock


def _guess_unit(cells: Any, name: str) -> GuessedUnit | None:
    """Guess the unit of numbers by the name of their column, or else by their size."""
    # A unit in the name is one of numbers: a column `time_s` may as well hold dates.
    named = unit_name(time_unit_in_name(name))
    unit = (named if holds_numbers(cells) else None) or guess_unit_by_size(cells)
    return None if unit is None else GuessedUnit(unit, from_name=named is not None)


def _first_unreadable(
    name: str, cells: Any, times: NDArray[np.float64]
) -> tuple[UnreadableCell, ...]:
    """The first cell that is neither empty nor a time, in a tuple; an empty tuple without one."""
    bad = np.isnan(times)
    if bad.any():
        bad &= pc.fill_null(pc.not_equal(trimmed_text(cells), ""), False).to_numpy()
    if not bad.any():
        return ()
    row = int(bad.argmax())
    return (UnreadableCell(name, row, str(cells[row].as_py())[:_MAX_SHOWN_LETTERS]),)
