"""Numbers and names from Arrow columns of any type; cells that can't be parsed become NaN."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = [
    "NUMBER_PATTERN",
    "factorize",
    "is_number",
    "is_text",
    "looks_like_number",
    "looks_like_time",
    "to_attribute",
    "to_floats",
    "trimmed_text",
]

#: A decimal number.
NUMBER_PATTERN = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?$"

#: A name of a month, short or long.
_MONTH = "(?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*"

#: How a date or a time of day begins.
_TIME_PATTERN = rf"""(?ix)^ (?:
    \d{{4}}[-/.:]\d{{1,2}}[-/.:]\d          # 2024-01-31
  | \d{{1,2}}[-/.]\d{{1,2}}[-/.]\d{{2,4}}   # 31/01/2024
  | \d{{1,2}}:\d{{2}}                       # 12:00
  | \d{{8}}[T ]\d{{2,6}}                    # 20240131T1200
  | (?:(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*,?\s+)?
    (?: \d{{1,2}}[-\s]{_MONTH}[-\s]\d{{2}}  # 31 Jan 2024
      | {_MONTH}\s+\d{{1,2}}[,\s]           # Jan 31, 2024
    )
)"""

Floats = NDArray[np.float64]


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a decimal number.

    Examples
    --------
    >>> looks_like_number(" -1.5e3"), looks_like_number("t")
    (True, False)
    """
    return re.match(NUMBER_PATTERN, cell.strip()) is not None


def looks_like_time(cell: str) -> bool:
    """Whether a cell is a date or a time of day rather than a name.

    Examples
    --------
    >>> looks_like_time("2024-01-31T12:00Z"), looks_like_time("12:30"), looks_like_time("time")
    (True, True, False)
    """
    return re.match(_TIME_PATTERN, cell.strip()) is not None


def to_floats(column: Any, decimal_comma: bool = False) -> Floats:
    """Turn a column of any type into floats.

    Parameters
    ----------
    column : pyarrow.ChunkedArray
        Numbers, or text with numbers.
    decimal_comma : bool
        Whether text has decimal commas, as in 1,5.

    Returns
    -------
    float64 array, shape (n,)
        NaN for cells that are no numbers.

    Examples
    --------
    >>> to_floats(pa.chunked_array([["1.5", "", "n/a"]])).tolist()
    [1.5, nan, nan]
    """
    if is_text(column.type):
        text = trimmed_text(column)
        text = pc.replace_substring(text, ",", ".") if decimal_comma else text
        # Arrow's cast reads `nan` and `inf` as numbers, and raises if a single cell is none, so
        # cells have to match a pattern first.
        is_match = pc.match_substring_regex(text, NUMBER_PATTERN)
        column = _cast(pc.if_else(is_match, text, None), pa.float64())
    elif not is_number(column.type):
        return np.full(len(column), np.nan)
    # Arrow's memory is read-only, so it is copied.
    return np.array(pc.cast(column, pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def factorize(column: Any) -> tuple[tuple[str, ...], NDArray[np.integer[Any]]]:
    """Turn a column of names into the distinct names and an index into them for each row.

    Parameters
    ----------
    column : pyarrow.ChunkedArray, shape (n,)
        Names of any flat type; missing ones count as the empty name.

    Returns
    -------
    names : tuple of str
        Distinct names in the order of first appearance.
    index : int array, shape (n,)
        Name of each row.

    Raises
    ------
    InputError
        If cells are lists or structures.

    Examples
    --------
    >>> factorize(pa.chunked_array([["b", "a", "b"]]))
    (('b', 'a'), array([0, 1, 0], dtype=int32))
    """
    # Encode the column as a dictionary of texts.
    _check_flat(column.type)
    if pa.types.is_dictionary(column.type) and not is_text(column.type.value_type):
        column = column.cast(column.type.value_type)
    if not is_text(column.type):
        column = pc.cast(column, pa.string())
    column = column if pa.types.is_dictionary(column.type) else pc.dictionary_encode(column)

    # Bring all chunks to the same dictionary.
    if isinstance(column, pa.ChunkedArray):
        column = column.unify_dictionaries().combine_chunks()
    array = column.chunk(0) if isinstance(column, pa.ChunkedArray) else column
    names = [name or "" for name in array.dictionary.to_pylist()]

    # Rows without a name are one track with the empty name.
    index = array.indices
    if index.null_count:
        empty = names.index("") if "" in names else len(names)
        names = names if empty < len(names) else [*names, ""]
        index = pc.fill_null(index, empty)
    return tuple(names), index.to_numpy(zero_copy_only=False)


def to_attribute(column: Any) -> NDArray[np.generic]:
    """Turn a column to keep into an array.

    Returns
    -------
    array, shape (n,)
        Integers if all cells are, floats if the type is another type of numbers, else texts.

    Raises
    ------
    InputError
        If cells are lists or structures.
    """
    # Integers have no NaN for nulls, and int64 doesn't hold all of uint64.
    if pa.types.is_integer(column.type) and not column.null_count and column.type != pa.uint64():
        return np.array(pc.cast(column, pa.int64()).to_numpy())
    if is_number(column.type):
        return to_floats(column)

    _check_flat(column.type)
    texts = pc.cast(column, pa.string()).to_pylist()
    return np.array([value or "" for value in texts], dtype=np.str_)


def _check_flat(kind: Any) -> None:
    """Refuse columns with lists or structures as cells."""
    if pa.types.is_nested(kind):
        raise InputError(
            f"a column that must be text holds {kind}", remedy="name another one, or leave it out"
        )


def is_text(kind: Any) -> bool:
    """Whether an Arrow type is text, plain or as a dictionary.

    Examples
    --------
    >>> is_text(pa.string()), is_text(pa.dictionary(pa.int8(), pa.string())), is_text(pa.int64())
    (True, True, False)
    """
    return bool(
        pa.types.is_string(kind)
        or pa.types.is_large_string(kind)
        or pa.types.is_string_view(kind)
        or (pa.types.is_dictionary(kind) and is_text(kind.value_type))
    )


def is_number(kind: Any) -> bool:
    """Whether an Arrow type is integers, floats or decimals.

    Examples
    --------
    >>> is_number(pa.int8()), is_number(pa.decimal128(9, 2)), is_number(pa.string())
    (True, True, False)
    """
    return bool(
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    )


def trimmed_text(column: Any) -> Any:
    """Cast a column to plain strings without surrounding white space."""
    return pc.utf8_trim_whitespace(pc.cast(column, pa.string()))


def _cast(column: Any, kind: Any) -> Any:
    """Cast text; cells that Arrow rejects become null. Bisection finds them."""
    try:
        return pc.cast(column, kind)
    except pa.ArrowInvalid:
        if len(column) == 1:
            return pa.chunked_array([pa.nulls(1, kind)])
        # Each bad cell costs about log2(n) casts, of ever shorter slices.
        half = len(column) // 2
        first, second = _cast(column.slice(0, half), kind), _cast(column.slice(half), kind)
        return pa.chunked_array([*first.chunks, *second.chunks], kind)
