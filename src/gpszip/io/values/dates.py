"""Dates and times of day written as text: ISO 8601, RFC 2822, month names, and days and months in any order."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["DATE_ORDERS", "DateOrders", "clock_to_seconds", "dates_to_seconds", "find_date_orders"]

#: Orders of day, month and year that people write, in the order in which messages name them.
DATE_ORDERS = ("dmy", "mdy", "ymd")

#: Seconds of a day.
_DAY = 86400

#: Seconds from 1970 to the start of year 1, before which there is no date.
_YEAR_1 = -62_135_596_800.0

#: Years of two digits up to this one belong to this century, as POSIX has it.
_LAST_SHORT_YEAR = 68

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")

# Regular expressions, first the parts that several have.
_SECOND = r":(?P<second>\d{2})(?:[.,](?P<fraction>\d+))?"
_HALF = r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
_CLOCK = rf"(?P<hour>\d{{1,2}}):(?P<minute>\d{{2}})(?:{_SECOND})?{_HALF}"
_HOUR = rf"(?P<hour>\d{{1,2}})(?::(?P<minute>\d{{2}})(?:{_SECOND})?)?{_HALF}"
_REMARK = r"(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?"  # the name of the zone: the offset before it says all
_OFFSET = r"(?i:UTC|GMT)?(?P<sign>[+-])(?P<zone_hour>\d{2}):?(?P<zone_minute>\d{2})?"
_ZONE = rf"(?:\s*(?:{_OFFSET}|(?i:Z|UTC|GMT|UT)){_REMARK}|\s*\[(?i:Z|UTC|GMT|Etc/UTC)\])?"
_END = _ZONE + r"$"
_WEEKDAY = r"^(?:(?i:mon|tues?|wed(?:nes)?|thu(?:rs)?|fri|sat(?:ur)?|sun)(?i:day)?\.?,?\s+)?"
_LONG_MONTHS = (
    "january|february|march|april|june|july|august|september|sept|october|november|december"
)
_MONTH = rf"(?P<month>(?i:{_LONG_MONTHS}|{'|'.join(_MONTHS)}))\.?"
_DAY_OF_MONTH = r"(?P<day>\d{1,2})(?:st|nd|rd|th)?"
_LONG_OR_SHORT = r"\d{4}|\d{2}"

# The forms of dates.
_ISO = rf"^(?P<year>\d{{4}})[-/.:](?P<month>\d{{1,2}})[-/.:](?P<day>\d{{1,2}})(?:(?:[Tt]|,?\s+){_HOUR}{_ZONE})?$"
_DAY_FIRST = rf"{_WEEKDAY}{_DAY_OF_MONTH}[-.\s]+{_MONTH}[-,\s]+(?P<year>{_LONG_OR_SHORT})(?:[Tt,\s]\s*{_CLOCK})?{_END}"
_MONTH_FIRST = (
    rf"{_WEEKDAY}{_MONTH}\s+{_DAY_OF_MONTH},?\s+(?P<year>\d{{4}})(?:,?\s+(?:at\s+)?{_CLOCK})?{_END}"
)
_YEAR_LAST = rf"{_WEEKDAY}{_MONTH}\s+{_DAY_OF_MONTH}\s+{_CLOCK}{_ZONE}\s+(?P<year>\d{{4}})$"
_FORMS = (_ISO, _DAY_FIRST, _MONTH_FIRST, _YEAR_LAST)

# Those of three numbers, whose order only the column tells, and of times without a date.
_THREE_NUMBERS = rf"^(?P<a>\d{{1,2}})(?P<mark>[-/.])(?P<b>\d{{1,2}})[-/.](?P<c>{_LONG_OR_SHORT})(?:[Tt,\s]\s*{_CLOCK})?{_END}"
_TIME_OF_DAY = rf"^(?P<hour>\d{{1,2}}):(?P<minute>\d{{2}}){_SECOND}{_HALF}{_END}"

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class DateOrders:
    """In which orders of day, month and year the dates of a column can be read.

    Parameters
    ----------
    first : str
        The first cell with such a date, as ``03/04/2024``; empty where there is none.
    all_dotted : bool
        Whether all such dates have dots, as ``03.04.2024``, which are written with the day first wherever they are in use.
    counterexamples : mapping of str to str
        For each order in which some cell is no date, the first such cell.
    """

    first: str = ""
    all_dotted: bool = True
    counterexamples: Mapping[str, str] = field(default_factory=dict)

    def __or__(self, other: DateOrders) -> DateOrders:
        """Put together what two parts of a column tell, of which the other comes later."""
        return DateOrders(
            self.first or other.first,
            self.all_dotted and other.all_dotted,
            {**other.counterexamples, **self.counterexamples},
        )

    def decide(self, where: str) -> str:
        """Return the one order in which all can be read.

        Raises
        ------
        InputError
            If there are several, or none.

        Examples
        --------
        >>> find_date_orders(pa.chunked_array([["03/04/2024", "31/01/2024"]])).decide("a.csv")
        'dmy'
        >>> find_date_orders(pa.chunked_array([["03/04/2024"]])).decide("a.csv")
        Traceback (most recent call last):
        ...
        gpszip.errors.InputError: a.csv: '03/04/2024' can be 3 Apr 2024 or 4 Mar 2024; say which: --dates dmy or --dates mdy
        """
        orders = [order for order in DATE_ORDERS if order not in self.counterexamples]
        if self.all_dotted and "dmy" in orders:
            return "dmy"
        if len(orders) == 1:
            return orders[0]
        if not orders:
            cells = " and ".join(
                repr(cell) for cell in dict.fromkeys(self.counterexamples.values())
            )
            raise InputError(
                f"{where}: {cells} are in different orders of day and month; name the one that is right with --dates dmy|mdy|ymd"
            )
        readings = " or ".join(_format_date(self.first, order) for order in orders)
        remedy = " or ".join(f"--dates {order}" for order in orders)
        raise InputError(f"{where}: {self.first!r} can be {readings}; say which: {remedy}")


def dates_to_seconds(text: Any, order: str | None, where: str) -> Floats:
    """Turn dates, with or without a time of day, into seconds from 1970 in UTC.

    Parameters
    ----------
    text : pyarrow.ChunkedArray
        Texts without white space around them. Without a zone they are taken as UTC.
    order : str, optional
        ``dmy``, ``mdy`` or ``ymd`` for dates of three numbers; told from the column as a whole where left out.
    where : str
        Name of the log and column for messages.

    Returns
    -------
    float64 array, shape (n,)
        NaN for what is no date.

    Raises
    ------
    InputError
        If the column doesn't tell which number is the day, and no order is given.

    Examples
    --------
    >>> dates_to_seconds(pa.chunked_array([["1970-01-01T00:00:01.5Z", "1 Jan 1970 01:00:02 +0100", "1/13/70"]]), None, "a").tolist()
    [1.5, 2.0, 1036800.0]
    """
    with suppress(pa.ArrowInvalid):
        return _parse_plain_iso(text)

    # Read what is not plain ISO 8601 form by form, each on the cells that are left.
    text = _separate_digits(text)
    seconds = np.full(len(text), np.nan)
    for form in _FORMS:
        rows = np.flatnonzero(np.isnan(seconds))
        if not len(rows):
            break
        found = _Matches.of(text, form, rows)
        seconds[found.rows] = _days(
            _year(found, "year"), _month(found), found.number("day")
        ) * _DAY + _clock(found)

    # Dates of three numbers all have the same order.
    found = _Matches.of(text, _THREE_NUMBERS, np.flatnonzero(np.isnan(seconds)))
    if len(found.rows):
        order = order or _possible_orders(found).decide(where)
        seconds[found.rows] = _days_of_three(found, order) * _DAY + _clock(found)
    return seconds


def clock_to_seconds(text: Any) -> Floats:
    """Turn times of day, as ``08:00:00.5`` or ``8:00:00 AM``, into seconds of the day; NaN for what is none.

    Examples
    --------
    >>> clock_to_seconds(pa.chunked_array([["00:01:00.5", "12:00:00 AM", "01:00:00+01:00", "8 o'clock"]])).tolist()
    [60.5, 0.0, 0.0, nan]
    """
    seconds = np.full(len(text), np.nan)
    found = _Matches.of(text, _TIME_OF_DAY, np.arange(len(text)))
    seconds[found.rows] = _clock(found)
    return seconds


def find_date_orders(text: Any) -> DateOrders:
    """Find out in which orders the dates of three numbers in a column can be read, such as ``03/04/2024`` or ``3.4.24``.

    Parameters
    ----------
    text : pyarrow.ChunkedArray
        Texts without white space around them; those that are no such date are passed over.

    Examples
    --------
    >>> dict(find_date_orders(pa.chunked_array([["03/04/2024", "31/01/2024", "2024-01-31"]])).counterexamples)
    {'mdy': '31/01/2024', 'ymd': '03/04/2024'}
    """
    return _possible_orders(_Matches.of(text, _THREE_NUMBERS, np.arange(len(text))))


@dataclass(frozen=True)
class _Matches:
    """Cells of one form, and the texts of its groups.

    Parameters
    ----------
    rows : int array, shape (n,)
        Where the cells are in the column.
    cells : pyarrow.ChunkedArray
        The n cells as a whole.
    groups : pyarrow.ChunkedArray
        A struct of n texts for each group of the regular expression; one that matches nothing is empty.
    """

    rows: NDArray[np.intp]
    cells: Any
    groups: Any

    @classmethod
    def of(cls, text: Any, form: str, rows: NDArray[np.intp]) -> _Matches:
        """Look for a form in some rows of a column."""
        cells = text if len(rows) == len(text) else text.take(pa.array(rows))
        groups = pc.extract_regex(cells, form)
        fits = pc.is_valid(groups)
        return cls(rows[fits.to_numpy()], cells.filter(fits), groups.filter(fits))

    def text(self, name: str) -> Any:
        """Texts of a group; empty where the form has no such group."""
        if self.groups.type.get_field_index(name) < 0:
            return pa.chunked_array([pa.array([""] * len(self.rows), pa.string())])
        return pc.struct_field(self.groups, name)

    def number(self, name: str) -> Integers:
        """Whole numbers of a group; 0 where there is none."""
        text = self.text(name)
        numbers: Integers = pc.cast(
            pc.if_else(pc.equal(text, ""), "0", text), pa.int64()
        ).to_numpy()
        return numbers

    def width(self, name: str) -> NDArray[np.int32]:
        """Numbers of letters of a group."""
        widths: NDArray[np.int32] = pc.utf8_length(self.text(name)).to_numpy()
        return widths


def _separate_digits(text: Any) -> Any:
    """Put marks between the numbers of ISO 8601's basic format: ``20240504T080000``, ``20240504 0800``, ``20240504080000``."""
    if not pc.any(
        pc.match_substring_regex(text, r"^(\d{8}|\d{4}-\d{2}-\d{2}\s*[Tt]?\s*(\d{4}|[Tt\s]))")
    ).as_py():
        return text
    text = pc.replace_substring_regex(
        text, r"^(\d{4})(\d{2})(\d{2})(\d{6}(?:[.,]\d*)?$|\s*[Tt]|\s|$)", r"\1-\2-\3 \4"
    )
    text = pc.replace_substring_regex(
        text, r"^(\d{4}-\d{2}-\d{2})\s*[Tt]?\s*(\d{2})(\d{2})(\d{2})", r"\1 \2:\3:\4"
    )
    text = pc.replace_substring_regex(
        text, r"^(\d{4}-\d{2}-\d{2})\s*[Tt]?\s*(\d{2})(\d{2})([^:\d]|$)", r"\1 \2:\3\4"
    )
    return pc.utf8_trim_whitespace(
        pc.replace_substring_regex(text, r"^(\d{4}-\d{2}-\d{2})\s*[Tt]\s*", r"\1 ")
    )


