"""Dates and times of day as text: ISO 8601, RFC 2822, month names, and numbers in any order."""

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

__all__ = [
    "DATE_ORDERS",
    "DateOrders",
    "clock_to_seconds",
    "dates_to_seconds",
    "find_date_orders",
    "plain_iso_to_seconds",
]

#: Orders of day, month and year, in the order in which messages list them.
DATE_ORDERS = ("dmy", "mdy", "ymd")

#: Seconds in a day.
_DAY = 86400

#: Start of year 1 in seconds since 1970; earlier dates are not supported.
_YEAR_1 = -62_135_596_800.0

#: Two-digit years up to this one belong to the 21st century, later ones to the 20th (POSIX).
_LAST_SHORT_YEAR = 68

#: Names of the months.
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")

# Regular expressions: first the components that several forms share.
_SECOND = r":(?P<second>\d{2})(?:[.,](?P<fraction>\d+))?"
_HALF = r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
_CLOCK = rf"(?P<hour>\d{{1,2}}):(?P<minute>\d{{2}})(?:{_SECOND})?{_HALF}"
_HOUR = rf"(?P<hour>\d{{1,2}})(?::(?P<minute>\d{{2}})(?:{_SECOND})?)?{_HALF}"
_REMARK = r"(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?"  # name of the zone, redundant after an offset
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
_ISO_DATE = r"(?P<year>\d{4})[-/.:](?P<month>\d{1,2})[-/.:](?P<day>\d{1,2})"
_TIME_AFTER = rf"(?:[Tt,\s]\s*{_CLOCK})?"

# 2024-01-31T12:00:00Z
_ISO = rf"^{_ISO_DATE}(?:(?:[Tt]|,?\s+){_HOUR}{_ZONE})?$"

# Wed, 31 Jan 2024 12:00:00 +0000
_DAY_FIRST = (
    rf"{_WEEKDAY}{_DAY_OF_MONTH}[-.\s]+{_MONTH}[-,\s]+(?P<year>{_LONG_OR_SHORT})"
    rf"{_TIME_AFTER}{_END}"
)

# January 31, 2024 at 12:00 PM
_MONTH_FIRST = (
    rf"{_WEEKDAY}{_MONTH}\s+{_DAY_OF_MONTH},?\s+(?P<year>\d{{4}})(?:,?\s+(?:at\s+)?{_CLOCK})?{_END}"
)

# Wed Jan 31 12:00:00 UTC 2024
_YEAR_LAST = rf"{_WEEKDAY}{_MONTH}\s+{_DAY_OF_MONTH}\s+{_CLOCK}{_ZONE}\s+(?P<year>\d{{4}})$"
_FORMS = (_ISO, _DAY_FIRST, _MONTH_FIRST, _YEAR_LAST)

# 31/01/2024 12:00, whose order only the column shows.
_THREE_NUMBERS = (
    rf"^(?P<a>\d{{1,2}})(?P<mark>[-/.])(?P<b>\d{{1,2}})[-/.](?P<c>{_LONG_OR_SHORT})"
    rf"{_TIME_AFTER}{_END}"
)

# 12:00:00, without a date.
_TIME_OF_DAY = rf"^(?P<hour>\d{{1,2}}):(?P<minute>\d{{2}}){_SECOND}{_HALF}{_END}"

