"""What was kept of a log beside its walks, exactly: the instants of its samples and further columns."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpszip.container.expansion import deflate, inflate, pack_lzma, unpack_lzma
from gpszip.container.layout import Cursor, signed, varint
from gpszip.errors import OptionError

__all__ = ["Kept", "attributes_body", "kept_names", "read_attributes"]

#: An archive's kept columns hold at most so many values, and so many more for each byte of theirs.
_FREE_VALUES, _VALUES_PER_BYTE = 1 << 20, 1 << 12

#: A packed block expands to at most so many bytes, and so many more for each of its own.
_FREE_BYTES, _BYTES_PER_BYTE = 1 << 20, 1 << 10

#: Kinds of columns; between INTEGERS and BITS are decimals with kind - 1 digits after the point.
_INTEGERS, _BITS, _TEXT = 0, 11, 12
_DIGITS = 9
_EXACT = 2.0**53

#: Values on which the order of differences is tried.
_SAMPLE = 1 << 16

_Ints = NDArray[np.int64]
_Values = NDArray[np.generic]


@dataclass(frozen=True, eq=False)
class Kept:
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


def attributes_body(kept: Kept) -> bytes:
    """Body of the section.

    Raises
    ------
    OptionError
        If a column holds what can't be kept.

    Examples
    --------
    >>> kept = Kept((3,), np.array([0.0, 1.0, 2.5]), {"note": np.array(["a", "b", "a"])})
    >>> back = read_attributes(attributes_body(kept), 1)
    >>> back.times.tolist(), back.columns["note"].tolist()
    ([0.0, 1.0, 2.5], ['a', 'b', 'a'])
    """
    names = [name.encode() for name in kept.columns]
    head = b"".join(map(varint, kept.counts)) + varint(len(names)) + b"".join(varint(len(name)) + name for name in names)
    columns = [_column("t", kept.times), *(_column(name, values) for name, values in kept.columns.items())]
    body = head + b"".join(columns)
    values = len(kept.times) * len(columns)
    return body + bytes(max(0, -(-(values - _FREE_VALUES) // _VALUES_PER_BYTE) - len(body)))


def kept_names(body: bytes, tracks: int) -> tuple[str, ...]:
    """Names of the columns, without expanding any of them."""
    return _read_head(Cursor(body), tracks)[1]


def read_attributes(body: bytes, tracks: int) -> Kept:
    """Undo :func:`attributes_body`.

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
        raise cursor.fail(f"{1 + len(names)} columns of {total} samples can't lie in {len(body)} bytes")
    times = _read_column(cursor, total)
    if not _increase(times, counts):
        raise cursor.fail("kept times of samples go back, or are none")
    columns = {name: _read_column(cursor, total) for name in names}
    if cursor.rest().strip(b"\0"):
        raise cursor.fail("bytes after the end of the kept columns")
    return Kept(counts, times.astype(np.float64), columns)


def _read_head(cursor: Cursor, tracks: int) -> tuple[tuple[int, ...], tuple[str, ...]]:
    if tracks > cursor.left:
        raise cursor.fail(f"numbers of samples of {tracks} tracks in {cursor.left} bytes")
    counts = tuple(cursor.varint("a number of samples") for _ in range(tracks))
    count = cursor.varint("the number of columns")
    if count > cursor.left:
        raise cursor.fail(f"{count} columns in {cursor.left} bytes")
    names = tuple(_read_text(cursor, cursor.take(cursor.varint("a name's length"), "a name")) for _ in range(count))
    if len(set(names)) < count:
        raise cursor.fail("two columns of one name")
    return counts, names


def _increase(times: _Values, counts: Sequence[int]) -> bool:
    if times.dtype.kind not in "if" or not np.isfinite(times.astype(np.float64)).all():
        return False
    later = np.diff(times.astype(np.float64)) > 0
    starts = np.cumsum([count for count in counts if count], dtype=np.int64)[:-1]
    later[starts - 1] = True
    return bool(later.all())


def _column(name: str, values: _Values) -> bytes:
    """Byte of kind, order and holes; the holes; the texts; the numbers."""
    if values.dtype.kind in "SUO":
        texts, codes = np.unique(np.array([_text(name, value) for value in values.tolist()], dtype=object), return_inverse=True)
        raw = [text.encode() for text in texts.tolist()]
        joined = b"".join(varint(len(text)) + text for text in raw)
        return _numbers(_TEXT, codes.reshape(-1).astype(np.int64), varint(len(raw)) + varint(len(joined)) + _packed(joined))
    if values.dtype.kind in "biu":
        if len(values) and int(values.max()) >= 1 << 63:
            raise OptionError(f"column {name!r} holds {values.max()}, which is too large to be kept")
        return _numbers(_INTEGERS, values.astype(np.int64))
    if values.dtype.kind != "f":
        raise OptionError(f"column {name!r} holds {values.dtype}; numbers and texts can be kept")
    return _floats(values.astype(np.float64))


def _text(name: str, value: object) -> str:
    if value is None:
        return ""
    if not isinstance(value, str):
        raise OptionError(f"column {name!r} holds {value!r} among texts; numbers or texts can be kept, but not both")
    return value