def _parse_plain_iso(text: Any) -> Floats:
    """Read a column by Arrow's own parser, which refuses it as a whole for a cell that is not plain ISO 8601."""
    text = pc.if_else(pc.equal(text, ""), pa.scalar(None, pa.string()), text)
    try:
        moments = pc.cast(text, pa.timestamp("us"))
    except pa.ArrowInvalid:
        moments = pc.cast(text, pa.timestamp("us", "UTC"))
    whole, part = np.divmod(pc.fill_null(pc.cast(moments, pa.int64()), 0).to_numpy(), 10**6)
    seconds: Floats = whole + part / 10**6
    seconds[pc.is_null(moments).to_numpy() | (seconds < _YEAR_1)] = np.nan
    return seconds


def _possible_orders(found: _Matches) -> DateOrders:
    # A year has two digits or four, and one of four stands where it is seen.
    fits = {order: np.isfinite(_days_of_three(found, order)) for order in DATE_ORDERS}
    fits["ymd"] &= (found.width("a") == 2) & (found.width("c") == 2)

    # A cell that is no date in any order tells nothing.
    dates = np.logical_or.reduce(list(fits.values()))
    if not dates.any():
        return DateOrders()

    # Name the first cell against each order.
    against = {order: dates & ~good for order, good in fits.items()}
    cell = {
        order: str(found.cells[int(bad.argmax())].as_py())
        for order, bad in against.items()
        if bad.any()
    }
    dotted = pc.equal(found.text("mark"), ".").to_numpy()
    return DateOrders(
        str(found.cells[int(dates.argmax())].as_py()), bool(dotted[dates].all()), cell
    )


