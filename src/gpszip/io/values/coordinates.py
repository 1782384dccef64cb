"""Latitudes and longitudes in the notations that people use.

A cell is read completely or not at all: if any of its text can't be parsed, it becomes NaN.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.raw import UnreadableCell
from gpszip.io.values.arrow import NUMBER_PATTERN, is_number, is_text, trimmed_text

__all__ = [
    "HEMISPHERES",
    "Axis",
    "first_unreadable_cell",
    "has_decimal_comma",
    "has_decimal_point",
    "has_packed_minutes",
    "parse_degrees",
    "parse_numbers",
]

Axis = Literal["lat", "lon"]
Floats = NDArray[np.float64]

#: Largest degrees on each axis in NMEA's notation, where longitudes beyond 180 don't occur.
_LIMIT = {"lat": 90, "lon": 180}

#: Minutes in a degree, and seconds in a minute.
_SIXTIETHS = 60

#: Digits before the point that NMEA pads latitudes in degrees and minutes to.
_LAT_DIGITS = 4

#: Digits before the point that NMEA pads longitudes in degrees and minutes to.
_LON_DIGITS = 5

#: Texts of a column with hemispheres, and their signs.
HEMISPHERES: dict[Axis, dict[str, float]] = {
    "lat": {"n": 1.0, "north": 1.0, "s": -1.0, "south": -1.0},
    "lon": {"e": 1.0, "east": 1.0, "w": -1.0, "west": -1.0},
}

#: Characters with their look-alikes. Two single primes mark seconds.
_EQUIVALENT_LETTERS = {
    "'": "′’‘ʹ´`",
    '"': "″”“ʺ",
    "°": "º˚",
    "-": "−",
    " ": "\u00a0\u2009\u202f",
}

# The forms of `48°08'13.5"N`. Only the last number may have a fraction. An `s` after the seconds
# marks seconds only if the minutes have an `m`; otherwise it is south.
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

    A cell is one of the following, in any white space:

    - a number: ``-33.8561``
    - a number with a hemisphere: ``33.8561S``, ``N48.137``
    - degrees and minutes: ``-48 8.225``, ``N48°08.225'``
    - degrees, minutes and seconds: ``48°08'13.5"N``, ``48 8 13.5 N``, ``48:08:13.5``,
      ``48d8m13.5s``

    A hemisphere must fit the axis and excludes a sign.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        Numbers, or text.
    axis : {"lat", "lon"}
        Latitude or longitude.
    hemisphere : pyarrow.ChunkedArray, shape (n,), optional
        A separate column with N, S, E or W, or north, south, east or west. Cells with another
        hemisphere, or one that contradicts the sign, can't be read.
    decimal_comma : bool, default False
        Whether text has decimal commas, as in 1,5; see :func:`has_decimal_comma`.
    packed_minutes : bool, default False
        Whether numbers pack degrees and minutes, 4808.225 for 48°08.225'; see
        :func:`has_packed_minutes`.

    Returns
    -------
    float64 array, shape (n,)
        Degrees; NaN for cells that can't be read.

    Examples
    --------
    >>> cells = pa.chunked_array([["48.137", "48°08'13.2\"N", "48.137S", "48.137E", "48,137"]])
    >>> parse_degrees(cells, "lat").round(6).tolist()
    [48.137, 48.137, -48.137, nan, nan]
    """
    # Plain numbers.
    values = parse_numbers(column, decimal_comma)
    if packed_minutes:
        values = _unpack_minutes(values)
    has_letter = np.zeros(len(values), dtype=np.bool_)

    # Text with a hemisphere, minutes or seconds.
    rest = np.isnan(values) & _is_filled(column)
    if is_text(column.type) and rest.any():
        text = trimmed_text(column).filter(pa.array(rest))
        values[rest], has_letter[rest] = _parse_marked(
            _with_decimal_point(text, decimal_comma), axis
        )

    # Apply the separate hemispheres.
    if hemisphere is not None:
        sign = _hemisphere_signs(hemisphere, axis)
        # A letter in the cell has to agree with the column. Without one, only a minus beside north
        # or east contradicts: a plain number takes the sign of its hemisphere.
        contradicts = np.where(
            has_letter, np.copysign(1.0, values) != sign, (values < 0) & (sign > 0)
        )
        values = np.where(contradicts, np.nan, np.abs(values) * sign)
    return values


