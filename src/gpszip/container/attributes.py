"""What was kept of a log beside its walks, exactly: the instants of its samples and further columns."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.container.columns import (
    BITS,
    BYTES_PER_BYTE,
    FREE_BYTES,
    INTEGERS,
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

#: An archive's kept columns hold at most so many values, and so many more for each byte of theirs.
_FREE_VALUES, _VALUES_PER_BYTE = 1 << 20, 1 << 12

_Ints = NDArray[np.int64]
_Values = NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class KeptColumns:
    """Instants and columns of all tracks, one after the other.

    Parameters
    ----------
    counts : tuple of int
        Number of samples of each track.
    times : float64 array, shape (n,)
        Seconds; they increase within each track.
    columns : mapping of str to array, shape (n,), optional
        Integers (int64), numbers (float64, NaN where there is none; minus zero may come back as zero) or texts (str).
    """

    counts: tuple[int, ...]
    times: NDArray[np.float64]
    columns: Mapping[str, _Values] = field(default_factory=dict)

    def rows(self, track: int) -> slice:
        """Rows of the track with this number."""
        first = sum(self.counts[:track])
        return slice(first, first + self.counts[track])


def encode_attributes(kept: KeptColumns) -> bytes:
    """Body of the section.

    Raises
    ------
    OptionError
        If a column holds what can't be kept.

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
        Instants of all samples.
    columns : mapping of str to Column
        Further columns, by their names.
    sink : binary file
        Where to; only written to, from its start on.
    """
    names = [name.encode() for name in columns]
    sink.write(
        b"".join(map(encode_varint, counts))
        + encode_varint(len(names))
        + b"".join(encode_varint(len(name)) + name for name in names)
    )
    for column in (times, *columns.values()):
        write_column(column, sink)
    values = sum(counts) * (1 + len(columns))
    sink.write(bytes(max(0, -(-(values - _FREE_VALUES) // _VALUES_PER_BYTE) - sink.tell())))


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
    if total * (1 + len(names)) > _FREE_VALUES + _VALUES_PER_BYTE * len(body):
        raise cursor.error(
            f"{1 + len(names)} columns of {total} samples can't lie in {len(body)} bytes"
        )
    times = _read_column(cursor, total)
    if not _increase(times, counts):
        raise cursor.error("kept times of samples go back, or are none")
    columns = {name: _read_column(cursor, total) for name in names}
    if cursor.read_rest().strip(b"\0"):
        raise cursor.error("bytes after the end of the kept columns")
    return KeptColumns(counts, times.astype(np.float64), columns)


def _read_head(cursor: Cursor, tracks: int) -> tuple[tuple[int, ...], tuple[str, ...]]:
    if tracks > cursor.remaining:
        raise cursor.error(f"numbers of samples of {tracks} tracks in {cursor.remaining} bytes")
    counts = tuple(cursor.read_varint("a number of samples") for _ in range(tracks))
    count = cursor.read_varint("the number of columns")
    if count > cursor.remaining:
        raise cursor.error(f"{count} columns in {cursor.remaining} bytes")
    names = tuple(
        _read_text(cursor, cursor.read_bytes(cursor.read_varint("a name's length"), "a name"))
        for _ in range(count)
    )
    if len(set(names)) < count:
        raise cursor.error("two columns of one name")
    return counts, names


def _increase(times: _Values, counts: Sequence[int]) -> bool:
    if times.dtype.kind not in "if" or not np.isfinite(times.astype(np.float64)).all():
        return False
    later = np.diff(times.astype(np.float64)) > 0
    starts = np.cumsum([count for count in counts if count], dtype=np.int64)[:-1]
    later[starts - 1] = True
    return bool(later.all())


def _read_packed(cursor: Cursor, size: int) -> bytes:
    """Read a packed block that expands to ``size`` bytes."""
    tag = cursor.read_varint("the length of a block")
    data = cursor.read_bytes(tag >> 2, "a block")
    packing = tag & 3
    if packing > 2 or (packing and size > FREE_BYTES + BYTES_PER_BYTE * len(data)):
        raise cursor.error(f"a block of packing {packing} and {len(data)} bytes can't hold {size}")
    if packing:
        data = (inflate if packing == 1 else unpack_lzma)(data, size, cursor.base + cursor.offset)
    if len(data) != size:
        raise cursor.error(f"a block holds {len(data)} bytes, not {size}")
    return data


def _read_column(cursor: Cursor, count: int) -> _Values:
    byte = cursor.read_byte("a column's kind")
    kind, order, holes = byte & 15, byte >> 4 & 3, byte >> 6
    if kind > TEXT or order > 2 or holes > 1 or (holes and not INTEGERS < kind < BITS):
        raise cursor.error(f"no column is of kind {byte}")
    empty = (
        np.unpackbits(np.frombuffer(_read_packed(cursor, -(-count // 8)), np.uint8), count=count)
        == 1
        if holes
        else None
    )
    texts = _read_texts(cursor) if kind == TEXT else []
    values = _read_numbers(cursor, count, order)
    if kind == TEXT:
        if count and not (values.min() >= 0 and values.max() < len(texts)):
            raise cursor.error(f"a row holds none of the {len(texts)} texts")
        return np.array(texts, dtype=object)[values] if texts else np.zeros(0, dtype=object)
    if kind == INTEGERS:
        return values
    if kind == BITS:
        return values.view(np.float64)
    numbers: NDArray[np.float64] = values / 10.0 ** (kind - 1)
    if empty is not None:
        numbers[empty] = np.nan
    return numbers


def _read_texts(cursor: Cursor) -> list[str]:
    count, size = (
        cursor.read_varint("the number of texts"),
        cursor.read_varint("the size of the texts"),
    )
    if count > size:
        raise cursor.error(f"{count} texts in {size} bytes")
    inside = Cursor(_read_packed(cursor, size))
    found = [
        _read_text(cursor, inside.read_bytes(inside.read_varint("a text's length"), "a text"))
        for _ in range(count)
    ]
    inside.expect_end("the texts")
    return found


def _read_text(cursor: Cursor, raw: bytes) -> str:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        raise cursor.error("a text is not UTF-8") from None


def _read_numbers(cursor: Cursor, count: int, order: int) -> _Ints:
    starts = [cursor.read_signed("a first value") for _ in range(order)]
    width = cursor.read_byte("the width of numbers")
    left = max(count - order, 0)
    if width > 8:
        raise cursor.error(f"numbers of {width} bytes")
    planes = np.frombuffer(_read_packed(cursor, width * left), np.uint8).reshape(width, left)
    spread = np.zeros((left, 8), np.uint8)
    spread[:, :width] = planes.T
    coded = spread.view("<u8").reshape(-1).astype(np.uint64)
    values: _Ints = (coded >> np.uint64(1)).view(np.int64) ^ -(coded & np.uint64(1)).view(np.int64)
    for start in reversed(starts[:count]):
        values = np.cumsum(np.append(np.int64(start), values))
    return values[:count]
