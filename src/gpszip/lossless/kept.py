"""Kept columns by the coder of lossless columns, where that takes fewer bytes.

A section of kept columns is split in two. Its frame is such a section again, with names, texts,
missing numbers and columns that are no decimals, but with zeros in place of all other numbers.
These follow, as a table.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.container.attributes import (
    KeptColumns,
    encode_attributes,
    read_attributes,
    read_column_names,
)
from gpszip.container.columns import Values, as_column, count_digits, scaled
from gpszip.container.layout import Cursor, SectionKind, encode_varint
from gpszip.lossless.columns import MAX_VALUE
from gpszip.lossless.tables import decode_table, encode_table

__all__ = ["read_kept", "read_kept_names", "smaller_section"]

#: A section with fewer bytes stays as it is: to start the compiler takes longer than it saves.
_MIN_BYTES = 1 << 10

#: Most digits after the point of decimals.
_MAX_DIGITS = 9


def smaller_section(body: bytes, tracks: int) -> tuple[SectionKind, bytes]:
    """Return kind and body of the smaller section that holds the same columns.

    Parameters
    ----------
    body : bytes
        Body of a section of kept columns.
    tracks : int
        Number of tracks.

    Examples
    --------
    >>> times = np.cumsum(np.random.default_rng(1).integers(1, 5, 3000)) / 2
    >>> body = encode_attributes(KeptColumns((3000,), times, {"speed": times % 97}))
    >>> kind, smaller = smaller_section(body, 1)
    >>> kind.name, read_kept(kind, smaller, 1).times.tolist() == times.tolist()
    ('CODED_ATTRIBUTES', True)
    """
    if len(body) < _MIN_BYTES:
        return SectionKind.ATTRIBUTES, body
    coded = _encode(read_attributes(body, tracks))
    if len(coded) < len(body):
        return SectionKind.CODED_ATTRIBUTES, coded
    return SectionKind.ATTRIBUTES, body


def read_kept(kind: int, body: bytes, tracks: int) -> KeptColumns:
    """Read a section of kept columns of either kind.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no columns of so many tracks.
    """
    if kind == SectionKind.ATTRIBUTES:
        return read_attributes(body, tracks)

    # The frame, and how many digits each coded column has.
    cursor = Cursor(body)
    frame = read_attributes(_read_frame(cursor), tracks)
    names = ["", *frame.columns]
    digits = [cursor.read_byte("the digits of a column") for _ in names]
    if max(digits) > _MAX_DIGITS + 1:
        raise cursor.error("a column has too many digits")

    # The table in place of the zeros.
    coded = [name for name, digit in zip(names, digits, strict=True) if digit]
    table = dict(zip(coded, decode_table(cursor, len(frame.times), len(coded)), strict=True))
    cursor.expect_end("the kept columns")
    columns = {"": frame.times, **frame.columns}
    for name, digit in zip(names, digits, strict=True):
        if digit:
            columns[name] = _fill(cursor, columns[name], table[name], digit - 1)
    times = columns.pop("").astype(np.float64)
    if not _increases(times, frame.counts):
        raise cursor.error("kept times of samples go back")
    return KeptColumns(frame.counts, times, columns)


def read_kept_names(kind: int, body: bytes, tracks: int) -> tuple[str, ...]:
    """Names of the columns, without expanding any of them."""
    frame = body if kind == SectionKind.ATTRIBUTES else _read_frame(Cursor(body))
    return read_column_names(frame, tracks)


def _read_frame(cursor: Cursor) -> bytes:
    return cursor.read_bytes(cursor.read_varint("the length of a frame"), "the frame")


def _encode(kept: KeptColumns) -> bytes:
    """Encode frame and table."""
    digits, numbers, columns = [], [], {}
    for name, values in (("", kept.times), *kept.columns.items()):
        column = as_column(name, values)
        places = 0 if column.kind == "i" else None
        if column.kind == "f":
            places, _ = count_digits(column)
        chunks = [] if places is None else list(_integers(column.kind, values, places))
        integers = np.concatenate([np.zeros(0, np.int64), *chunks])
        # The absolute value of the smallest integer is no integer of 64 bits.
        fits = places is not None and bool(((integers > -MAX_VALUE) & (integers < MAX_VALUE)).all())
        digits.append(places + 1 if fits and places is not None else 0)
        if fits:
            numbers.append(integers)
        columns[name] = _zeros(values) if fits else values

    # Times have to increase in the frame, too.
    times = np.arange(len(kept.times), dtype=np.float64) if digits[0] else kept.times
    del columns[""]
    frame = encode_attributes(KeptColumns(kept.counts, times, columns))
    table = encode_table(numbers, [digit - 1 for digit in digits if digit])
    return encode_varint(len(frame)) + frame + bytes(digits) + table


def _integers(kind: str, values: Values, places: int) -> list[NDArray[np.int64]]:
    """Chunks of a column of numbers as integers."""
    if kind == "i":
        return [values.astype(np.int64)]
    return list(scaled(as_column("", values), places))


def _zeros(values: Values) -> Values:
    """Zeros of the same kind, and NaN where a number is missing."""
    if values.dtype.kind != "f":
        return np.zeros(len(values), np.int64)
    numbers = values.astype(np.float64)
    return np.where(np.isnan(numbers), np.nan, 0.0)


def _fill(cursor: Cursor, frame: Values, integers: NDArray[np.int64], places: int) -> Values:
    """Numbers in place of the zeros of a frame."""
    if frame.dtype.kind == "i":
        return integers
    if frame.dtype.kind != "f":
        raise cursor.error("a column of texts holds numbers")
    # The writer has checked that this division gives back the same numbers.
    numbers = integers / 10.0**places
    numbers[np.isnan(frame.astype(np.float64))] = np.nan
    return numbers


def _increases(times: NDArray[np.float64], counts: tuple[int, ...]) -> bool:
    """Whether times increase within each track."""
    is_later = np.diff(times) > 0
    starts = np.cumsum([count for count in counts if count], dtype=np.int64)[:-1]
    is_later[starts - 1] = True
    return bool(is_later.all())
