"""Coding of kept columns, of any length in little memory: a column is read as often as needed.

Numbers become integers where that is exact, integers become differences of the order that packs
best, and differences become byte planes: all lowest bytes, then all second lowest, and so on.
"""

from __future__ import annotations

import math
import tempfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gpszip.container.expansion import LARGE, deflate, deflater, lzma_packer, pack_lzma
from gpszip.container.layout import encode_signed, encode_varint
from gpszip.errors import OptionError

__all__ = [
    "BITS",
    "BYTES_PER_BYTE",
    "DEFLATED",
    "FREE_BYTES",
    "INTEGERS",
    "LZMA",
    "STORED",
    "TEXT",
    "Column",
    "Values",
    "as_column",
    "count_digits",
    "scaled",
    "write_column",
]

#: A packed block expands to at most this many bytes, and so many more for each byte of its own, so
#: that forged sizes cannot ask for memory.
FREE_BYTES = 1 << 20
BYTES_PER_BYTE = 1 << 10

#: Kinds of columns; between INTEGERS and BITS are decimals with kind - 1 digits after the point.
INTEGERS = 0
BITS = 11  # float64 bit by bit
TEXT = 12

#: How a block is packed.
STORED = 0
DEFLATED = 1
LZMA = 2

#: Digits after the point of decimals, at most.
_MAX_DIGITS = 9

#: Decimals are below this, so that they are exact as integers and as float64.
_MAX_EXACT = 2.0**53

#: Largest order of differences, and values on which orders are tried.
_MAX_ORDER = 2
_SAMPLE_VALUES = 1 << 16

#: Values that are worked on at a time.
_CHUNK = 1 << 20

#: Bytes of a packed block that stay in memory; more go to a temporary file.
_MAX_SPOOLED = 1 << 24

Values: TypeAlias = NDArray[np.generic]
_Ints = NDArray[np.int64]
_IntChunks = Callable[[], Iterator[_Ints]]


class Column(Protocol):
    """Values that can be read as often as needed.

    Attributes
    ----------
    kind : str
        NumPy's code: ``i`` for integers, ``f`` for numbers, ``U`` for texts.
    texts : tuple of str
        The distinct texts of a column of texts in alphabetical order; its values are indices into
        them.
    """

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def texts(self) -> tuple[str, ...]: ...  # noqa: D102
    def chunks(self) -> Iterator[Values]:
        """Yield the values from the first on, in chunks of any length."""
        ...


@dataclass(frozen=True, eq=False)
class _ArrayColumn:
    """A column in memory."""

    kind: str
    values: Values
    texts: tuple[str, ...] = ()

    def chunks(self) -> Iterator[Values]:
        for first in range(0, len(self.values), _CHUNK):
            yield self.values[first : first + _CHUNK]


def as_column(name: str, values: Values) -> Column:
    """Return an array as a column.

    Raises
    ------
    OptionError
        If it holds values that can't be kept.
    """
    if values.dtype.kind in "SUO":
        # unique sorts the texts, so that codes have their alphabetical order.
        texts, codes = np.unique(
            np.array([_as_text(name, value) for value in values.tolist()], dtype=object),
            return_inverse=True,
        )
        return _ArrayColumn("U", codes.reshape(-1).astype(np.int64), tuple(texts.tolist()))
    if values.dtype.kind in "biu":
        # Unsigned numbers from 2**63 on would become negative.
        if len(values) and int(values.max()) >= 1 << 63:
            raise OptionError(
                f"column {name!r} holds {values.max()}, which is too large to be kept"
            )
        return _ArrayColumn("i", values.astype(np.int64))
    if values.dtype.kind != "f":
        raise OptionError(
            f"column {name!r} holds {values.dtype}", remedy="numbers and texts can be kept"
        )
    return _ArrayColumn("f", values.astype(np.float64))


def _as_text(name: str, value: object) -> str:
    """A value of a column of texts; None counts as an empty text."""
    if value is None:
        return ""
    if not isinstance(value, str):
        raise OptionError(
            f"column {name!r} holds {value!r} among texts",
            remedy="numbers or texts can be kept, but not both",
        )
    return value


def write_column(column: Column, sink: BinaryIO) -> None:
    """Write a byte of kind, order and holes; the holes; the texts; the numbers."""
    if column.kind == "U":
        _write_numbers(
            TEXT, lambda: _integers(column), sink, lambda: _pack_texts(column.texts, sink)
        )
    elif column.kind == "i":
        _write_numbers(INTEGERS, lambda: _integers(column), sink)
    else:
        _write_floats(column, sink)


def _pack_texts(texts: tuple[str, ...], sink: BinaryIO) -> None:
    """Write the number of texts, their size, and a packed block of lengths and texts."""
    encoded = [text.encode() for text in texts]
    block = b"".join(encode_varint(len(text)) + text for text in encoded)
    sink.write(encode_varint(len(encoded)) + encode_varint(len(block)))
    _pack(block, sink)


