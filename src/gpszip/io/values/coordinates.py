"""Latitudes and longitudes from the ways in which people write them.

A cell is read as a whole or not at all: what can't be read becomes NaN, never a part of the text and never 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.raw import UnreadableCell

__all__ = [
    "HEMISPHERES",
    "Axis",
    "first_unreadable_cell",
    "has_decimal_comma",
    "has_decimal_point",
    "has_packed_minutes",
    "is_text",
    "parse_degrees",
    "parse_numbers",
    "trimmed_text",
]

Axis = Literal["lat", "lon"]
Floats = NDArray[np.float64]

#: Largest degrees of each axis. Longitudes from 180 to 360 are degrees, too, but no longitude with a hemisphere.
_LIMIT = {"lat": 90, "lon": 180}

#: Minutes of a degree, and seconds of a minute.
_SIXTIETHS = 60

#: What a column beside the latitude or longitude may say, and the sign that it means.
HEMISPHERES: dict[Axis, dict[str, float]] = {
    "lat": {"n": 1.0, "north": 1.0, "s": -1.0, "south": -1.0},
    "lon": {"e": 1.0, "east": 1.0, "w": -1.0, "west": -1.0},
}

#: Characters that stand for others. Two single primes are seconds.
_EQUIVALENT_LETTERS = {
    "'": "′’‘ʹ´`",
    '"': "″”“ʺ",
    "°": "º˚",
    "-": "−",
    " ": "\u00a0\u2009\u202f",
}

_NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?$"

# The parts of `48°08'13.5"N`. Only the last number may have a fraction. An `s` after the seconds is their mark only
# where the minutes have an `m`: elsewhere it is south.
_DEGREES = r"(?P<degrees>\d+(?:\.\d*)?|\.\d+)\s*(?:°|d|deg)?"
_MINUTES = (
    r"(?P<degrees>\d{1,3})(?:\s*(?:°|d|deg|:)\s*|\s+)(?P<minutes>\d{1,2}(?:\.\d*)?)\s*(?:'|m|min)?"
)
_SECONDS = (
    r"(?P<degrees>\d{1,3})(?:\s*(?:°|d|deg|:)\s*|\s+)(?P<minutes>\d{1,2})(?:\s*[':]\s*|\s+)"
    r'(?P<seconds>\d{1,2}(?:\.\d*)?)\s*"?'
)
_LETTERED = (
    r"(?P<degrees>\d{1,3})\s*(?:°|d|deg)\s*(?P<minutes>\d{1,2})\s*(?:m|min)\s*"
    r"(?P<seconds>\d{1,2}(?:\.\d*)?)\s*(?:s|sec)"
)
_FORMS = tuple(
    rf"^(?P<before>[NSEWnsew]?)\s*(?P<sign>[+-]?){form}\s*(?P<after>[NSEWnsew]?)$"
    for form in (_DEGREES, _MINUTES, _SECONDS, _LETTERED)
)


def parse_degrees(
    column: pa.ChunkedArray,
    axis: Axis,
    *,
    hemisphere: pa.ChunkedArray | None = None,
    decimal_comma: bool = False,
    packed_minutes: bool = False,
) -> Floats:
    r"""Read a column of latitudes or longitudes.

    A cell holds a number (``-33.8561``), a number with a hemisphere (``33.8561S``, ``N48.137``), or degrees with minutes
    and perhaps seconds (``48°08'13.5"N``, ``48 8 13.5 N``, ``48:08:13.5``, ``48d8m13.5s``, ``-48 8.225``). White space
    around it doesn't matter. A hemisphere must fit the axis and takes no sign.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        Numbers, or text.
    axis : {"lat", "lon"}
        Which of the two it holds.
    hemisphere : pyarrow.ChunkedArray, shape (n,), optional
        A column beside it that says N, S, E or W, or north, south, east or west. Where it says something else or
        contradicts the sign, the position can't be read.
    decimal_comma : bool, default False
        Whether text writes 1,5 for one and a half; see :func:`has_decimal_comma`.
    packed_minutes : bool, default False
        Whether numbers are degrees and minutes in one, 4808.225 for 48°08.225'; see :func:`has_packed_minutes`.

    Returns
    -------
    float64 array, shape (n,)
        Degrees; NaN for what can't be read.

    Examples
    --------
    >>> cells = pa.chunked_array([["48.137", "48°08'13.2\"N", "48.137S", "48.137E", "48,137"]])
    >>> parse_degrees(cells, "lat").round(6).tolist()
    [48.137, 48.137, -48.137, nan, nan]
    """
    values = parse_numbers(column, decimal_comma)
    if packed_minutes:
        values = _unpack_minutes(values)
    lettered = np.zeros(len(values), dtype=np.bool_)

    # Only text that is no plain number needs a closer look.
    rest = np.isnan(values) & _is_filled(column)
    if is_text(column.type) and rest.any():
        values[rest], lettered[rest] = _parse_marked(
            _with_decimal_point(trimmed_text(column).filter(pa.array(rest)), decimal_comma), axis
        )

    if hemisphere is not None:
        sign = _signs(hemisphere, axis)
        contradicts = np.where(
            lettered, np.copysign(1.0, values) != sign, (values < 0) & (sign > 0)
        )
        values = np.where(contradicts, np.nan, np.abs(values) * sign)
    return values


def has_decimal_comma(columns: Iterable[pa.ChunkedArray]) -> bool:
    """Whether columns write 1,5 for one and a half: a cell has a comma between digits, and none has a point, or two commas.

    Parameters
    ----------
    columns : iterable of pyarrow.ChunkedArray
        All coordinates of a log.

    Examples
    --------
    >>> has_decimal_comma([pa.chunked_array([["48,1", "48"]]), pa.chunked_array([["11,5", "11,6"]])])
    True
    >>> has_decimal_comma([pa.chunked_array([["48,1", "48.2"]])]), has_decimal_comma([pa.chunked_array([["1,234,567"]])])
    (False, False)
    """
    cells = [trimmed_text(column) for column in columns if is_text(column.type)]
    return any(_any_match(column, r"\d,\d") for column in cells) and not has_decimal_point(cells)


def has_decimal_point(columns: Iterable[pa.ChunkedArray]) -> bool:
    """Whether some text has a point beside a digit, or several commas between digits: its commas are no decimal ones.

    Parameters
    ----------
    columns : iterable of pyarrow.ChunkedArray
        All coordinates of a log.

    Examples
    --------
    >>> has_decimal_point([pa.chunked_array([["48,1", "48.2"]])]), has_decimal_point([pa.chunked_array([["48,1"]])])
    (True, False)
    """
    return any(
        _any_match(trimmed_text(column), r"\d\.|\.\d|\d,\d+,\d")
        for column in columns
        if is_text(column.type)
    )


def has_packed_minutes(
    lat: pa.ChunkedArray, lon: pa.ChunkedArray, *, decimal_comma: bool = False
) -> bool:
    """Whether numbers are degrees and minutes in one, as NMEA has them: 4808.225 for 48°08.225'.

    A single number can't tell. A whole column can: all are beyond the largest degrees, or written with as many digits as
    NMEA has before the point (4 and 5), and all minutes are below 60. The other axis must allow it. Ask this only where
    hemispheres stand in columns of their own, as they do in NMEA.

    Parameters
    ----------
    lat, lon : pyarrow.ChunkedArray, shape (n,)
        Numbers, or text.
    decimal_comma : bool, default False
        Whether text writes 1,5 for one and a half.

    Examples
    --------
    >>> has_packed_minutes(pa.chunked_array([["4808.225"]]), pa.chunked_array([["01134.500"]]))
    True
    >>> has_packed_minutes(pa.chunked_array([[48.137, 9999]]), pa.chunked_array([[11.575, 9999]]))
    False
    """
    proofs = []
    for column, limit, digits in ((lat, _LIMIT["lat"], 4), (lon, _LIMIT["lon"], 5)):
        values = parse_numbers(column, decimal_comma)
        known = values[np.isfinite(values)]
        if (
            not len(known)
            or (np.abs(known) % 100 >= _SIXTIETHS).any()
            or (np.abs(known) // 100 > limit).any()
        ):
            return False
        beyond, padded = np.abs(known) > limit, _is_padded(column, digits)
        if beyond.any() and not beyond.all() and not padded:
            return False
        proofs.append(bool(beyond.all()) or padded)
    return any(proofs)


def first_unreadable_cell(
    column: pa.ChunkedArray, values: Floats, name: str
) -> UnreadableCell | None:
    """Return the first cell that holds something but could not be read.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        The cells.
    values : float64 array, shape (n,)
        What was read from them; not finite where nothing was.
    name : str
        The column's name.

    Examples
    --------
    >>> first_unreadable_cell(pa.chunked_array([["48.1", "", "undefined"]]), np.array([48.1, np.nan, np.nan]), "lat")
    Unread(column='lat', row=2, value='undefined')
    """
    bad = ~np.isfinite(values) & _is_filled(column)
    if not bad.any():
        return None
    row = int(bad.argmax())
    return UnreadableCell(name, row, str(column[row].as_py()))


def is_text(kind: Any) -> bool:
    """Whether a type of Arrow is text, whichever way it is stored.

    Examples
    --------
    >>> is_text(pa.large_string()), is_text(pa.dictionary(pa.int8(), pa.string())), is_text(pa.int8())
    (True, True, False)
    """
    if pa.types.is_dictionary(kind):
        return is_text(kind.value_type)
    return bool(
        pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind)
    )


def trimmed_text(column: pa.ChunkedArray) -> Any:
    """Return a column of text as plain strings, without white space around them."""
    return pc.utf8_trim_whitespace(pc.cast(column, pa.string()))


def parse_numbers(column: pa.ChunkedArray, decimal_comma: bool = False) -> Floats:
    """Read a column of numbers, or of text that is nothing but a decimal number.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        Numbers, or text.
    decimal_comma : bool, default False
        Whether text writes 1,5 for one and a half; see :func:`has_decimal_comma`.

    Returns
    -------
    float64 array, shape (n,)
        NaN for all else.

    Examples
    --------
    >>> parse_numbers(pa.chunked_array([["1.5", " -2e3 ", "1,5", "nan", "12 m"]])).tolist()
    [1.5, -2000.0, nan, nan, nan]
    """
    if pa.types.is_dictionary(column.type):
        column = pc.cast(column, column.type.value_type)
    if is_text(column.type):
        column = _with_decimal_point(trimmed_text(column), decimal_comma)
        try:
            column = pc.cast(column, pa.float64())  # mostly all are numbers
        except pa.ArrowInvalid:
            column = pc.cast(
                pc.if_else(pc.match_substring_regex(column, _NUMBER), column, None), pa.float64()
            )
    elif not _is_number(column.type):
        return np.full(len(column), np.nan)

    values = np.array(
        pc.cast(column, pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=np.float64
    )
    values[~np.isfinite(values)] = np.nan
    return values


def _is_number(kind: Any) -> bool:
    return bool(
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    )


def _with_decimal_point(text: Any, decimal_comma: bool) -> Any:
    """Write the decimal comma as a point; a cell that has a point already is no number."""
    if not decimal_comma:
        return text
    return pc.if_else(pc.match_substring(text, "."), None, pc.replace_substring(text, ",", "."))


def _is_filled(column: Any) -> NDArray[np.bool_]:
    """Whether each cell holds something."""
    filled = pc.is_valid(column)
    if is_text(column.type):
        filled = pc.fill_null(pc.not_equal(trimmed_text(column), ""), False)
    return np.asarray(filled.to_numpy(zero_copy_only=False), dtype=np.bool_)


def _is_padded(column: Any, digits: int) -> bool:
    """Whether all numbers in a column of text have so many digits before the point."""
    if not is_text(column.type):
        return False
    cells = trimmed_text(column).filter(pa.array(_is_filled(column)))
    return bool(pc.all(pc.match_substring_regex(cells, rf"^\d{{{digits}}}([.,]\d*)?$")).as_py())


def _any_match(text: Any, pattern: str) -> bool:
    return bool(pc.any(pc.match_substring_regex(text, pattern)).as_py())


def _unpack_minutes(values: Floats) -> Floats:
    """Degrees of numbers such as 4808.225; NaN where the minutes are 60 or more."""
    whole, minutes = np.divmod(np.abs(values), 100)
    return np.where(minutes < _SIXTIETHS, np.copysign(whole + minutes / _SIXTIETHS, values), np.nan)


def _parse_marked(text: Any, axis: Axis) -> tuple[Floats, NDArray[np.bool_]]:
    """Read cells with a hemisphere, or with minutes and seconds; and tell which have a hemisphere."""
    if not pc.all(pc.string_is_ascii(text)).as_py():
        for plain, others in _EQUIVALENT_LETTERS.items():
            text = pc.replace_substring_regex(text, f"[{others}]", plain)
    text = pc.utf8_trim_whitespace(pc.replace_substring(text, "''", '"'))

    # The forms exclude each other: at most one of them fits a cell.
    values = np.full(len(text), np.nan)
    lettered = np.zeros(len(text), dtype=np.bool_)
    for form in _FORMS:
        fits = np.asarray(
            pc.match_substring_regex(text, form).to_numpy(zero_copy_only=False), dtype=np.bool_
        )
        if fits.any():
            parts = pc.extract_regex(text.filter(pa.array(fits)), form)
            values[fits], lettered[fits] = _sum_parts(parts, axis)
    values[np.isinf(values)] = np.nan
    return values, lettered


def _sum_parts(parts: Any, axis: Axis) -> tuple[Floats, NDArray[np.bool_]]:
    """Degrees from the parts that a form has found."""
    part = {field.name: pc.struct_field(parts, field.name) for field in parts.type}
    numbers = {
        name: np.asarray(pc.cast(cells, pa.float64()).to_numpy(zero_copy_only=False))
        for name, cells in part.items()
        if name in ("degrees", "minutes", "seconds")
    }
    values = sum(
        numbers[name] / unit
        for name, unit in (("degrees", 1), ("minutes", 60), ("seconds", 3600))
        if name in numbers
    )
    for name in ("minutes", "seconds"):
        values = np.where(numbers.get(name, np.zeros(1)) < _SIXTIETHS, values, np.nan)

    # At most one of a sign, a letter before and a letter after; and the letter must fit the axis.
    marks = [
        np.asarray(pc.not_equal(part[name], "").to_numpy(zero_copy_only=False))
        for name in ("sign", "before", "after")
    ]
    letter = pc.binary_join_element_wise(part["before"], part["after"], "")
    lettered = marks[1] | marks[2]
    sign = np.where(lettered, _signs(letter, axis), 1.0)
    sign[np.asarray(pc.equal(part["sign"], "-").to_numpy(zero_copy_only=False))] = -1.0
    sign[sum(mark.astype(np.int8) for mark in marks) > 1] = np.nan
    return values * sign, lettered


def _signs(column: Any, axis: Axis) -> Floats:
    """1 for north and east, -1 for south and west, NaN for all else."""
    if not is_text(column.type):
        return np.full(len(column), np.nan)
    names = HEMISPHERES[axis]
    index = pc.index_in(pc.utf8_lower(trimmed_text(column)), pa.array(list(names)))
    signs: Floats = np.append(list(names.values()), np.nan)
    found: Floats = signs[pc.fill_null(index, -1).to_numpy(zero_copy_only=False)]
    return found