def has_decimal_comma(columns: Iterable[pa.ChunkedArray]) -> bool:
    """Whether columns of text have decimal commas, as in 1,5.

    They do if a cell has a comma between digits, and no cell has a point or several commas.

    Parameters
    ----------
    columns : iterable of pyarrow.ChunkedArray
        All coordinates of a log.

    Examples
    --------
    >>> lat, lon = pa.chunked_array([["48,1", "48"]]), pa.chunked_array([["11,5", "11,6"]])
    >>> has_decimal_comma([lat, lon])
    True
    >>> has_decimal_comma([pa.chunked_array([["48,1", "48.2"]])])
    False
    >>> has_decimal_comma([pa.chunked_array([["1,234,567"]])])
    False
    """
    # All coordinates decide together, as one axis may have whole degrees only.
    cells = [trimmed_text(column) for column in columns if is_text(column.type)]
    return any(_any_match(column, r"\d,\d") for column in cells) and not has_decimal_point(cells)


def has_decimal_point(columns: Iterable[pa.ChunkedArray]) -> bool:
    """Whether commas in columns of text can't be decimal commas.

    They can't if a cell has a point beside a digit, or several commas between digits.

    Parameters
    ----------
    columns : iterable of pyarrow.ChunkedArray
        All coordinates of a log.

    Examples
    --------
    >>> has_decimal_point([pa.chunked_array([["48,1", "48.2"]])])
    True
    >>> has_decimal_point([pa.chunked_array([["48,1"]])])
    False
    """
    return any(
        _any_match(trimmed_text(column), r"\d\.|\.\d|\d,\d+,\d")
        for column in columns
        if is_text(column.type)
    )


