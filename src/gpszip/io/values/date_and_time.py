"""A date and a time of day in two columns, joined to one column."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from gpszip.errors import InputError
from gpszip.io.values.arrow import NUMBER_PATTERN, to_floats, trimmed_text

__all__ = ["join_date_and_time"]

#: The smallest number that is a time of day with an hour, written hhmmss without leading zeros.
_ONE_O_CLOCK = 10_000

#: How a time of day with colons begins.
_CLOCK = r"^\d{1,2}:\d{2}"

#: Six digits with a leading zero, and no more before the point: certainly hhmmss, not seconds.
_PADDED_CLOCK = r"^0\d{5}(\D|$)"


def join_date_and_time(
    date: Any, time: Any, path: str, location: str, *, numbers_are_seconds: bool = False
) -> Any:
    """Join a date and a time of day.

    Times of day are written with colons (``8:00:00``) or as numbers of hours, minutes and seconds
    (``80000``, ``080000.5``). A column of times that includes dates, or of seconds, is returned
    unchanged.

    Parameters
    ----------
    date : pyarrow.ChunkedArray
        Dates: text, numbers such as 20240504, or Arrow's dates and timestamps.
    time : pyarrow.ChunkedArray
        Times of day: text, numbers, or Arrow's times.
    path, location : str
        Name of the log, and its column of times, for messages.
    numbers_are_seconds : bool, default False
        Whether the user has said that numbers are seconds and no times of day.

    Returns
    -------
    pyarrow.ChunkedArray
        Texts such as ``2024-05-04 08:00:00``, or the column of times unchanged.

    Raises
    ------
    InputError
        If numbers can be both seconds and times of day.

    Examples
    --------
    >>> date, time = pa.chunked_array([[20240504]]), pa.chunked_array([[80000]])
    >>> join_date_and_time(date, time, "a.csv", "time").to_pylist()
    ['20240504 08:00:00']
    """
    # Write times of day with colons.
    clocks = _text(time)
    if not pc.any(pc.match_substring_regex(clocks, _CLOCK)).as_py():
        if numbers_are_seconds or not _are_times_of_day(clocks, path, location):
            return time
        clocks = _with_colons(clocks)

    # Separate the numbers of dates such as 40524. Spreadsheets add midnight to dates; drop it.
    days = pc.replace_substring_regex(_text(date), r"[T\s]+\d{1,2}:\d{2}.*$", "")
    days = pc.replace_substring_regex(days, r"^(\d)(\d{2})(\d{2})$", r"0\1-\2-\3")
    days = pc.replace_substring_regex(days, r"^(\d{2})(\d{2})(\d{2})$", r"\1-\2-\3")

    # A cell that is no time of day may include its date.
    return pc.if_else(
        pc.match_substring_regex(clocks, _CLOCK),
        pc.binary_join_element_wise(days, clocks, " "),
        clocks,
    )


def _text(column: Any) -> Any:
    """Text of a column, with integral numbers written without decimals."""
    # Integers beside missing cells are often stored as floats, but 20240504.0 is no date.
    if pa.types.is_floating(column.type) and pc.all(pc.equal(column, pc.floor(column))).as_py():
        column = pc.cast(column, pa.int64(), safe=False)
    return trimmed_text(column)


def _are_times_of_day(text: Any, path: str, location: str) -> bool:
    """Whether all numbers can be hours, minutes and seconds, and can't be seconds.

    Raises
    ------
    InputError
        If they can be both.
    """
    # Each of them must be a time of day.
    text = text.filter(pc.match_substring_regex(text, NUMBER_PATTERN))
    values = to_floats(text)
    hours, minutes, secs = values // 10_000, values // 100 % 100, values % 100
    if not len(values) or not ((values >= 0) & (hours < 24) & (minutes < 60) & (secs < 61)).all():
        return False

    # Six digits with a leading zero, or hours, are no seconds.
    is_padded = pc.any(pc.match_substring_regex(text, _PADDED_CLOCK)).as_py()
    if is_padded or values.max() >= _ONE_O_CLOCK:
        return True

    # Below a minute, both mean the same. Above it, the numbers are ambiguous.
    if values.max() < 60:
        return False
    cell = text[int((values >= 60).argmax())].as_py()
    raise InputError(
        f"{cell!r} can be seconds or hhmmss",
        path=path,
        location=location,
        remedy="if seconds, say so: --time-unit s; else write 00:01:00 or 000100",
    )


def _with_colons(text: Any) -> Any:
    """Write 80000.5 as 08:00:00.5."""
    # Pad the digits before the point to hhmmss, and cut them into pairs.
    digits = pc.utf8_lpad(pc.replace_substring_regex(text, r"\..*$", ""), 6, "0")
    fraction = pc.replace_substring_regex(text, r"^\d*\.?", ".")
    clock = pc.replace_substring_regex(digits, r"^(\d{2})(\d{2})(\d{2})$", r"\1:\2:\3")
    # Without a fraction, what is left is the point alone.
    with_fraction = pc.binary_join_element_wise(clock, fraction, "")
    clock = pc.if_else(pc.equal(fraction, "."), clock, with_fraction)
    return pc.if_else(pc.match_substring_regex(text, NUMBER_PATTERN), clock, text)