# The basic format of ISO 8601: 20240131T1200, or 2024-01-31T1200.
_BASIC_FORMAT = r"^(\d{8}|\d{4}-\d{2}-\d{2}\s*[Tt]?\s*(\d{4}|[Tt\s]))"

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class DateOrders:
    """Possible orders of day, month and year in the dates of a column.

    Parameters
    ----------
    first : str
        The first cell with a date of three numbers, such as ``03/04/2024``; empty if there is none.
    all_dotted : bool
        Whether all these dates have dots, such as ``03.04.2024``. Dates with dots have the day
        first in all countries that use them.
    counterexamples : mapping of str to str
        For each order in which some cell is no date, the first such cell.
    """

    first: str = ""
    all_dotted: bool = True
    counterexamples: Mapping[str, str] = field(default_factory=dict)

    def __or__(self, other: DateOrders) -> DateOrders:
        """Combine the results of two consecutive slices of a column."""
        # The slices are consecutive, so what this one found comes first.
        return DateOrders(
            self.first or other.first,
            self.all_dotted and other.all_dotted,
            {**other.counterexamples, **self.counterexamples},
        )

    def decide(self, path: str, location: str) -> str:
        """Return the only order in which all dates can be read.

        Parameters
        ----------
        path, location : str
            Name of the log, and its column, for messages.

        Raises
        ------
        InputError
            If there are several orders, or none.

        Examples
        --------
        >>> find_date_orders(pa.chunked_array([["03/04/2024", "31/01/2024"]])).decide("a.csv", "d")
        'dmy'
        >>> find_date_orders(pa.chunked_array([["03/04/2024"]])).decide("a.csv", "d")
        Traceback (most recent call last):
        ...
        gpszip.errors.InputError: a.csv: d: '03/04/2024' can be 3 Apr 2024 or 4 Mar 2024; ...
        """
        # Choose the only order that remains; dates with dots have the day first.
        orders = [order for order in DATE_ORDERS if order not in self.counterexamples]
        if self.all_dotted and "dmy" in orders:
            return "dmy"
        if len(orders) == 1:
            return orders[0]

        # No order fits all cells.
        if not orders:
            cells = " and ".join(map(repr, dict.fromkeys(self.counterexamples.values())))
            raise InputError(
                f"{cells} are in different orders of day and month",
                path=path,
                location=location,
                remedy="name the right order with --dates dmy|mdy|ymd",
            )

        # Several do.
        readings = " or ".join(_format_date(self.first, order) for order in orders)
        options = " or ".join(f"--dates {order}" for order in orders)
        raise InputError(
            f"{self.first!r} can be {readings}",
            path=path,
            location=location,
            remedy=f"say which: {options}",
        )


def dates_to_seconds(text: Any, order: str | None, path: str, location: str) -> Floats:
    """Turn dates, with or without a time of day, into seconds from 1970 in UTC.

    Parameters
    ----------
    text : pyarrow.ChunkedArray
        Texts without surrounding white space. Without a time zone they are taken as UTC.
    order : str, optional
        Order of dates of three numbers: ``dmy``, ``mdy`` or ``ymd``; by default found from all
        cells of the column.
    path, location : str
        Name of the log, and its column, for messages.

    Returns
    -------
    float64 array, shape (n,)
        NaN for cells that are no dates.

    Raises
    ------
    InputError
        If the order of day and month is ambiguous and not given.

    Examples
    --------
    >>> cells = ["1970-01-01T00:00:01.5Z", "1 Jan 1970 01:00:02 +0100", "1/13/70"]
    >>> dates_to_seconds(pa.chunked_array([cells]), None, "a.csv", "day").tolist()
    [1.5, 2.0, 1036800.0]
    """
    # Plain ISO 8601 is the most frequent form, and fast.
    plain = plain_iso_to_seconds(text)
    if plain is not None:
        return plain

    # Read other dates form by form, each on the remaining cells.
    text = _separate_digits(text)
    seconds = np.full(len(text), np.nan)
    for form in _FORMS:
        rows = np.flatnonzero(np.isnan(seconds))
        if not len(rows):
            break
        matches = _Matches.of(text, form, rows)
        days = _days(_year(matches, "year"), _month(matches), matches.number("day"))
        seconds[matches.rows] = days * _DAY + _clock(matches)

    # Dates of three numbers all have the same order.
    matches = _Matches.of(text, _THREE_NUMBERS, np.flatnonzero(np.isnan(seconds)))
    if len(matches.rows):
        order = order or _possible_orders(matches).decide(path, location)
        seconds[matches.rows] = _days_of_three(matches, order) * _DAY + _clock(matches)
    return seconds


