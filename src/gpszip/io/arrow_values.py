"""Numbers, times and names from Arrow columns, whatever their type; what can't be understood becomes NaN."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError

__all__ = ["codes", "looks_like_number", "looks_like_time", "numbers", "seconds", "unit_seconds", "values"]

_NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?$"
_ZONE = r"[zZ]|[+-]\d{2}:?\d{2}|[+-]\d{2}"
_NAIVE = r"^\d{4}-\d{2}-\d{2}([T ]\d{2}:\d{2}(:\d{2}(\.\d{1,9})?)?)?$"
_ZONED = rf"^\d{{4}}-\d{{2}}-\d{{2}}[T ]\d{{2}}:\d{{2}}(:\d{{2}}(\.\d{{1,9}})?)?({_ZONE})$"
_TICKS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}

Floats = NDArray[np.float64]


def looks_like_number(cell: str) -> bool:
    """Whether a cell is a decimal number.

    Examples
    --------
    >>> looks_like_number(" -1.5e3"), looks_like_number("t")
    (True, False)
    """
    return re.match(_NUMBER, cell.strip()) is not None


def looks_like_time(cell: str) -> bool:
    """Whether a cell is a date or a time of day rather than a name.

    Examples
    --------
    >>> looks_like_time("2024-01-31T12:00Z"), looks_like_time("12:30"), looks_like_time("time")
    (True, True, False)
    """
    return re.match(r"^\d{4}[-/.]\d{1,2}[-/.]\d|^\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}|^\d{1,2}:\d{2}", cell.strip()) is not None


def numbers(column: Any, decimal_comma: bool = False) -> Floats:
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
    >>> numbers(pa.chunked_array([["1.5", "", "n/a"]])).tolist()
    [1.5, nan, nan]
    """
    kind = column.type
    if _is_text(kind):
        text = pc.utf8_trim_whitespace(_text(column))
        text = pc.replace_substring(text, ",", ".") if decimal_comma else text
        column = _cast(pc.if_else(pc.match_substring_regex(text, _NUMBER), text, None), pa.float64())
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)):
        return np.full(len(column), np.nan)
    return np.array(pc.cast(column, pa.float64(), safe=False).to_numpy(), dtype=np.float64)


def seconds(column: Any, unit: float | None, where: str) -> Floats:
    """Turn a column of times into seconds.

    Numbers are in the unit given, or else, by the size of their median, in seconds (up to 1e11), milliseconds (1e14),
    microseconds (1e17) or nanoseconds. Dates count from 1970 in UTC; one without a zone is taken as UTC.

    Parameters
    ----------
    column : pyarrow.ChunkedArray
        Numbers, timestamps, or text that holds numbers or ISO 8601.
    unit : float, optional
        Seconds in the unit of numbers.
    where : str
        Name of the log and column for messages.

    Returns
    -------
    float64 array, shape (n,)
        NaN for what is no time.

    Raises
    ------
    InputError
        If there are cells but none is a time.

    Examples
    --------
    >>> seconds(pa.chunked_array([["1970-01-01T00:00:01.5Z", "1970-01-01 01:00:02+01:00"]]), None, "a").tolist()
    [1.5, 2.0]
    >>> seconds(pa.chunked_array([[1700000000077]]), None, "a").tolist()
    [1700000000.077]
    """
    kind = column.type
    if pa.types.is_date(kind):
        column = pc.cast(column, pa.timestamp("ms"))
    if pa.types.is_timestamp(column.type):
        return _ticks(column)
    if _is_text(kind):
        text = pc.utf8_trim_whitespace(_text(column))
        if not pc.any(pc.match_substring_regex(text, _NUMBER)).as_py():
            return _from_iso(text, where)
    elif not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind) or pa.types.is_null(kind)):
        raise InputError(f"{where} holds {kind}, which is no time; give seconds, milliseconds or ISO 8601 (2024-01-31T12:00:00Z)")
    return _scaled(column, unit)


