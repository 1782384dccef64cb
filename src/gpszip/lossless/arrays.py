"""Columns of Arrow to integers and bytes, and back with the same values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.container.expansion import pack_lzma, unpack_lzma
from gpszip.container.layout import Cursor, encode_signed, encode_varint
from gpszip.lossless.columns import MAX_VALUE, decode_column, encode_column
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.text import MAX_BLOCK_BYTES, decode_block, encode_block
from gpszip.lossless.trails import Trails

__all__ = [
    "Integers",
    "column_bytes",
    "count_integers",
    "decode_array",
    "encode_array",
    "order_keys",
]

#: Methods: no values; integers; their upper and lower halves; numbers with digits after the point;
#: bits of floats; texts; columns of a struct; bytes of a fixed size with floats; Arrow's own bytes;
#: integers times a power of ten plus an offset.
_NOTHING = 0
_INTEGERS = 1
_HALVES = 2
_DECIMALS = 3
_BITS = 4
_TEXTS = 5
_STRUCT = 6
_POINTS = 7
_ARROW = 8
_SCALED = 9

#: Most digits after the point, and the share of numbers that may be exceptions from them.
_MAX_DIGITS = 12
_MAX_EXACT = 2.0**53
_EXCEPTION_SHARE = 64

#: Bits of the lower half of an integer, and its mask.
_HALF = 32
_LOW = (1 << _HALF) - 1

#: A point in well-known binary: byte order and type in 5 bytes, then doubles.
_HEAD_BYTES = 5
_DOUBLE_BYTES = 8
_MAX_POINT_BYTES = _HEAD_BYTES + 4 * _DOUBLE_BYTES

#: Texts or bytes of a block are at most so long.
_MAX_TEXT_BYTES = 1 << 26

#: Largest power of ten by which integers are divided.
_MAX_POWER = 9

#: Powers of ten of units of time.
_UNIT_DIGITS = {"s": 0, "ms": 3, "us": 6, "ns": 9}

_Ints = NDArray[np.int64]


class Integers:
    """Columns of integers, and the digits after the point of each."""

    def __init__(self) -> None:
        self.columns: list[_Ints] = []
        self.digits: list[int] = []

    def add(self, values: _Ints, digits: int = 0) -> None:
        """Add a column."""
        self.columns.append(values)
        self.digits.append(digits)


def encode_array(array: Any, integers: Integers, finder: GuideFinder) -> bytes:
    """Encode a column: its numbers become columns of integers, all else bytes.

    Parameters
    ----------
    array : pyarrow.Array
        The column.
    integers : Integers
        Columns of integers are added.
    finder : GuideFinder
        Finds what walks tell of numbers in texts.

    Raises
    ------
    OverflowError
        If texts or bytes take more memory than readers give them.
    """
    # Which values are missing.
    valid = _valid(array)
    parts = [bytes([not valid.all()])]
    if not valid.all():
        parts.append(encode_column(valid.astype(np.int64))[0])
    if not valid.any():
        return b"".join([*parts, bytes([_NOTHING])])

    kind = array.type
    if _is_integer(kind):
        parts.append(_encode_integers(_filled(_to_integers(array), valid), kind, integers))
    elif pa.types.is_float32(kind) or pa.types.is_float64(kind):
        floats = _filled(_to_numpy(array), valid)
        parts.append(_encode_floats(floats, integers))
    elif pa.types.is_struct(kind):
        parts.append(bytes([_STRUCT]))
        for i in range(kind.num_fields):
            child = encode_array(_child(array, i), integers, finder)
            parts.append(encode_varint(len(child)) + child)
    elif pa.types.is_binary(kind) and (points := _points(array, valid)) is not None:
        head, floats = points
        parts.append(bytes([_POINTS, len(head) + floats.shape[1] * _DOUBLE_BYTES]) + head)
        parts += [_encode_floats(np.ascontiguousarray(f), integers) for f in floats.T]
    elif _is_text(kind):
        parts.append(_encode_texts(array, valid, integers, finder))
    else:
        parts.append(_encode_as_arrow(array))
    return b"".join(parts)


def decode_array(
    cursor: Cursor, kind: Any, rows: int, integers: Iterator[_Ints], trails: Trails
) -> Any:
    """Undo :func:`encode_array` for a column of a type and a number of rows.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no such column.
    """
    # Which values are missing.
    valid = np.ones(rows, np.bool_)
    if cursor.read_byte("whether values are missing"):
        valid = decode_column(cursor, rows)[0] != 0
    method = cursor.read_byte("the method of a column")

    # The values.
    if method == _NOTHING:
        return pa.nulls(rows, kind)
    if method == _STRUCT and pa.types.is_struct(kind):
        children = [
            decode_array(column_bytes(cursor), kind.field(i).type, rows, integers, trails)
            for i in range(kind.num_fields)
        ]
        return pa.StructArray.from_arrays(children, fields=list(kind), mask=pa.array(~valid))
    if method == _ARROW:
        return _read_as_arrow(cursor, kind, rows)
    return _decode_values(cursor, method, kind, valid, integers, trails)


def _decode_values(
    cursor: Cursor,
    method: int,
    kind: Any,
    valid: NDArray[np.bool_],
    integers: Iterator[_Ints],
    trails: Trails,
) -> Any:
    """Decode numbers, texts or points."""
    rows = len(valid)
    if method in {_INTEGERS, _HALVES, _SCALED} and _is_integer(kind):
        return _from_integers(_read_integers(cursor, method, integers), kind, valid)
    if method in {_DECIMALS, _BITS} and pa.types.is_floating(kind):
        size = 4 if pa.types.is_float32(kind) else 8
        return pa.array(_read_floats(cursor, method, size, rows, integers), kind, mask=~valid)
    if method == _POINTS and pa.types.is_binary(kind):
        return _read_points(cursor, kind, rows, valid, integers)
    if method == _TEXTS and _is_text(kind):
        return _read_texts(cursor, kind, valid, next(integers), trails)
    raise cursor.error(f"no column of {kind} is coded by method {method}")


def count_integers(cursor: Cursor, kind: Any, rows: int) -> int:
    """Number of columns of integers of a column; it is passed over.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no such column.
    """
    if cursor.read_byte("whether values are missing"):
        decode_column(cursor, rows)
    method = cursor.read_byte("the method of a column")
    if method == _STRUCT and pa.types.is_struct(kind):
        fields = [kind.field(i).type for i in range(kind.num_fields)]
        return sum(count_integers(column_bytes(cursor), field, rows) for field in fields)
    if method in {_DECIMALS, _BITS}:
        return _skip_floats(cursor, method, 4 if pa.types.is_float32(kind) else 8, rows)
    if method == _POINTS:
        size = cursor.read_byte("the size of a point")
        cursor.read_bytes(_HEAD_BYTES, "a point's head")
        axes = range((size - _HEAD_BYTES) // _DOUBLE_BYTES)
        return sum(
            _skip_floats(cursor, cursor.read_byte("the method of floats"), _DOUBLE_BYTES, rows)
            for _ in axes
        )
    cursor.read_rest()
    return {_INTEGERS: 1, _SCALED: 1, _HALVES: 2, _TEXTS: 1}.get(method, 0)


def order_keys(array: Any) -> _Ints | None:
    """A number for each value by which rows may be in order; None for what has none.

    It tells nothing of other rows: missing values have 0.
    """
    if _is_integer(array.type):
        return _to_integers(array)
    if pa.types.is_float64(array.type):
        return _ordered_bits(_to_numpy(array))
    return None


def column_bytes(cursor: Cursor) -> Cursor:
    """The bytes of a column, whose length comes first; they are passed over."""
    length = cursor.read_varint("the length of a column")
    inside = Cursor(cursor.data, cursor.offset, cursor.offset + length, cursor.base)
    cursor.read_bytes(length, "a column")
    return inside


# Integers


def _is_integer(kind: Any) -> bool:
    """Whether values are integers of at most 64 bits."""
    return bool(
        pa.types.is_integer(kind)
        or pa.types.is_boolean(kind)
        or pa.types.is_timestamp(kind)
        or pa.types.is_date(kind)
        or pa.types.is_time(kind)
        or pa.types.is_duration(kind)
    )


def _encode_integers(values: _Ints, kind: Any, integers: Integers) -> bytes:
    """Encode integers, as halves if they are too large."""
    digits = _UNIT_DIGITS.get(getattr(kind, "unit", ""), 0)
    if ((values > -MAX_VALUE) & (values < MAX_VALUE)).all():
        integers.add(values, digits)
        return bytes([_INTEGERS])
    # Nanoseconds since 1970 mostly end with zeros, or lie within a few years.
    power = next(p for p in range(_MAX_POWER, -1, -1) if not (values % 10**p).any())
    offset = 0 if power else int(values[0])
    scaled = (values - offset) // 10**power
    is_near = int(values.max()) - int(values.min()) < MAX_VALUE
    if (power or is_near) and ((scaled > -MAX_VALUE) & (scaled < MAX_VALUE)).all():
        integers.add(scaled, max(digits - power, 0))
        return bytes([_SCALED, power]) + encode_signed(offset)
    integers.add(values >> _HALF)
    integers.add(values & _LOW)
    return bytes([_HALVES])


def _read_integers(cursor: Cursor, method: int, integers: Iterator[_Ints]) -> _Ints:
    """Undo :func:`_encode_integers` after the method."""
    if method == _INTEGERS:
        return next(integers)
    if method == _SCALED:
        power, offset = cursor.read_byte("a power of ten"), cursor.read_signed("an offset")
        if power > _MAX_POWER or not -(1 << 63) <= offset < 1 << 63:
            raise cursor.error("a column of integers is out of range")
        scaled: _Ints = next(integers) * np.int64(10**power) + np.int64(offset)
        return scaled
    high = next(integers)
    found: _Ints = (high << _HALF) | (next(integers) & _LOW)
    return found


def _storage(kind: Any) -> Any:
    """Integers that hold values of a type."""
    if pa.types.is_integer(kind):
        return kind
    is_short = pa.types.is_date32(kind) or pa.types.is_time32(kind)
    return pa.int32() if is_short else pa.int64()


def _to_integers(array: Any) -> _Ints:
    """Values as integers of 64 bits; missing ones are any."""
    if pa.types.is_boolean(array.type):
        return np.asarray(array.cast(pa.int8()).fill_null(0)).astype(np.int64)
    return _to_numpy(array.view(_storage(array.type))).astype(np.int64)


def _from_integers(values: _Ints, kind: Any, valid: NDArray[np.bool_]) -> Any:
    """Values of a type from integers."""
    if pa.types.is_boolean(kind):
        return pa.array(values != 0, mask=~valid)
    storage = _storage(kind)
    return pa.array(values.astype(storage.to_pandas_dtype()), mask=~valid).view(kind)


# Floats


def _encode_floats(floats: NDArray[Any], integers: Integers) -> bytes:
    """Encode floats by the digits that they have, else by their bits."""
    # The fewest digits from which nearly all come back bit by bit.
    bits = floats.view(f"i{floats.itemsize}")
    for digits in range(_MAX_DIGITS + 1):
        with np.errstate(all="ignore"):
            scaled = np.rint(floats.astype(np.float64) * 10.0**digits)
            is_exact = np.abs(scaled) < _MAX_EXACT
            # Minus zero is no integer.
            whole = np.where(is_exact, scaled, 0).astype(np.int64)
            back = (whole / 10.0**digits).astype(floats.dtype)
        is_exact &= back.view(bits.dtype) == bits
        rows = np.flatnonzero(~is_exact)
        if len(rows) * _EXCEPTION_SHARE <= len(floats):
            integers.add(_filled(whole, is_exact), digits)
            gaps = np.diff(rows, prepend=-1) - 1
            return b"".join(
                [
                    bytes([_DECIMALS, digits]),
                    encode_varint(len(rows)),
                    *map(encode_varint, gaps.tolist()),
                    floats[rows].astype(f"<f{floats.itemsize}").tobytes(),
                ]
            )
    ordered = _ordered_bits(floats)
    if floats.itemsize < _DOUBLE_BYTES:
        integers.add(ordered)
        return bytes([_BITS])
    integers.add(ordered >> _HALF)
    integers.add(ordered & _LOW)
    return bytes([_BITS])


def _read_floats(
    cursor: Cursor, method: int, size: int, rows: int, integers: Iterator[_Ints]
) -> NDArray[Any]:
    """Undo :func:`_encode_floats` after the method."""
    if method == _BITS:
        ordered = (
            next(integers) if size < _DOUBLE_BYTES else _read_integers(cursor, _HALVES, integers)
        )
        sign = 8 * size - 1
        bits = ordered ^ ((ordered >> sign) & np.int64((1 << sign) - 1))
        return bits.astype(f"i{size}").view(f"f{size}")
    digits, places, exceptions = _read_exceptions(cursor, size, rows)
    floats = (next(integers) / 10.0**digits).astype(f"f{size}")
    floats[places] = exceptions
    return floats


def _read_exceptions(
    cursor: Cursor, size: int, rows: int
) -> tuple[int, NDArray[np.intp], NDArray[Any]]:
    """Digits of numbers, and which rows have others."""
    digits = cursor.read_byte("digits of numbers")
    count = cursor.read_varint("a number of exceptions")
    if digits > _MAX_DIGITS or count > cursor.remaining:
        raise cursor.error(f"{count} exceptions of numbers with {digits} digits")
    gaps = [cursor.read_varint("an exception") for _ in range(count)]
    if sum(gaps) + count > rows:
        raise cursor.error(f"an exception past the last of {rows} numbers")
    data = cursor.read_bytes(count * size, "exceptions")
    places = np.cumsum(np.array(gaps, np.int64) + 1) - 1
    return digits, places.astype(np.intp), np.frombuffer(data, f"<f{size}")


def _skip_floats(cursor: Cursor, method: int, size: int, rows: int) -> int:
    """Pass over floats after the method; return how many columns of integers they have."""
    if method == _BITS:
        return 1 if size < _DOUBLE_BYTES else 2
    _read_exceptions(cursor, size, rows)
    return 1


def _ordered_bits(floats: NDArray[Any]) -> _Ints:
    """Bits of floats as integers that are in the order of the floats."""
    bits = floats.view(f"i{floats.itemsize}").astype(np.int64)
    sign = 8 * floats.itemsize - 1
    found: _Ints = bits ^ ((bits >> sign) & np.int64((1 << sign) - 1))
    return found


# Texts and bytes


def _is_text(kind: Any) -> bool:
    """Whether values are texts or bytes, or numbers of these."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    return bool(
        pa.types.is_string(kind)
        or pa.types.is_large_string(kind)
        or pa.types.is_binary(kind)
        or pa.types.is_large_binary(kind)
    )