def clock_to_seconds(text: Any) -> Floats:
    """Turn times of day, such as ``08:00:00.5`` or ``8:00:00 AM``, into seconds since midnight.

    Cells that are no times of day become NaN.

    Examples
    --------
    >>> cells = ["00:01:00.5", "12:00:00 AM", "01:00:00+01:00", "8 o'clock"]
    >>> clock_to_seconds(pa.chunked_array([cells])).tolist()
    [60.5, 0.0, 0.0, nan]
    """
    seconds = np.full(len(text), np.nan)
    matches = _Matches.of(text, _TIME_OF_DAY, np.arange(len(text)))
    seconds[matches.rows] = _clock(matches)
    return seconds


def find_date_orders(text: Any) -> DateOrders:
    """Find the possible orders of dates of three numbers, such as ``03/04/2024`` or ``3.4.24``.

    Parameters
    ----------
    text : pyarrow.ChunkedArray
        Texts without surrounding white space; cells without such a date are ignored.

    Examples
    --------
    >>> cells = pa.chunked_array([["03/04/2024", "31/01/2024", "2024-01-31"]])
    >>> dict(find_date_orders(cells).counterexamples)
    {'mdy': '31/01/2024', 'ymd': '03/04/2024'}
    """
    return _possible_orders(_Matches.of(text, _THREE_NUMBERS, np.arange(len(text))))


@dataclass(frozen=True)
class _Matches:
    """Cells that match a form, and the texts of its groups.

    Parameters
    ----------
    rows : int array, shape (n,)
        Row of each cell in the column.
    cells : pyarrow.ChunkedArray, shape (n,)
        The complete cells.
    groups : pyarrow.ChunkedArray, shape (n,)
        Structs with a text for each group of the regular expression; empty if it matches nothing.
    """

    rows: NDArray[np.intp]
    cells: Any
    groups: Any

    @classmethod
    def of(cls, text: Any, form: str, rows: NDArray[np.intp]) -> _Matches:
        """Match some rows of a column with a form."""
        cells = text if len(rows) == len(text) else text.take(pa.array(rows))
        groups = pc.extract_regex(cells, form)
        fits = pc.is_valid(groups)
        return cls(rows[fits.to_numpy()], cells.filter(fits), groups.filter(fits))

    def text(self, name: str) -> Any:
        """Texts of a group; empty if the form has no such group."""
        if self.groups.type.get_field_index(name) < 0:
            return pa.chunked_array([pa.array([""] * len(self.rows), pa.string())])
        return pc.struct_field(self.groups, name)

    def number(self, name: str) -> Integers:
        """Integers of a group; 0 where it is empty."""
        text = self.text(name)
        digits = pc.if_else(pc.equal(text, ""), "0", text)
        numbers: Integers = pc.cast(digits, pa.int64()).to_numpy()
        return numbers

    def width(self, name: str) -> NDArray[np.int32]:
        """Number of letters of a group in each cell."""
        widths: NDArray[np.int32] = pc.utf8_length(self.text(name)).to_numpy()
        return widths


