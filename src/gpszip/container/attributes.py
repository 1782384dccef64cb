"""Kept attributes: the times of all samples and further columns, exactly."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.container.columns import (
    BITS,
    BYTES_PER_BYTE,
    DEFLATED,
    FREE_BYTES,
    INTEGERS,
    LZMA,
    STORED,
    TEXT,
    Column,
    as_column,
    write_column,
)
from gpszip.container.expansion import inflate, unpack_lzma
from gpszip.container.layout import Cursor, encode_varint

__all__ = [
    "KeptColumns",
    "encode_attributes",
    "read_attributes",
    "read_column_names",
    "write_attributes",
]

#: The section holds at most this many values, and so many more for each of its bytes: forged counts
#: cannot ask for memory.
_FREE_VALUES = 1 << 20
_VALUES_PER_BYTE = 1 << 12

#: Largest order of differences, and bytes of the widest number.
_MAX_ORDER = 2
_MAX_WIDTH = 8

_Ints = NDArray[np.int64]
_Values = NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class KeptColumns:
    """Times and columns of all tracks, one track after the other.

    Parameters
    ----------
    counts : tuple of int
        Number of samples of each track.
    times : float64 array, shape (n,)
        Seconds; they increase within each track.
    columns : mapping of str to array, shape (n,), optional
        Integers (int64), numbers (float64, NaN where there is none; minus zero may come back as
        zero) or texts (str).
    """

    counts: tuple[int, ...]
    times: NDArray[np.float64]
    columns: Mapping[str, _Values] = field(default_factory=dict)

    def rows(self, track: int) -> slice:
        """Rows of the track with this number."""
        return slice(self._starts[track], self._starts[track + 1])

    @cached_property
    def _starts(self) -> list[int]:
        """First row of each track, and the number of all rows."""
        return [0, *accumulate(self.counts)]


def encode_attributes(kept: KeptColumns) -> bytes:
    """Encode the body of the section.

    Raises
    ------
    OptionError
        If a column holds values that can't be kept.

    Examples
    --------
    >>> kept = KeptColumns((3,), np.array([0.0, 1.0, 2.5]), {"note": np.array(["a", "b", "a"])})
    >>> back = read_attributes(encode_attributes(kept), 1)
    >>> back.times.tolist(), back.columns["note"].tolist()
    ([0.0, 1.0, 2.5], ['a', 'b', 'a'])
    """
    sink = io.BytesIO()
    columns = {name: as_column(name, values) for name, values in kept.columns.items()}
    write_attributes(kept.counts, as_column("t", kept.times), columns, sink)
    return sink.getvalue()


def write_attributes(
    counts: Sequence[int], times: Column, columns: Mapping[str, Column], sink: BinaryIO
) -> None:
    """Write the body of the section for columns of any length.

    Parameters
    ----------
    counts : sequence of int
        Number of samples of each track.
    times : Column
        Times of all samples.
    columns : mapping of str to Column
        Further columns, by their names.
    sink : binary file
        Only written to, from its start on.
    """
    # The head: numbers of samples, names.
    names = [name.encode() for name in columns]
    sink.write(
        b"".join(map(encode_varint, counts))
        + encode_varint(len(names))
        + b"".join(encode_varint(len(name)) + name for name in names)
    )

    # The columns, and zeros up to the bytes that so many values must have.
    for column in (times, *columns.values()):
        write_column(column, sink)
    values = sum(counts) * (1 + len(columns))
    # The double minus rounds up.
    min_bytes = -(-(values - _FREE_VALUES) // _VALUES_PER_BYTE)
    sink.write(bytes(max(0, min_bytes - sink.tell())))


def read_column_names(body: bytes, tracks: int) -> tuple[str, ...]:
    """Names of the columns, without expanding any of them."""
    return _read_head(Cursor(body), tracks)[1]


def read_attributes(body: bytes, tracks: int) -> KeptColumns:
    """Undo :func:`encode_attributes`.

    Parameters
    ----------
    body : bytes
        Untrusted; memory stays below 200 kB for each of its bytes, plus 100 MB.
    tracks : int
        Number of tracks of the archive.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no columns of so many tracks; its offset counts from the start of the body.
    """
    cursor = Cursor(body)
    counts, names = _read_head(cursor, tracks)
    total = sum(counts)
    # Forged counts are refused before any column is expanded.
    if total * (1 + len(names)) > _FREE_VALUES + _VALUES_PER_BYTE * len(body):
        raise cursor.error(
            f"{1 + len(names)} columns of {total} samples can't lie in {len(body)} bytes"
        )

    times = _read_column(cursor, total)
    if not _is_increasing(times, counts):
        raise cursor.error("kept times of samples go back, or are none")
    columns = {name: _read_column(cursor, total) for name in names}
    if cursor.read_rest().strip(b"\0"):
        raise cursor.error("bytes after the end of the kept columns")
    return KeptColumns(counts, times.astype(np.float64), columns)


def _read_head(cursor: Cursor, tracks: int) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Number of samples of each track, and names of the columns."""
    # Each number of samples takes a byte at least, and so does each name.
    if tracks > cursor.remaining:
        raise cursor.error(f"numbers of samples of {tracks} tracks in {cursor.remaining} bytes")
    counts = tuple(cursor.read_varint("a number of samples") for _ in range(tracks))
    columns = cursor.read_varint("the number of columns")
    if columns > cursor.remaining:
        raise cursor.error(f"{columns} columns in {cursor.remaining} bytes")
    names = tuple(
        _decode_text(cursor, cursor.read_bytes(cursor.read_varint("a name's length"), "a name"))
        for _ in range(columns)
    )
    if len(set(names)) < columns:
        raise cursor.error("two columns of one name")
    return counts, names


