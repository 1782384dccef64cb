"""Numbers and names from Arrow columns, whatever their type; what can't be understood becomes NaN."""

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
    "is_text",
    "looks_like_number",
    "looks_like_time",
    "to_attribute",
    "to_floats",
    "trimmed_text",
]

#: What a decimal number looks like.
NUMBER_PATTERN = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?$"
#: What a date or a time of day begins with.
_TIME_PATTERN = r"""(?ix)^ (?: \d{4}[-/.:]\d{1,2}[-/.:]\d  |  \d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}  |  \d{1,2}:\d{2}  |  \d{8}[T ]\d{2,6}
    |  (?:(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*,?\s+)? (?:\d{1,2}[-\s]%(months)s[-\s]\d{2}  |  %(months)s\s+\d{1,2}[,\s]) )"""
_TIME_PATTERN %= {"months": "(?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*"}

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
        Numbers, or text that holds them.
    decimal_comma : bool
        Whether text writes 1,5 for one and a half.

    Returns
    -------
    float64 array, shape (n,)
        NaN for what is no number.

    Examples
    --------
    >>> to_floats(pa.chunked_array([["1.5", "", "n/a"]])).tolist()
    [1.5, nan, nan]
    """
    kind = column.type
    if is_text(kind):
        text = trimmed_text(column)
        text = pc.replace_substring(text, ",", ".") if decimal_comma else text
        column = _cast(
            pc.if_else(pc.match_substring_regex(text, NUMBER_PATTERN), text, None), pa.float64()
        )
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        return np.full(len(column), np.nan)
    return np.array(pc.cast(column, pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def factorize(column: Any) -> tuple[tuple[str, ...], NDArray[np.integer[Any]]]:
    """Turn a column of names into texts in the order of first appearance, and an index into them for each row.

    Examples
    --------
    >>> factorize(pa.chunked_array([["b", "a", "b"]]))
    (('b', 'a'), array([0, 1, 0], dtype=int32))
    """
    _check_flat(column.type)
    if pa.types.is_dictionary(column.type) and not is_text(column.type.value_type):
        column = column.cast(column.type.value_type)
    if not is_text(column.type):
        column = pc.cast(column, pa.string())
    column = column if pa.types.is_dictionary(column.type) else pc.dictionary_encode(column)
    array = (
        column.unify_dictionaries().combine_chunks()
        if isinstance(column, pa.ChunkedArray)
        else column
    )
    array = array.chunk(0) if isinstance(array, pa.ChunkedArray) else array
    names = [name or "" for name in array.dictionary.to_pylist()]
    index = array.indices
    if index.null_count:  # rows without a name are one track, whose name is empty
        empty = names.index("") if "" in names else len(names)
        names = names if empty < len(names) else [*names, ""]
        index = pc.fill_null(index, empty)
    return tuple(names), index.to_numpy(zero_copy_only=False)


def to_attribute(column: Any) -> NDArray[np.generic]:
    """Turn a column to keep into integers where it holds nothing else, into floats where it holds numbers, else into texts."""
    if pa.types.is_integer(column.type) and not column.null_count and column.type != pa.uint64():
        return np.array(pc.cast(column, pa.int64()).to_numpy())
    if (
        pa.types.is_integer(column.type)
        or pa.types.is_floating(column.type)
        or pa.types.is_decimal(column.type)
    ):
        return to_floats(column)
    _check_flat(column.type)
    return np.array(
        [value or "" for value in pc.cast(column, pa.string()).to_pylist()], dtype=np.str_
    )


def _check_flat(kind: Any) -> None:
    """Refuse columns whose cells are lists or structures of values."""
    if pa.types.is_nested(kind):
        raise InputError(
            f"a column that is to be text holds {kind}; name another one, or leave it out"
        )


def is_text(kind: Any) -> bool:
    """Whether a type of columns is text, maybe by a dictionary.

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


def trimmed_text(column: Any) -> Any:
    """Cast a column to text without white space around it."""
    return pc.utf8_trim_whitespace(pc.cast(column, pa.string()))


def _cast(column: Any, kind: Any) -> Any:
    """Cast text that looks right; what isn't (the 31st of April) becomes null, found by halving."""
    try:
        return pc.cast(column, kind)
    except pa.ArrowInvalid:
        if len(column) == 1:
            return pa.chunked_array([pa.nulls(1, kind)])
        half = len(column) // 2
        parts = [_cast(column.slice(0, half), kind), _cast(column.slice(half), kind)]
        return pa.chunked_array([chunk for part in parts for chunk in part.chunks], kind)