def _separate_digits(text: Any) -> Any:
    """Insert marks between the numbers of ISO 8601's basic format.

    ``20240504T080000``, ``20240504 0800`` and ``20240504080000`` become ``2024-05-04 08:00:00`` and
    the like.
    """
    # A column without the basic format needs none of these patterns.
    if not pc.any(pc.match_substring_regex(text, _BASIC_FORMAT)).as_py():
        return text

    # The date.
    text = pc.replace_substring_regex(
        text, r"^(\d{4})(\d{2})(\d{2})(\d{6}(?:[.,]\d*)?$|\s*[Tt]|\s|$)", r"\1-\2-\3 \4"
    )

    # The time of day with seconds, then without.
    text = pc.replace_substring_regex(
        text, r"^(\d{4}-\d{2}-\d{2})\s*[Tt]?\s*(\d{2})(\d{2})(\d{2})", r"\1 \2:\3:\4"
    )
    text = pc.replace_substring_regex(
        text, r"^(\d{4}-\d{2}-\d{2})\s*[Tt]?\s*(\d{2})(\d{2})([^:\d]|$)", r"\1 \2:\3\4"
    )

    # The T between date and time.
    text = pc.replace_substring_regex(text, r"^(\d{4}-\d{2}-\d{2})\s*[Tt]\s*", r"\1 ")
    return pc.utf8_trim_whitespace(text)


def plain_iso_to_seconds(text: Any) -> Floats | None:
    """Parse a column with Arrow's own parser.

    Parameters
    ----------
    text : pyarrow.ChunkedArray, shape (n,)
        Texts without surrounding white space.

    Returns
    -------
    float64 array, shape (n,), or None
        Seconds since 1970, NaN for empty cells; None if some cell is not plain ISO 8601.

    Examples
    --------
    >>> plain_iso_to_seconds(pa.chunked_array([["1970-01-01T00:00:01.5Z", ""]])).tolist()
    [1.5, nan]
    >>> plain_iso_to_seconds(pa.chunked_array([["1970-01-01", "5"]])) is None
    True
    """
    # Without a time zone, and with one.
    is_empty = pc.equal(text, "")
    if pc.any(is_empty).as_py():
        text = pc.if_else(is_empty, pa.scalar(None, pa.string()), text)
    for kind in (pa.timestamp("us"), pa.timestamp("us", "UTC")):
        with suppress(pa.ArrowInvalid):
            timestamps = pc.cast(text, kind)
            break
    else:
        return None

    # Divide before adding, so that no precision is lost.
    ticks = pc.fill_null(pc.cast(timestamps, pa.int64()), 0).to_numpy()
    whole_seconds, microseconds = np.divmod(ticks, 10**6)
    seconds: Floats = whole_seconds + microseconds / 10**6
    seconds[pc.is_null(timestamps).to_numpy() | (seconds < _YEAR_1)] = np.nan
    return seconds


def _possible_orders(matches: _Matches) -> DateOrders:
    """The orders in which dates of three numbers can be read."""
    # A year has two digits or four, and a year of four digits is the last number.
    fits = {order: np.isfinite(_days_of_three(matches, order)) for order in DATE_ORDERS}
    fits["ymd"] &= (matches.width("a") == 2) & (matches.width("c") == 2)

    # A cell that is no date in any order shows nothing.
    is_date = np.logical_or.reduce(list(fits.values()))
    if not is_date.any():
        return DateOrders()

    # Find the first counterexample to each order.
    counterexamples = {}
    for order, is_good in fits.items():
        is_bad = is_date & ~is_good
        if is_bad.any():
            counterexamples[order] = str(matches.cells[int(is_bad.argmax())].as_py())

    # Dates with dots have the day first, if all of them have dots.
    has_dot = pc.equal(matches.text("mark"), ".").to_numpy()
    first = str(matches.cells[int(is_date.argmax())].as_py())
    return DateOrders(first, bool(has_dot[is_date].all()), counterexamples)


def _days_of_three(matches: _Matches, order: str) -> Floats:
    """Days since 1970 of dates of three numbers in an order; NaN for cells that are no dates."""
    # In the order `dmy`, the groups a, b and c are day, month and year.
    group = dict(zip(order, "abc", strict=True))
    days = _days(_year(matches, group["y"]), matches.number(group["m"]), matches.number(group["d"]))

    # With the year first, the last number must not be a year.
    if group["y"] == "a":
        days[matches.width("c") == 4] = np.nan
    return days