def _integers(column: Column) -> Iterator[_Ints]:
    """Chunks of a column of integers or texts."""
    for values in column.chunks():
        yield values.astype(np.int64)


def _float_bits(column: Column) -> Iterator[_Ints]:
    """Chunks of a column of numbers, the bits of each float64 as an integer."""
    for values in column.chunks():
        yield values.astype(np.float64).view(np.int64)


def _write_floats(column: Column, sink: BinaryIO) -> None:
    """Write a column of numbers, as decimals if that is exact."""
    digits, holes = count_digits(column)
    # No number of digits is exact: keep the bits of each number.
    if digits is None:
        _write_numbers(BITS, lambda: _float_bits(column), sink)
        return
    write_holes = (lambda: _pack_holes(column, sink)) if holes else None
    _write_numbers(1 + digits, lambda: scaled(column, digits), sink, write_holes, holes=holes)


def count_digits(column: Column) -> tuple[int | None, bool]:
    """Fewest digits after the point that are exact, or None, and whether any number is missing.

    Parameters
    ----------
    column : Column
        Of numbers.
    """
    possible, holes = list(range(_MAX_DIGITS + 1)), False
    for values in column.chunks():
        numbers = values[~np.isnan(values)].astype(np.float64)
        holes |= len(numbers) < len(values)
        # Infinite numbers are no decimals, either.
        if not (np.abs(numbers) < _MAX_EXACT).all():
            return None, holes
        # Only numbers of digits that were exact in all chunks before are tried.
        possible = [digits for digits in possible if _is_exact(numbers, digits)]
        if not possible:
            return None, holes
    return possible[0], holes


def _is_exact(numbers: NDArray[np.float64], digits: int) -> bool:
    """Whether all numbers come back from decimals with so many digits after the point."""
    scaled = np.rint(numbers * 10.0**digits)
    return bool(((np.abs(scaled) < _MAX_EXACT) & (scaled / 10.0**digits == numbers)).all())


def scaled(column: Column, digits: int) -> Iterator[_Ints]:
    """Decimals as integers; a missing one is filled with the one before it."""
    before = 0
    for values in column.chunks():
        numbers = values.astype(np.float64)
        holes = np.isnan(numbers)

        # Element 0 is the last number of the chunk before.
        integers = np.zeros(len(numbers) + 1, np.int64)
        integers[0] = before
        integers[1:][~holes] = np.rint(numbers[~holes] * 10.0**digits).astype(np.int64)

        # The index of the last number that is there, for each element.
        sources = np.append(0, np.where(holes, 0, np.arange(1, len(integers))))
        filled = integers[np.maximum.accumulate(sources)][1:]
        before = int(filled[-1])
        yield filled


def _pack_holes(column: Column, sink: BinaryIO) -> None:
    """Write a packed block with a bit for each number, set where it is missing."""
    data, rest = bytearray(), np.zeros(0, np.bool_)
    for values in column.chunks():
        # Bits are packed by eights; those left over go before the next chunk.
        holes = np.concatenate([rest, np.isnan(values)])
        full = len(holes) // 8 * 8
        data += np.packbits(holes[:full]).tobytes()
        rest = holes[full:]
    _pack(bytes(data) + np.packbits(rest).tobytes(), sink)


def _write_numbers(
    kind: int,
    chunks: _IntChunks,
    sink: BinaryIO,
    write_before: Callable[[], object] | None = None,
    *,
    holes: bool = False,
) -> None:
    """Write integers as differences.

    Parameters
    ----------
    kind : int
        Kind of the column.
    chunks : callable
        Yields the integers, from the first on at each call.
    sink : binary file
        Where to write.
    write_before : callable, optional
        Writes what lies between the first byte and the numbers.
    holes : bool, default False
        Whether any number is missing.
    """
    # The order of differences that packs a sample best.
    sample = _take_first(chunks, _SAMPLE_VALUES)
    order = min(range(_MAX_ORDER + 1), key=lambda order: _packed_size(sample, order))
    sink.write(bytes([kind | order << 4 | holes << 6]))
    if write_before is not None:
        write_before()

    # The first values, the bytes of the largest difference, and the differences.
    starts = _differences(sample, order)[0]
    largest = max((int(chunk.max()) for chunk in _zigzag_chunks(chunks, order)), default=0)
    width = math.ceil(largest.bit_length() / 8)
    sink.write(b"".join(map(encode_signed, starts)) + bytes([width]))
    size = width * sum(len(chunk) for chunk in _zigzag_chunks(chunks, order))
    _pack_stream(size, lambda: _byte_planes(chunks, order, width), sink)


def _packed_size(values: _Ints, order: int) -> int:
    """Bytes that differences of an order take when they are packed quickly."""
    return len(zlib.compress(_shuffled(_zigzag(_differences(values, order)[1])), 1))