def _encode_texts(
    array: Any, valid: NDArray[np.bool_], integers: Integers, finder: GuideFinder
) -> bytes:
    """Encode texts: those that differ, and which each row has."""
    coded = array if pa.types.is_dictionary(array.type) else array.dictionary_encode()
    codes = _filled(_to_numpy(coded.indices).astype(np.int64), valid)
    # In the order in which rows first have them, without those that no row has.
    used, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty(len(order), np.int64)
    number[order] = np.arange(len(order))
    found = coded.dictionary.take(pa.array(used[order]))
    texts = found.cast(pa.large_binary()).to_pylist()
    integers.add(number[inverse])

    # Lines, whose numbers are coded as those of text; or texts with newlines, and their lengths.
    blob = b"\n".join(texts)
    head = bytes([_TEXTS]) + encode_varint(len(texts))
    if len(blob) <= MAX_BLOCK_BYTES and blob.count(b"\n") == len(texts) - 1 and blob:
        return head + b"\1" + encode_varint(len(blob)) + encode_block(blob, finder)
    lengths = np.array([len(text) for text in texts], np.int64)
    _check_size(int(lengths.sum()))
    return head + b"\0" + encode_column(lengths)[0] + pack_lzma(b"".join(texts))


def _check_size(size: int) -> None:
    """Refuse texts or bytes of a block that no reader would accept."""
    if size > _MAX_TEXT_BYTES:
        raise OverflowError(f"a column of {size} bytes; at most {_MAX_TEXT_BYTES} are allowed")