def _floats(values: NDArray[np.float64]) -> bytes:
    holes = np.isnan(values)
    known = values[~holes]
    for digits in range(_DIGITS + 1) if (np.abs(known) < _EXACT).all() else ():
        scaled = np.rint(known * 10.0**digits)
        fits = (np.abs(scaled) < _EXACT) & (scaled / 10.0**digits == known)
        if fits.all():
            whole = np.zeros(len(values), np.int64)
            whole[~holes] = scaled.astype(np.int64)
            whole = whole[np.maximum.accumulate(np.where(holes, 0, np.arange(len(values))))]
            return _numbers(1 + digits, whole, _packed(np.packbits(holes).tobytes()) if holes.any() else b"", holes=bool(holes.any()))
    return _numbers(_BITS, values.view(np.int64))


def _numbers(kind: int, values: _Ints, before: bytes = b"", *, holes: bool = False) -> bytes:
    """Choose the order of differences that packs a sample best."""
    order = min(range(3), key=lambda one: len(zlib.compress(_shuffled(_differences(values[:_SAMPLE], one)[1])[1], 1)))
    starts, rest = _differences(values, order)
    width, data = _shuffled(rest)
    return bytes([kind | order << 4 | holes << 6]) + before + b"".join(map(signed, starts)) + bytes([width]) + _packed(data)


def _differences(values: _Ints, order: int) -> tuple[list[int], NDArray[np.uint64]]:
    """First values, and the others' differences with their sign in the lowest bit, all modulo 2^64."""
    starts = []
    for _ in range(order):
        starts.append(int(values[0]) if len(values) else 0)
        values = np.diff(values)
    rest: NDArray[np.uint64] = ((values << 1) ^ (values >> 63)).view(np.uint64)
    return starts, rest


def _shuffled(values: NDArray[np.uint64]) -> tuple[int, bytes]:
    """Bytes that the largest takes, and all lowest bytes, then all second lowest, and so on."""
    width = math.ceil(int(values.max()).bit_length() / 8) if len(values) else 0
    return width, values.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T.tobytes()


def _packed(data: bytes) -> bytes:
    tries = [(0, data), (1, deflate(data)), (2, pack_lzma(data))]
    allowed = [(number, one) for number, one in tries if not number or len(data) <= _FREE_BYTES + _BYTES_PER_BYTE * len(one)]
    packing, shortest = min(allowed, key=lambda one: len(one[1]))
    return varint(4 * len(shortest) + packing) + shortest


def _read_packed(cursor: Cursor, size: int) -> bytes:
    """Read a packed block that expands to ``size`` bytes."""
    tag = cursor.varint("the length of a block")
    data = cursor.take(tag >> 2, "a block")
    packing = tag & 3
    if packing > 2 or (packing and size > _FREE_BYTES + _BYTES_PER_BYTE * len(data)):
        raise cursor.fail(f"a block of packing {packing} and {len(data)} bytes can't hold {size}")
    if packing:
        data = (inflate if packing == 1 else unpack_lzma)(data, size, cursor.base + cursor.at)
    if len(data) != size:
        raise cursor.fail(f"a block holds {len(data)} bytes, not {size}")
    return data


def _read_column(cursor: Cursor, count: int) -> _Values:
    byte = cursor.byte("a column's kind")
    kind, order, holes = byte & 15, byte >> 4 & 3, byte >> 6
    if kind > _TEXT or order > 2 or holes > 1 or (holes and not _INTEGERS < kind < _BITS):
        raise cursor.fail(f"no column is of kind {byte}")
    empty = np.unpackbits(np.frombuffer(_read_packed(cursor, -(-count // 8)), np.uint8), count=count) == 1 if holes else None
    texts = _read_texts(cursor) if kind == _TEXT else []
    values = _read_numbers(cursor, count, order)
    if kind == _TEXT:
        if count and not (values.min() >= 0 and values.max() < len(texts)):
            raise cursor.fail(f"a row holds none of the {len(texts)} texts")
        return np.array(texts, dtype=object)[values] if texts else np.zeros(0, dtype=object)
    if kind == _INTEGERS:
        return values
    if kind == _BITS:
        return values.view(np.float64)
    numbers: NDArray[np.float64] = values / 10.0 ** (kind - 1)
    if empty is not None:
        numbers[empty] = np.nan
    return numbers


def _read_texts(cursor: Cursor) -> list[str]:
    count, size = cursor.varint("the number of texts"), cursor.varint("the size of the texts")
    if count > size:
        raise cursor.fail(f"{count} texts in {size} bytes")
    inside = Cursor(_read_packed(cursor, size))
    found = [_read_text(cursor, inside.take(inside.varint("a text's length"), "a text")) for _ in range(count)]
    inside.finish("the texts")
    return found


def _read_text(cursor: Cursor, raw: bytes) -> str:
    try:
        return raw.decode()
    except UnicodeDecodeError:
        raise cursor.fail("a text is not UTF-8") from None


def _read_numbers(cursor: Cursor, count: int, order: int) -> _Ints:
    starts = [cursor.signed("a first value") for _ in range(order)]
    width = cursor.byte("the width of numbers")
    left = max(count - order, 0)
    if width > 8:
        raise cursor.fail(f"numbers of {width} bytes")
    planes = np.frombuffer(_read_packed(cursor, width * left), np.uint8).reshape(width, left)
    spread = np.zeros((left, 8), np.uint8)
    spread[:, :width] = planes.T
    coded = spread.view("<u8").reshape(-1).astype(np.uint64)
    values: _Ints = (coded >> np.uint64(1)).view(np.int64) ^ -(coded & np.uint64(1)).view(np.int64)
    for start in reversed(starts[:count]):
        values = np.cumsum(np.append(np.int64(start), values))
    return values[:count]