def _year(matches: _Matches, group: str) -> Integers:
    """Years, with two-digit ones completed."""
    year = matches.number(group)
    century = np.where(year <= _LAST_SHORT_YEAR, 2000, 1900)
    return np.where(matches.width(group) <= 2, year + century, year)


def _month(matches: _Matches) -> Integers:
    """Months by number or by name."""
    # The first three letters tell the month. Both branches are computed for all cells, so names
    # give way to 0 before the cast to integers.
    text = pc.utf8_lower(matches.text("month"))
    index = pc.index_in(pc.utf8_slice_codeunits(text, 0, 3), pa.array(_MONTHS))
    named = pc.add(pc.cast(index, pa.int64()), 1)
    numbered = pc.cast(pc.if_else(pc.is_valid(index), "0", text), pa.int64())
    months: Integers = pc.if_else(pc.is_valid(index), named, numbered).to_numpy()
    return months


def _days(year: Integers, month: Integers, day: Integers) -> Floats:
    """Days since 1970 of dates; NaN for dates that don't exist."""
    # First day of the month and of the next one, by NumPy's calendar.
    months = ((year - 1970) * 12 + month - 1).astype("M8[M]")
    first, after = (start.astype("M8[D]").astype(np.int64) for start in (months, months + 1))

    good = (year >= 1) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= after - first)
    return np.where(good, first + day - 1.0, np.nan)


def _clock(matches: _Matches) -> Floats:
    """Seconds of the day in UTC; NaN for impossible times.

    Midnight may be 24:00:00. A leap second, 23:59:60, is the next midnight, as in POSIX. But in a
    column of whole seconds it is half a second before that, so that it differs from 00:00:00.
    """
    # Parse the clock; the fraction is a text of digits, as its leading zeros count.
    hour, minute, second = (matches.number(name) for name in ("hour", "minute", "second"))
    digits = matches.text("fraction")
    decimals = pc.if_else(pc.equal(digits, ""), "0", digits)
    fraction = pc.cast(pc.binary_join_element_wise("0.", decimals, ""), pa.float64()).to_numpy()

    # Check the bounds of hours, minutes and seconds.
    half = pc.utf8_lower(matches.text("half"))
    has_half = pc.not_equal(half, "").to_numpy()
    is_hour = np.where(has_half, (hour >= 1) & (hour <= 12), hour <= 23)
    good = (minute <= 59) & (second <= 60) & is_hour
    good |= ~has_half & (hour == 24) & (minute == 0) & (second == 0) & (fraction == 0)

    # Keep a leap second apart from the midnight that follows.
    if not fraction.any():
        fraction = np.where(second == 60, -0.5, 0.0)

    # Convert 12-hour clocks.
    # Hour 12 is 0 AM or 0 PM, so it counts as 0 before the half of the day is added.
    hour = np.where(has_half, hour % 12 + 12 * pc.equal(half, "p").to_numpy(), hour)

    # Convert to UTC.
    # The offset is seconds by which the local time is ahead of UTC, so it is subtracted.
    zone_hour, zone_minute = matches.number("zone_hour"), matches.number("zone_minute")
    good &= (zone_hour <= 23) & (zone_minute <= 59)
    is_west = pc.equal(matches.text("sign"), "-").to_numpy()
    offset = np.where(is_west, -60, 60) * (60 * zone_hour + zone_minute)
    return np.where(good, (3600 * hour + 60 * minute + second - offset) + fraction, np.nan)


def _format_date(cell: str, order: str) -> str:
    """Write out a date of three numbers as an order reads it, such as ``3 Apr 2024``."""
    matches = _Matches.of(pa.chunked_array([[cell]]), _THREE_NUMBERS, np.arange(1))
    group = dict(zip(order, "abc", strict=True))
    year = _year(matches, group["y"])[0]
    month, day = matches.number(group["m"])[0], matches.number(group["d"])[0]
    return f"{day} {_MONTHS[month - 1].title()} {year}"