def _read_texts(
    cursor: Cursor, kind: Any, valid: NDArray[np.bool_], codes: _Ints, trails: Trails
) -> Any:
    """Undo :func:`_encode_texts` after the method."""
    count = cursor.read_varint("a number of texts")
    if not 0 < count <= len(valid):
        raise cursor.error(f"{count} texts of {len(valid)} rows")
    if cursor.read_byte("how texts are kept"):
        texts = decode_block(cursor, cursor.read_varint("bytes of texts"), trails).split(b"\n")
    else:
        lengths, _ = decode_column(cursor, count)
        if lengths.min() < 0 or lengths.max() > _MAX_TEXT_BYTES:
            raise cursor.error("texts are too long")
        size = int(lengths.sum())
        if size > _MAX_TEXT_BYTES:
            raise cursor.error(f"{size} bytes of texts")
        blob = unpack_lzma(cursor.read_rest(), size, cursor.base + cursor.offset)
        ends = np.cumsum(lengths)
        texts = [
            blob[end - n : end] for end, n in zip(ends.tolist(), lengths.tolist(), strict=True)
        ]
    if len(texts) != count or codes.min() < 0 or codes.max() >= count:
        raise cursor.error(f"rows have none of {count} texts")

    # The texts of the rows, or a dictionary of them.
    value_type = kind.value_type if pa.types.is_dictionary(kind) else kind
    values = pa.array(texts, pa.large_binary()).cast(value_type)
    indices = pa.array(codes, mask=~valid)
    if pa.types.is_dictionary(kind):
        return pa.DictionaryArray.from_arrays(
            indices.cast(kind.index_type), values, ordered=kind.ordered
        )
    return values.take(indices)