def _zigzag_chunks(chunks: _IntChunks, order: int) -> Iterator[NDArray[np.uint64]]:
    """Differences of an order, chunk by chunk."""
    last = np.zeros(0, np.int64)
    for chunk in chunks():
        # The first differences of a chunk need the last values of the chunk before.
        values = np.concatenate([last, chunk])
        last = values[max(len(values) - order, 0) :]
        if len(values) > order:
            yield _zigzag(np.diff(values, n=order))


def _byte_planes(chunks: _IntChunks, order: int, width: int) -> Iterator[bytes]:
    """All lowest bytes of the differences, then all second lowest, and so on."""
    # Read the column once for each byte, so that only one chunk is in memory.
    for place in range(width):
        for chunk in _zigzag_chunks(chunks, order):
            yield _byte_plane(chunk, place)


def _take_first(chunks: _IntChunks, count: int) -> _Ints:
    """The first ``count`` values."""
    taken, length = [np.zeros(0, np.int64)], 0
    for chunk in chunks():
        taken.append(chunk[: count - length])
        length += len(taken[-1])
        if length == count:
            break
    return np.concatenate(taken)


def _differences(values: _Ints, order: int) -> tuple[list[int], _Ints]:
    """First value of each order, and differences of the others, all modulo 2**64."""
    starts = []
    for _ in range(order):
        starts.append(int(values[0]) if len(values) else 0)
        values = np.diff(values)
    return starts, values


def _zigzag(values: _Ints) -> NDArray[np.uint64]:
    """Numbers with their sign in the lowest bit: 0, -1, 1, -2, ... as 0, 1, 2, 3, ..."""
    # values >> 63 is -1 for negative numbers, which inverts all bits, and 0 for others.
    folded: NDArray[np.uint64] = ((values << 1) ^ (values >> 63)).view(np.uint64)
    return folded


def _byte_plane(values: NDArray[np.uint64], place: int) -> bytes:
    """One byte of each number; place 0 is the lowest."""
    # Bytes are in the same order on any machine.
    return values.astype("<u8").view(np.uint8).reshape(-1, 8)[:, place].tobytes()


def _shuffled(values: NDArray[np.uint64]) -> bytes:
    """All byte planes, as many as the largest number takes."""
    width = math.ceil(int(values.max()).bit_length() / 8) if len(values) else 0
    return b"".join(_byte_plane(values, place) for place in range(width))


def _pack(data: bytes, sink: BinaryIO) -> None:
    """Write a block in the shortest packing: a varint of its length and packing, the bytes."""
    # Data that expand more than a reader allows are stored.
    packings = [(STORED, data), (DEFLATED, deflate(data)), (LZMA, pack_lzma(data))]
    allowed = [
        (packing, body)
        for packing, body in packings
        if packing == STORED or _may_expand(len(body), len(data))
    ]
    packing, body = min(allowed, key=lambda candidate: len(candidate[1]))
    sink.write(encode_varint(4 * len(body) + packing) + body)


def _may_expand(packed: int, size: int) -> bool:
    """Whether a reader lets a packed block expand to ``size`` bytes."""
    return size <= FREE_BYTES + BYTES_PER_BYTE * packed


def _pack_stream(size: int, chunks: Callable[[], Iterator[bytes]], sink: BinaryIO) -> None:
    """Write a block in the shortest packing, where it may be too large for memory."""
    # Pack a small block in memory; a larger one goes through spooled files.
    if size <= LARGE:
        _pack(b"".join(chunks()), sink)
        return
    packers = (deflater(), lzma_packer())
    with (
        tempfile.SpooledTemporaryFile(_MAX_SPOOLED) as deflate_file,
        tempfile.SpooledTemporaryFile(_MAX_SPOOLED) as lzma_file,
    ):
        # Pack in both ways at once.
        files = (deflate_file, lzma_file)
        for chunk in chunks():
            for file, packer in zip(files, packers, strict=True):
                file.write(packer.compress(chunk))
        sizes = {STORED: size}
        for packing, (file, packer) in enumerate(zip(files, packers, strict=True), DEFLATED):
            file.write(packer.flush())
            if _may_expand(file.tell(), size):
                sizes[packing] = file.tell()

        # Write the shortest.
        packing = min(sizes, key=sizes.__getitem__)
        sink.write(encode_varint(4 * sizes[packing] + packing))
        # Stored bytes are in no file: they are computed again.
        for chunk in chunks() if packing == STORED else _read_chunks(files[packing - DEFLATED]):
            sink.write(chunk)


def _read_chunks(file: tempfile.SpooledTemporaryFile[bytes]) -> Iterator[bytes]:
    """The bytes of a file from its start on."""
    file.seek(0)
    while chunk := file.read(_CHUNK):
        yield chunk