def _days_of_three(found: _Matches, order: str) -> Floats:
    """Days from 1970 to dates of three numbers in an order; NaN for what is no date."""
    group = dict(zip(order, "abc", strict=True))
    days = _days(_year(found, group["y"]), found.number(group["m"]), found.number(group["d"]))
    long_elsewhere = found.width("c") == 4 if group["y"] == "a" else np.zeros(len(days), np.bool_)
    days[long_elsewhere] = np.nan
    return days


def _year(found: _Matches, group: str) -> Integers:
    """Years, those of two digits in this century or the last."""
    year = found.number(group)
    century = np.where(year <= _LAST_SHORT_YEAR, 2000, 1900)
    return np.where(found.width(group) <= 2, year + century, year)


def _month(found: _Matches) -> Integers:
    """Months by number or by name."""
    text = pc.utf8_lower(found.text("month"))
    named = pc.index_in(pc.utf8_slice_codeunits(text, 0, 3), pa.array(_MONTHS))
    numbered = pc.cast(pc.if_else(pc.is_valid(named), "0", text), pa.int64())
    months: Integers = pc.if_else(
        pc.is_valid(named), pc.add(pc.cast(named, pa.int64()), 1), numbered
    ).to_numpy()
    return months


def _days(year: Integers, month: Integers, day: Integers) -> Floats:
    """Days from 1970 to dates; NaN for those that the calendar doesn't have."""
    # Count months and let NumPy's calendar turn them into days.
    months = ((year - 1970) * 12 + month - 1).astype("M8[M]")
    first, after = (one.astype("M8[D]").astype(np.int64) for one in (months, months + 1))

    good = (year >= 1) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= after - first)
    return np.where(good, first + day - 1.0, np.nan)


