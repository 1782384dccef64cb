"""A date and a time of day in two columns, joined to one."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from gpszip.errors import InputError
from gpszip.io.values.arrow import NUMBER_PATTERN, to_floats, trimmed_text

__all__ = ["join_date_and_time"]

#: The first number that can be a time of day with an hour in it, written hhmmss without zeros before it.
_ONE_O_CLOCK = 10_000

#: What a time of day begins with.
_CLOCK = r"^\d{1,2}:\d{2}"


def join_date_and_time(
    date: Any, time: Any, where: str, *, numbers_are_seconds: bool = False
) -> Any:
    """Join a date and a time of day.

    The time of day is written with colons (``8:00:00``) or as a number of hours, minutes and seconds (``80000``,
    ``080000.5``). A column of times that hold their dates, or of seconds, stands for itself.

    Parameters
    ----------
    date : pyarrow.ChunkedArray
        Dates: text, numbers such as 20240504, or Arrow's dates and timestamps.
    time : pyarrow.ChunkedArray
        Times of day: text, numbers, or Arrow's times.
    where : str
        Name of the log and column for messages.
    numbers_are_seconds : bool, default False
        Whether numbers are no times of day, as the user says.

    Returns
    -------
    pyarrow.ChunkedArray
        Texts such as ``2024-05-04 08:00:00``, or the column of times as it was.

    Raises
    ------
    InputError
        If numbers can be both seconds and times of day.

    Examples
    --------
    >>> join_date_and_time(pa.chunked_array([[20240504]]), pa.chunked_array([[80000]]), "a.csv").to_pylist()
    ['20240504 08:00:00']
    """
    # Bring times of day to one form.
    clocks = _text(time)
    if not pc.any(pc.match_substring_regex(clocks, _CLOCK)).as_py():
        if numbers_are_seconds or not _are_times_of_day(clocks, where):
            return time
        clocks = _with_colons(clocks)

    # Set the numbers of dates apart. Spreadsheets give dates a time of day, midnight.
    days = pc.replace_substring_regex(_text(date), r"[T\s]+\d{1,2}:\d{2}.*$", "")
    days = pc.replace_substring_regex(days, r"^(\d)(\d{2})(\d{2})$", r"0\1-\2-\3")
    days = pc.replace_substring_regex(days, r"^(\d{2})(\d{2})(\d{2})$", r"\1-\2-\3")

    # A cell that is no time of day may hold its date, too.
    return pc.if_else(
        pc.match_substring_regex(clocks, _CLOCK),
        pc.binary_join_element_wise(days, clocks, " "),
        clocks,
    )


def _text(column: Any) -> Any:
    """Text of a column; whole numbers have no decimals."""
    if pa.types.is_floating(column.type) and pc.all(pc.equal(column, pc.floor(column))).as_py():
        column = pc.cast(column, pa.int64(), safe=False)
    return trimmed_text(column)


def _are_times_of_day(text: Any, where: str) -> bool:
    """Whether all numbers can be hours, minutes and seconds and can't be seconds."""
    # Is each of them a time of day?
    text = text.filter(pc.match_substring_regex(text, NUMBER_PATTERN))
    values = to_floats(text)
    hours, minutes, secs = values // 10_000, values // 100 % 100, values % 100
    if not len(values) or not ((values >= 0) & (hours < 24) & (minutes < 60) & (secs < 61)).all():
        return False

    # Six digits with a zero before them, or hours, are no seconds; less than a minute is the same in both.
    if (
        pc.any(pc.match_substring_regex(text, r"^0\d{5}(\D|$)")).as_py()
        or values.max() >= _ONE_O_CLOCK
    ):
        return True
    if values.max() < 60:
        return False
    cell = text[int((values >= 60).argmax())].as_py()
    raise InputError(
        f"{where}: {cell!r} can be seconds or hhmmss; if seconds, say so: --time-unit s; else write 00:01:00 or 000100"
    )


def _with_colons(text: Any) -> Any:
    """Write 80000.5 as 08:00:00.5."""
    whole = pc.utf8_lpad(pc.replace_substring_regex(text, r"\..*$", ""), 6, "0")
    part = pc.replace_substring_regex(text, r"^\d*\.?", ".")
    clock = pc.replace_substring_regex(whole, r"^(\d{2})(\d{2})(\d{2})$", r"\1:\2:\3")
    clock = pc.if_else(pc.equal(part, "."), clock, pc.binary_join_element_wise(clock, part, ""))
    return pc.if_else(pc.match_substring_regex(text, NUMBER_PATTERN), clock, text)