def _points(array: Any, valid: NDArray[np.bool_]) -> tuple[bytes, NDArray[np.float64]] | None:
    """Head and doubles of points in well-known binary; None where values are no such points."""
    # All values have one size and one head.
    offsets = np.frombuffer(array.buffers()[1], np.int32)[array.offset :][: len(array) + 1]
    sizes = np.diff(offsets)[valid]
    size = int(sizes[0])
    is_point = size <= _MAX_POINT_BYTES and size % _DOUBLE_BYTES == _HEAD_BYTES
    if not is_point or size == _HEAD_BYTES or (sizes != size).any():
        return None
    data = np.frombuffer(array.buffers()[2], np.uint8)
    starts = _filled(offsets[:-1].astype(np.int64), valid)
    letters = data[starts[:, None] + np.arange(size)]
    head = letters[0, :_HEAD_BYTES].tobytes()
    if head[0] != 1 or (letters[:, :_HEAD_BYTES] != letters[0, :_HEAD_BYTES]).any():
        return None
    return head, np.ascontiguousarray(letters[:, _HEAD_BYTES:]).view("<f8").astype(np.float64)


def _read_points(
    cursor: Cursor, kind: Any, rows: int, valid: NDArray[np.bool_], integers: Iterator[_Ints]
) -> Any:
    """Undo what is encoded of :func:`_points`, after the method."""
    size = cursor.read_byte("the size of a point")
    if size > _MAX_POINT_BYTES or size % _DOUBLE_BYTES != _HEAD_BYTES:
        raise cursor.error(f"a point of {size} bytes")
    head = np.frombuffer(cursor.read_bytes(_HEAD_BYTES, "a point's head"), np.uint8)
    letters = np.empty((rows, size), np.uint8)
    letters[:, :_HEAD_BYTES] = head
    for axis in range((size - _HEAD_BYTES) // _DOUBLE_BYTES):
        method = cursor.read_byte("the method of floats")
        floats = _read_floats(cursor, method, _DOUBLE_BYTES, rows, integers).astype("<f8")
        start = _HEAD_BYTES + axis * _DOUBLE_BYTES
        letters[:, start : start + _DOUBLE_BYTES] = floats.view(np.uint8).reshape(rows, -1)
    present = letters[valid]
    offsets = np.append(0, np.cumsum(np.where(valid, size, 0))).astype(np.int32)
    mask = None if valid.all() else pa.array(valid).buffers()[1]
    buffers = [mask, pa.py_buffer(offsets), pa.py_buffer(present.tobytes())]
    return pa.Array.from_buffers(kind, rows, buffers)


def _encode_as_arrow(array: Any) -> bytes:
    """Encode a column of any type as Arrow writes it."""
    sink = pa.BufferOutputStream()
    batch = pa.record_batch([array], ["0"])
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    data = sink.getvalue().to_pybytes()
    _check_size(len(data))
    return bytes([_ARROW]) + encode_varint(len(data)) + pack_lzma(data)


def _read_as_arrow(cursor: Cursor, kind: Any, rows: int) -> Any:
    """Undo :func:`_encode_as_arrow` after the method."""
    size = cursor.read_varint("bytes of a column of Arrow")
    if size > _MAX_TEXT_BYTES:
        raise cursor.error(f"a column of {size} bytes")
    data = unpack_lzma(cursor.read_rest(), size, cursor.base + cursor.offset)
    with pa.ipc.open_stream(data) as reader:
        batch = reader.read_next_batch()
    if batch.num_columns != 1:
        raise cursor.error(f"{batch.num_columns} columns of Arrow in place of one")
    column = batch.column(0)
    column.validate(full=True)
    if column.type != kind or len(column) != rows:
        raise cursor.error(f"a column of {column.type}, not {kind}")
    return column


# Arrays of Arrow and NumPy


def _valid(array: Any) -> NDArray[np.bool_]:
    """Which values are there."""
    found: NDArray[np.bool_] = np.asarray(array.is_valid())
    return found


def _to_numpy(array: Any) -> NDArray[Any]:
    """Numbers of a column; missing ones are zeros."""
    zero = pa.scalar(0, array.type)
    return np.array(array.fill_null(zero) if array.null_count else array)


def _filled(values: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[Any]:
    """Values where missing ones repeat the one before, or the first one there is."""
    if valid.all() or not valid.any():
        return values
    sources = np.maximum.accumulate(np.where(valid, np.arange(len(values)), -1))
    sources[sources < 0] = int(np.argmax(valid))
    return values[sources]


def _child(array: Any, number: int) -> Any:
    """A field of a struct, without values where the struct has none."""
    child = array.field(number)
    if not array.null_count:
        return child
    return pc.if_else(array.is_valid(), child, pa.scalar(None, child.type))