def _is_increasing(times: _Values, counts: Sequence[int]) -> bool:
    """Whether times are numbers that increase within each track."""
    if times.dtype.kind not in "if" or not np.isfinite(times.astype(np.float64)).all():
        return False
    is_later = np.diff(times.astype(np.float64)) > 0

    # From one track to the next, times may go back.
    # Tracks without samples have no step.
    starts = np.cumsum([count for count in counts if count], dtype=np.int64)[:-1]
    is_later[starts - 1] = True
    return bool(is_later.all())


def _read_packed(cursor: Cursor, size: int) -> bytes:
    """Read a packed block that expands to ``size`` bytes."""
    # The two lowest bits are the packing, the rest is the length.
    tag = cursor.read_varint("the length of a block")
    data, packing = cursor.read_bytes(tag >> 2, "a block"), tag & 3
    limit = FREE_BYTES + BYTES_PER_BYTE * len(data)
    # A stored block can't expand, so that it needs no limit.
    if packing > LZMA or (packing != STORED and size > limit):
        raise cursor.error(f"a block of packing {packing} and {len(data)} bytes can't hold {size}")
    if packing != STORED:
        unpack = inflate if packing == DEFLATED else unpack_lzma
        data = unpack(data, size, cursor.base + cursor.offset)
    if len(data) != size:
        raise cursor.error(f"a block holds {len(data)} bytes, not {size}")
    return data


def _read_column(cursor: Cursor, count: int) -> _Values:
    """Undo :func:`gpszip.container.columns.write_column` for ``count`` values."""
    # a byte of kind, order of differences, and whether numbers are missing
    byte = cursor.read_byte("a column's kind")
    # The kind has 4 bits, the order 2, and holes the rest.
    kind, order, holes = byte & 15, byte >> 4 & 3, byte >> 6
    is_decimal = INTEGERS < kind < BITS
    if kind > TEXT or order > _MAX_ORDER or holes > 1 or (holes and not is_decimal):
        raise cursor.error(f"no column is of kind {byte}")

    # Holes or texts, then integers.
    is_missing = _read_bits(cursor, count) if holes else None
    texts = _read_texts(cursor) if kind == TEXT else []
    values = _read_numbers(cursor, count, order)

    # From integers to values.
    if kind == TEXT:
        if count and not (values.min() >= 0 and values.max() < len(texts)):
            raise cursor.error(f"a row holds none of the {len(texts)} texts")
        return np.array(texts, dtype=object)[values] if texts else np.zeros(0, dtype=object)
    if kind == INTEGERS:
        return values
    if kind == BITS:
        return values.view(np.float64)
    # The writer has checked that this division gives back the same numbers.
    numbers: NDArray[np.float64] = values / 10.0 ** (kind - 1)
    if is_missing is not None:
        numbers[is_missing] = np.nan
    return numbers


def _read_bits(cursor: Cursor, count: int) -> NDArray[np.bool_]:
    """Read a packed block of ``count`` bits."""
    block = np.frombuffer(_read_packed(cursor, -(-count // 8)), np.uint8)
    return np.unpackbits(block, count=count).astype(np.bool_)


def _read_texts(cursor: Cursor) -> list[str]:
    """Read the distinct texts of a column."""
    count = cursor.read_varint("the number of texts")
    size = cursor.read_varint("the size of the texts")
    # Each text takes a byte at least, for its length.
    if count > size:
        raise cursor.error(f"{count} texts in {size} bytes")
    block = Cursor(_read_packed(cursor, size))
    texts = [
        _decode_text(cursor, block.read_bytes(block.read_varint("a text's length"), "a text"))
        for _ in range(count)
    ]
    block.expect_end("the texts")
    return texts


def _decode_text(cursor: Cursor, data: bytes) -> str:
    """Text of UTF-8 bytes."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise cursor.error("a text is not UTF-8") from None


def _read_numbers(cursor: Cursor, count: int, order: int) -> _Ints:
    """Read ``count`` integers that are stored as differences of an order."""
    # The first value of each order, the byte planes of the differences.
    starts = [cursor.read_signed("a first value") for _ in range(order)]
    width = cursor.read_byte("the width of numbers")
    length = max(count - order, 0)
    if width > _MAX_WIDTH:
        raise cursor.error(f"numbers of {width} bytes")
    planes = np.frombuffer(_read_packed(cursor, width * length), np.uint8).reshape(width, length)

    # Bytes to numbers, whose lowest bit is the sign.
    # Plane i holds byte i of each number; the bytes above the width are 0.
    rows = np.zeros((length, _MAX_WIDTH), np.uint8)
    rows[:, :width] = planes.T
    folded = rows.view("<u8").reshape(-1).astype(np.uint64)
    sizes, signs = (folded >> np.uint64(1)).view(np.int64), (folded & np.uint64(1)).view(np.int64)
    values: _Ints = sizes ^ -signs

    # Sum up the differences, order by order.
    # A column shorter than the order has fewer first values.
    for start in reversed(starts[:count]):
        values = np.cumsum(np.append(np.int64(start), values))
    return values[:count]