def has_packed_minutes(
    lat: pa.ChunkedArray, lon: pa.ChunkedArray, *, decimal_comma: bool = False
) -> bool:
    """Whether numbers pack degrees and minutes as in NMEA: 4808.225 for 48°08.225'.

    A single number is ambiguous, but a column isn't. All its minutes must be below 60, and all its
    numbers either exceed the largest degrees or have NMEA's number of digits before the point (4
    and 5). One axis must prove it, and the other must allow it. The result is meaningful only for
    tables with separate columns of hemispheres, as NMEA has them.

    Parameters
    ----------
    lat, lon : pyarrow.ChunkedArray, shape (n,)
        Numbers, or text.
    decimal_comma : bool, default False
        Whether text has decimal commas, as in 1,5.

    Examples
    --------
    >>> has_packed_minutes(pa.chunked_array([["4808.225"]]), pa.chunked_array([["01134.500"]]))
    True
    >>> has_packed_minutes(pa.chunked_array([[48.137, 9999]]), pa.chunked_array([[11.575, 9999]]))
    False
    """
    # Test both axes: neither may contradict, and one has to prove the notation.
    proofs = []
    for column, limit, digits in (
        (lat, _LIMIT["lat"], _LAT_DIGITS),
        (lon, _LIMIT["lon"], _LON_DIGITS),
    ):
        # Degrees and minutes must be in their bounds.
        values = parse_numbers(column, decimal_comma)
        sizes = np.abs(values[np.isfinite(values)])
        if not len(sizes) or (sizes % 100 >= _SIXTIETHS).any() or (sizes // 100 > limit).any():
            return False

        # A mixture of large and small numbers is no packed notation, unless all are padded.
        is_beyond, is_padded = sizes > limit, _is_padded(column, digits)
        if is_beyond.any() and not is_beyond.all() and not is_padded:
            return False
        proofs.append(bool(is_beyond.all()) or is_padded)
    return any(proofs)


def first_unreadable_cell(
    column: pa.ChunkedArray, values: Floats, name: str
) -> UnreadableCell | None:
    """First cell that isn't empty and could not be read, if any.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        The cells.
    values : float64 array, shape (n,)
        Their values; not finite for cells that could not be read.
    name : str
        The column's name.

    Examples
    --------
    >>> cells = pa.chunked_array([["48.1", "", "undefined"]])
    >>> first_unreadable_cell(cells, np.array([48.1, np.nan, np.nan]), "lat")
    UnreadableCell(column='lat', row=2, value='undefined')
    """
    bad = ~np.isfinite(values) & _is_filled(column)
    if not bad.any():
        return None
    row = int(bad.argmax())
    return UnreadableCell(name, row, str(column[row].as_py()))


def parse_numbers(column: pa.ChunkedArray, decimal_comma: bool = False) -> Floats:
    """Read a column of numbers, or of text with a decimal number in each cell.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        Numbers, or text.
    decimal_comma : bool, default False
        Whether text has decimal commas, as in 1,5; see :func:`has_decimal_comma`.

    Returns
    -------
    float64 array, shape (n,)
        NaN for all other cells.

    Examples
    --------
    >>> parse_numbers(pa.chunked_array([["1.5", " -2e3 ", "1,5", "nan", "12 m"]])).tolist()
    [1.5, -2000.0, nan, nan, nan]
    """
    # Decode dictionaries: the other steps work on plain columns.
    if pa.types.is_dictionary(column.type):
        column = pc.cast(column, column.type.value_type)

    # Parse text. Most columns hold nothing but numbers, for which no pattern is needed.
    if is_text(column.type):
        column = _with_decimal_point(trimmed_text(column), decimal_comma)
        try:
            column = pc.cast(column, pa.float64())
        except pa.ArrowInvalid:
            is_match = pc.match_substring_regex(column, NUMBER_PATTERN)
            column = pc.cast(pc.if_else(is_match, column, None), pa.float64())
    elif not is_number(column.type):
        return np.full(len(column), np.nan)

    # Infinite values are no coordinates.
    floats = pc.cast(column, pa.float64(), safe=False)
    values = np.array(floats.to_numpy(zero_copy_only=False), dtype=np.float64)
    values[~np.isfinite(values)] = np.nan
    return values


def _with_decimal_point(text: Any, decimal_comma: bool) -> Any:
    """Replace decimal commas by points; cells with a point already become null."""
    if not decimal_comma:
        return text
    return pc.if_else(pc.match_substring(text, "."), None, pc.replace_substring(text, ",", "."))


def _is_filled(column: Any) -> NDArray[np.bool_]:
    """Whether each cell is neither null nor blank."""
    filled = pc.is_valid(column)
    if is_text(column.type):
        filled = pc.fill_null(pc.not_equal(trimmed_text(column), ""), False)
    return np.asarray(filled.to_numpy(zero_copy_only=False), dtype=np.bool_)


def _is_padded(column: Any, digits: int) -> bool:
    """Whether all numbers in a column of text have a given number of digits before the point."""
    if not is_text(column.type):
        return False
    cells = trimmed_text(column).filter(pa.array(_is_filled(column)))
    return bool(pc.all(pc.match_substring_regex(cells, rf"^\d{{{digits}}}([.,]\d*)?$")).as_py())


def _any_match(text: Any, pattern: str) -> bool:
    """Whether some cell contains a match."""
    return bool(pc.any(pc.match_substring_regex(text, pattern)).as_py())


def _unpack_minutes(values: Floats) -> Floats:
    """Degrees of numbers such as 4808.225; NaN if the minutes are 60 or more."""
    # With v = 100 d + m, the degrees are d + m / 60 = floor(v / 100) + (v mod 100) / 60.
    degrees, minutes = np.divmod(np.abs(values), 100)
    signed = np.copysign(degrees + minutes / _SIXTIETHS, values)
    return np.where(minutes < _SIXTIETHS, signed, np.nan)


def _parse_marked(text: Any, axis: Axis) -> tuple[Floats, NDArray[np.bool_]]:
    """Read cells with a hemisphere, minutes or seconds.

    Returns
    -------
    values : float64 array, shape (n,)
        Degrees; NaN for cells that can't be read.
    has_letter : bool array, shape (n,)
        Whether each cell has a hemisphere.
    """
    # Replace look-alikes of the marks.
    if not pc.all(pc.string_is_ascii(text)).as_py():
        for plain, others in _EQUIVALENT_LETTERS.items():
            text = pc.replace_substring_regex(text, f"[{others}]", plain)
    text = pc.utf8_trim_whitespace(pc.replace_substring(text, "''", '"'))

    # The forms exclude each other: at most one of them fits a cell.
    values = np.full(len(text), np.nan)
    has_letter = np.zeros(len(text), dtype=np.bool_)
    for form in _FORMS:
        is_match = pc.match_substring_regex(text, form)
        fits = np.asarray(is_match.to_numpy(zero_copy_only=False), dtype=np.bool_)
        if fits.any():
            groups = pc.extract_regex(text.filter(pa.array(fits)), form)
            values[fits], has_letter[fits] = _combine_groups(groups, axis)
    values[np.isinf(values)] = np.nan
    return values, has_letter


def _combine_groups(groups: Any, axis: Axis) -> tuple[Floats, NDArray[np.bool_]]:
    """Degrees, and whether there is a hemisphere, from the groups that a form has matched."""
    # Add up degrees, minutes and seconds.
    group = {field.name: pc.struct_field(groups, field.name) for field in groups.type}
    numbers = {
        name: np.asarray(pc.cast(cells, pa.float64()).to_numpy(zero_copy_only=False))
        for name, cells in group.items()
        if name in ("degrees", "minutes", "seconds")
    }
    values = sum(
        numbers[name] / unit
        for name, unit in (("degrees", 1), ("minutes", 60), ("seconds", 3600))
        if name in numbers
    )
    # A cell 48°75' is a mistake, and is not read as 49°15'.
    for name in ("minutes", "seconds"):
        values = np.where(numbers.get(name, np.zeros(1)) < _SIXTIETHS, values, np.nan)

    # Find sign and hemisphere, which must fit the axis. At most one of them is allowed.
    has_sign, has_letter_before, has_letter_after = (
        np.asarray(pc.not_equal(group[name], "").to_numpy(zero_copy_only=False))
        for name in ("sign", "before", "after")
    )
    letter = pc.binary_join_element_wise(group["before"], group["after"], "")
    has_letter = has_letter_before | has_letter_after
    sign = np.where(has_letter, _hemisphere_signs(letter, axis), 1.0)
    sign[np.asarray(pc.equal(group["sign"], "-").to_numpy(zero_copy_only=False))] = -1.0
    marks = np.stack([has_sign, has_letter_before, has_letter_after])
    sign[marks.sum(axis=0) > 1] = np.nan
    return values * sign, has_letter


def _hemisphere_signs(column: Any, axis: Axis) -> Floats:
    """1 for north and east, -1 for south and west, NaN for other cells."""
    if not is_text(column.type):
        return np.full(len(column), np.nan)
    names = HEMISPHERES[axis]
    index = pc.index_in(pc.utf8_lower(trimmed_text(column)), pa.array(list(names)))
    signs: Floats = np.append(list(names.values()), np.nan)
    # Index -1, for cells without a match, finds the NaN at the end.
    column_signs: Floats = signs[pc.fill_null(index, -1).to_numpy(zero_copy_only=False)]
    return column_signs