def _clock(found: _Matches) -> Floats:
    """Seconds of the day in UTC; NaN for times that no clock shows.

    Midnight may be 24:00:00. A leap second, 23:59:60, is the next midnight, as in POSIX; but in a column of whole seconds it is half a
    second before, so that it and 00:00:00 stay two times.
    """
    hour, minute, second = (found.number(name) for name in ("hour", "minute", "second"))
    digits = found.text("fraction")
    fraction = pc.cast(
        pc.binary_join_element_wise("0.", pc.if_else(pc.equal(digits, ""), "0", digits), ""),
        pa.float64(),
    ).to_numpy()

    # Check what a clock can show.
    half = pc.utf8_lower(found.text("half"))
    in_halves = pc.not_equal(half, "").to_numpy()
    good = (
        (minute <= 59)
        & (second <= 60)
        & np.where(in_halves, (hour >= 1) & (hour <= 12), hour <= 23)
    )
    good |= ~in_halves & (hour == 24) & (minute == 0) & (second == 0) & (fraction == 0)

    # Keep a leap second apart from the midnight that follows.
    if not fraction.any():
        fraction = np.where(second == 60, -0.5, 0.0)
    hour = np.where(in_halves, hour % 12 + 12 * pc.equal(half, "p").to_numpy(), hour)

    # Bring it to UTC.
    zone_hour, zone_minute = found.number("zone_hour"), found.number("zone_minute")
    good &= (zone_hour <= 23) & (zone_minute <= 59)
    offset = np.where(pc.equal(found.text("sign"), "-").to_numpy(), -60, 60) * (
        60 * zone_hour + zone_minute
    )
    return np.where(good, (3600 * hour + 60 * minute + second - offset) + fraction, np.nan)


def _format_date(cell: str, order: str) -> str:
    """Write out a date of three numbers as an order reads it, such as ``3 Apr 2024``."""
    found = _Matches.of(pa.chunked_array([[cell]]), _THREE_NUMBERS, np.arange(1))
    group = dict(zip(order, "abc", strict=True))
    year, month, day = (
        _year(found, group["y"])[0],
        found.number(group["m"])[0],
        found.number(group["d"])[0],
    )
    return f"{day} {_MONTHS[month - 1].title()} {year}"