def codes(column: Any) -> tuple[tuple[str, ...], NDArray[np.integer[Any]]]:
    """Turn a column of names into texts in the order of first appearance, and an index into them for each row.

    Examples
    --------
    >>> codes(pa.chunked_array([["b", "a", "b"]]))
    (('b', 'a'), array([0, 1, 0], dtype=int32))
    """
    _check_flat(column.type)
    if pa.types.is_dictionary(column.type) and not _is_text(column.type.value_type):
        column = column.cast(column.type.value_type)
    if not _is_text(column.type):
        column = pc.cast(column, pa.string())
    column = column if pa.types.is_dictionary(column.type) else pc.dictionary_encode(column)
    array = column.unify_dictionaries().combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    array = array.chunk(0) if isinstance(array, pa.ChunkedArray) else array
    names = [name or "" for name in array.dictionary.to_pylist()]
    index = array.indices
    if index.null_count:  # rows without a name are one track, whose name is empty
        empty = names.index("") if "" in names else len(names)
        names = names if empty < len(names) else [*names, ""]
        index = pc.fill_null(index, empty)
    return tuple(names), index.to_numpy(zero_copy_only=False)


def values(column: Any) -> NDArray[np.generic]:
    """Turn a column to keep into integers where it holds nothing else, into floats where it holds numbers, else into texts."""
    if pa.types.is_integer(column.type) and not column.null_count and column.type != pa.uint64():
        return np.array(pc.cast(column, pa.int64()).to_numpy())
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type) or pa.types.is_decimal(column.type):
        return numbers(column)
    _check_flat(column.type)
    return np.array([value or "" for value in pc.cast(column, pa.string()).to_pylist()], dtype=np.str_)


def _check_flat(kind: Any) -> None:
    """Refuse columns whose cells are lists or structures of values."""
    if pa.types.is_nested(kind):
        raise InputError(f"a column that is to be text holds {kind}; name another one, or leave it out")


def unit_seconds(unit: str) -> float:
    """Seconds in a unit of time that a user names.

    Raises
    ------
    OptionError
        If there is no such unit.
    """
    if unit not in _TICKS:
        raise OptionError(f"time unit {unit!r} is not one of {', '.join(_TICKS)}")
    return 1 / _TICKS[unit]


def _is_text(kind: Any) -> bool:
    return bool(
        pa.types.is_string(kind)
        or pa.types.is_large_string(kind)
        or pa.types.is_string_view(kind)
        or (pa.types.is_dictionary(kind) and _is_text(kind.value_type))
    )


def _text(column: Any) -> Any:
    return pc.cast(column, pa.string())


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


def _ticks(column: Any) -> Floats:
    whole, part = np.divmod(pc.fill_null(pc.cast(column, pa.int64()), 0).to_numpy(), _TICKS[column.type.unit])
    result: Floats = whole + part / _TICKS[column.type.unit]
    result[pc.is_null(column).to_numpy()] = np.nan
    return result


def _scaled(column: Any, unit: float | None) -> Floats:
    plain = numbers(column)
    finite = plain[np.isfinite(plain)]
    size = float(np.median(np.abs(finite))) if len(finite) else 0.0
    ticks = round(1 / unit) if unit else next((10**power for power, top in ((0, 1e11), (3, 1e14), (6, 1e17)) if size <= top), 10**9)
    if ticks == 1:
        return plain
    if pa.types.is_integer(column.type) and not column.null_count:  # exact beyond 2**53
        whole, part = np.divmod(pc.cast(column, pa.int64(), safe=False).to_numpy(), ticks)
        exact: Floats = whole + part / ticks
        return exact
    scaled: Floats = plain / ticks
    return scaled


def _from_iso(text: Any, where: str) -> Floats:
    iso = pc.replace_substring_regex(text, r"^(\d{4})[/.](\d{2})[/.](\d{2})", r"\1-\2-\3")
    iso = pc.replace_substring_regex(iso, r"( UTC| GMT| Z)$", "Z")
    iso = pc.replace_substring_regex(iso, r"(:\d{2})[,.](\d{1,9})\d*", r"\1.\2")
    zoned = pc.match_substring_regex(iso, _ZONED)
    naive = pc.match_substring_regex(iso, _NAIVE)
    times = _ticks(_cast(pc.if_else(naive, iso, None), pa.timestamp("ns")))
    if pc.any(zoned).as_py():
        in_zone = _ticks(_cast(pc.if_else(zoned, iso, None), pa.timestamp("ns", "UTC")))
        times = np.where(np.isnan(times), in_zone, times)
    cells = pc.utf8_length(text).to_numpy(zero_copy_only=False) > 0
    if cells.any() and np.isnan(times).all():
        cell = text[int(cells.argmax())].as_py()
        raise InputError(f"{where}: {cell[:40]!r} is no date and time; give seconds, milliseconds or ISO 8601 (2024-01-31T12:00:00Z)")
    return times
