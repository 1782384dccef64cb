"""The times of a table, from one column or two."""

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
from gpszip.io.values.dates import DATE_ORDERS
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

#: So many rows tell whether numbers are times of day.
_MIN_CLOCK_ROWS = 10

#: Letters of a cell in messages.
_MAX_SHOWN_LETTERS = 80


@dataclass(frozen=True, eq=False)
class TimeColumn:
    """Times of a table, and what is to be known of them.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds; NaN where there is no time.
    guessed_unit : Guess, optional
        The unit of numbers, where the user doesn't say it.
    time_of_day : bool
        Whether they count from midnight, as there is no date.
    repairs : tuple of Repair
        What is to be told of them.
    unreadable : tuple of Unread
        The first cell that is no time.
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
        At least those that hold the time.
    names : sequence of str
        Names of all the table's columns.
    roles : Roles
        Which column is what.
    request : Request
        The unit of numbers and the order of dates.
    where : str
        Name of the log.
    decimal_comma : bool, default False
        Whether text writes 1,5 for one and a half.

    Raises
    ------
    InputError
        If no cell is a time, or dates can be read in several ways.
    """
    # Times of day count from midnight.
    name = names[roles.time[-1]]
    column = f"{where}: column {name!r}"
    cells = join_time_columns(columns, names, roles, request, where, decimal_comma=decimal_comma)
    if holds_times_of_day(cells):
        times = times_of_day_to_seconds(cells)
        told = Repair(
            "times of day without a date read as seconds from midnight",
            int(np.isfinite(times).sum()),
            column,
            drops=False,
        )
        return TimeColumn(
            times,
            time_of_day=True,
            repairs=(told,),
            unreadable=_first_unreadable(name, cells, times),
        )

    # Numbers are in the unit that the user says, or else the column's name, or else their size.
    guess = _guess_unit(cells, name) if request.time_unit is None else None
    if guess is not None and guess.unit == "s" and not guess.from_name:
        _refuse_clock_numbers(cells, column)
    unit = request.time_unit if guess is None else guess.unit
    factor = None if unit is None else unit_seconds(unit)
    times = times_to_seconds(
        cells,
        factor,
        column,
        origin=unit_origin(unit),
        dates=find_date_order(names, roles, request),
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
    """Return the column of times as one: a date and a time of day are joined, and 1,5 becomes 1.5 where text writes numbers so."""
    parts = [_unwrap_column(columns[i], f"{where}: column {names[i]!r}") for i in roles.time]
    cells = parts[-1]
    if len(parts) == 2:
        name = names[roles.time[-1]]
        cells = join_date_and_time(
            parts[0],
            cells,
            f"{where}: column {name!r}",
            numbers_are_seconds=request.time_unit is not None,
        )
    if decimal_comma and is_text(cells.type):
        cells = pc.replace_substring(trimmed_text(cells), ",", ".")
    return cells


def _unwrap_column(column: Any, where: str) -> Any:
    """Return a column without the wrapping of its type: dictionaries, extensions, and text as bytes, as in old Parquet files."""
    kind = column.type
    if isinstance(kind, pa.BaseExtensionType):
        column, kind = pc.cast(column, kind.storage_type), kind.storage_type
    if pa.types.is_dictionary(kind):
        column, kind = pc.cast(column, kind.value_type), kind.value_type
    if not (pa.types.is_binary(kind) or pa.types.is_large_binary(kind)):
        return column
    try:
        return pc.cast(column, pa.string())
    except pa.ArrowInvalid:
        raise InputError(
            f"{where} holds bytes that are no text; name another with --columns t=COLUMN"
        ) from None


def find_date_order(names: Sequence[str], roles: Roles, request: Request) -> str | None:
    """Order of day, month and year that the user names, or else the column: ``Date (DD/MM/YYYY)`` is ``dmy``.

    Raises
    ------
    OptionError
        If the user names none that exists.
    """
    if request.dates is not None:
        if request.dates not in DATE_ORDERS:
            raise OptionError(
                f"order of dates {request.dates!r} is not one of {', '.join(DATE_ORDERS)}"
            )
        return request.dates
    found = re.search(
        r"(?i)(?<![a-z])(d{1,2}|m{1,2}|y{2,4})[-/. ]?(d{1,2}|m{1,2})[-/. ]?(d{1,2}|y{2,4})(?![a-z])",
        names[roles.time[0]],
    )
    order = "".join(part[0].lower() for part in found.groups()) if found else ""
    return order if order in DATE_ORDERS else None


def _refuse_clock_numbers(cells: Any, where: str) -> None:
    """Refuse numbers that are hours, minutes and seconds rather than seconds: 80059 is followed by 80100, not by 80060."""
    values = to_floats(cells)
    values = values[np.isfinite(values)]
    hours, minutes, secs = values // 10_000, values // 100 % 100, values % 100
    if (
        len(values) < _MIN_CLOCK_ROWS
        or not ((values >= 0) & (hours < 24) & (minutes < 60) & (secs < 60)).all()
    ):
        return
    clock = 3600 * hours + 60 * minutes + secs
    as_seconds, as_clock = (
        len(np.unique(np.round(np.diff(times), 3))) for times in (values, clock)
    )
    padded = (
        is_text(cells.type)
        and pc.any(pc.match_substring_regex(trimmed_text(cells), r"^0\d{5}(\D|$)")).as_py()
    )
    if as_clock < as_seconds or padded:
        first = f"{int(values[0]):06d}"
        raise InputError(
            f"{where}: {first} and the numbers after it step like hours, minutes and seconds, not like seconds; "
            f"write {first[:2]}:{first[2:4]}:{first[4:]}, or say that they are seconds: --time-unit s"
        )


def _guess_unit(cells: Any, name: str) -> GuessedUnit | None:
    """Return the unit of numbers that the name of their column tells, or else their size."""
    named = unit_name(time_unit_in_name(name))
    unit = (named if holds_numbers(cells) else None) or guess_unit_by_size(cells)
    return None if unit is None else GuessedUnit(unit, from_name=named is not None)


def _first_unreadable(
    name: str, cells: Any, times: NDArray[np.float64]
) -> tuple[UnreadableCell, ...]:
    """Return the first cell that holds something, but no time."""
    bad = np.isnan(times)
    if bad.any():
        bad &= pc.fill_null(pc.not_equal(trimmed_text(cells), ""), False).to_numpy()
    if not bad.any():
        return ()
    row = int(bad.argmax())
    return (UnreadableCell(name, row, str(cells[row].as_py())[:_MAX_SHOWN_LETTERS]),)
