"""Coding of kept columns, of any length in little memory: a column is read in pieces as often as its coding needs."""

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
    "BITS", "BYTES_PER_BYTE", "FREE_BYTES", "INTEGERS", "TEXT", "Column", "Values", "as_column", "write_column",
]  # fmt: skip

#: A packed block expands to at most so many bytes, and so many more for each of its own.
FREE_BYTES, BYTES_PER_BYTE = 1 << 20, 1 << 10

#: Kinds of columns; between INTEGERS and BITS are decimals with kind - 1 digits after the point.
INTEGERS, BITS, TEXT = 0, 11, 12
_DIGITS = 9
_EXACT = 2.0**53

#: Values on which the order of differences is tried, values that are worked on at a time, and packed bytes that are kept in memory.
_SAMPLE, _CHUNK, _HELD = 1 << 16, 1 << 20, 1 << 24

Values: TypeAlias = NDArray[np.generic]
_Ints = NDArray[np.int64]
_Pieces = Callable[[], Iterator[_Ints]]


class Column(Protocol):
    """Values that can be read as often as need be.

    Attributes
    ----------
    kind : str
        As NumPy calls it: ``i`` whole numbers, ``f`` numbers, ``U`` texts.
    texts : tuple of str
        The different texts of a column of texts in alphabetical order; its values are numbers into them.
    """

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def texts(self) -> tuple[str, ...]: ...  # noqa: D102
    def chunks(self) -> Iterator[Values]:
        """Yield the values from the first on, in pieces of any length."""
        ...


@dataclass(frozen=True, eq=False)
class _Held:
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
        If it holds what can't be kept.
    """
    if values.dtype.kind in "SUO":
        texts, codes = np.unique(
            np.array([_text(name, value) for value in values.tolist()], dtype=object),
            return_inverse=True,
        )
        return _Held("U", codes.reshape(-1).astype(np.int64), tuple(texts.tolist()))
    if values.dtype.kind in "biu":
        if len(values) and int(values.max()) >= 1 << 63:
            raise OptionError(
                f"column {name!r} holds {values.max()}, which is too large to be kept"
            )
        return _Held("i", values.astype(np.int64))
    if values.dtype.kind != "f":
        raise OptionError(f"column {name!r} holds {values.dtype}; numbers and texts can be kept")
    return _Held("f", values.astype(np.float64))


def _text(name: str, value: object) -> str:
    if value is None:
        return ""
    if not isinstance(value, str):
        raise OptionError(
            f"column {name!r} holds {value!r} among texts; numbers or texts can be kept, but not both"
        )
    return value


def write_column(column: Column, sink: BinaryIO) -> None:
    """Write byte of kind, order and holes; the holes; the texts; the numbers."""
    if column.kind == "U":
        _write_numbers(TEXT, lambda: _whole(column), sink, lambda: _pack_texts(column.texts, sink))
    elif column.kind == "i":
        _write_numbers(INTEGERS, lambda: _whole(column), sink)
    else:
        _write_floats(column, sink)


def _pack_texts(texts: tuple[str, ...], sink: BinaryIO) -> None:
    raw = [text.encode() for text in texts]
    joined = b"".join(encode_varint(len(text)) + text for text in raw)
    sink.write(encode_varint(len(raw)) + encode_varint(len(joined)))
    _pack(joined, sink)


def _whole(column: Column) -> Iterator[_Ints]:
    for values in column.chunks():
        yield values.astype(np.int64)


def _write_floats(column: Column, sink: BinaryIO) -> None:
    digits, holes = _decimals(column)
    if digits is None:
        _write_numbers(
            BITS,
            lambda: (values.astype(np.float64).view(np.int64) for values in column.chunks()),
            sink,
        )
        return
    _write_numbers(
        1 + digits,
        lambda: _scaled(column, digits),
        sink,
        (lambda: _pack_holes(column, sink)) if holes else None,
        holes=holes,
    )


def _decimals(column: Column) -> tuple[int | None, bool]:
    """Fewest digits after the point that give all numbers back, and whether there are holes among them."""
    left, holes = list(range(_DIGITS + 1)), False
    for values in column.chunks():
        known = values[~np.isnan(values)].astype(np.float64)
        holes |= len(known) < len(values)
        left = (
            [digits for digits in left if _gives_back(known, digits)]
            if (np.abs(known) < _EXACT).all()
            else []
        )
        if not left:
            return None, holes
    return left[0], holes


def _gives_back(known: NDArray[np.float64], digits: int) -> bool:
    scaled = np.rint(known * 10.0**digits)
    return bool(((np.abs(scaled) < _EXACT) & (scaled / 10.0**digits == known)).all())


def _scaled(column: Column, digits: int) -> Iterator[_Ints]:
    """Decimals as whole numbers; a hole holds what comes before it."""
    before = 0
    for values in column.chunks():
        numbers = values.astype(np.float64)
        holes = np.isnan(numbers)
        whole = np.zeros(len(numbers) + 1, np.int64)
        whole[0] = before
        whole[1:][~holes] = np.rint(numbers[~holes] * 10.0**digits).astype(np.int64)
        filled = whole[
            np.maximum.accumulate(np.append(0, np.where(holes, 0, np.arange(1, len(whole)))))
        ][1:]
        before = int(filled[-1])
        yield filled


def _pack_holes(column: Column, sink: BinaryIO) -> None:
    bits, left = bytearray(), np.zeros(0, np.bool_)
    for values in column.chunks():
        holes = np.concatenate([left, np.isnan(values)])
        whole = len(holes) // 8 * 8
        bits += np.packbits(holes[:whole]).tobytes()
        left = holes[whole:]
    _pack(bytes(bits) + np.packbits(left).tobytes(), sink)


def _write_numbers(
    kind: int,
    values: _Pieces,
    sink: BinaryIO,
    before: Callable[[], object] | None = None,
    *,
    holes: bool = False,
) -> None:
    """Write the differences of the order that packs a sample best."""
    sample = _first(values, _SAMPLE)
    order = min(
        range(3),
        key=lambda one: len(zlib.compress(_shuffled(_zigzag(_differences(sample, one)[1])), 1)),
    )
    sink.write(bytes([kind | order << 4 | holes << 6]))
    if before is not None:
        before()
    starts = _differences(sample, order)[0]

    def rest() -> Iterator[NDArray[np.uint64]]:
        last = np.zeros(0, np.int64)
        for some in values():
            joined = np.concatenate([last, some])
            last = joined[max(len(joined) - order, 0) :]
            if len(joined) > order:
                yield _zigzag(np.diff(joined, n=order))

    width = math.ceil(max((int(some.max()) for some in rest()), default=0).bit_length() / 8)
    sink.write(b"".join(map(encode_signed, starts)) + bytes([width]))
    size = width * sum(len(some) for some in rest())
    _pack_stream(
        size, lambda: (_plane(some, place) for place in range(width) for some in rest()), sink
    )


def _first(values: _Pieces, count: int) -> _Ints:
    found, length = [np.zeros(0, np.int64)], 0
    for some in values():
        found.append(some[: count - length])
        length += len(found[-1])
        if length == count:
            break
    return np.concatenate(found)


def _differences(values: _Ints, order: int) -> tuple[list[int], _Ints]:
    """First values, and differences of the others, all modulo 2^64."""
    starts = []
    for _ in range(order):
        starts.append(int(values[0]) if len(values) else 0)
        values = np.diff(values)
    return starts, values


def _zigzag(values: _Ints) -> NDArray[np.uint64]:
    """Numbers with their sign in the lowest bit."""
    signed_last: NDArray[np.uint64] = ((values << 1) ^ (values >> 63)).view(np.uint64)
    return signed_last


def _plane(values: NDArray[np.uint64], place: int) -> bytes:
    return values.astype("<u8").view(np.uint8).reshape(-1, 8)[:, place].tobytes()


def _shuffled(values: NDArray[np.uint64]) -> bytes:
    """All lowest bytes, then all second lowest, and so on, as many as the largest takes."""
    width = math.ceil(int(values.max()).bit_length() / 8) if len(values) else 0
    return b"".join(_plane(values, place) for place in range(width))


def _pack(data: bytes, sink: BinaryIO) -> None:
    tries = [(0, data), (1, deflate(data)), (2, pack_lzma(data))]
    allowed = [
        (number, one) for number, one in tries if not number or _allowed(len(data), len(one))
    ]
    packing, shortest = min(allowed, key=lambda one: len(one[1]))
    sink.write(encode_varint(4 * len(shortest) + packing) + shortest)


def _allowed(size: int, packed: int) -> bool:
    return size <= FREE_BYTES + BYTES_PER_BYTE * packed


def _pack_stream(size: int, pieces: Callable[[], Iterator[bytes]], sink: BinaryIO) -> None:
    """Pack what may be too much for memory."""
    if size <= LARGE:
        _pack(b"".join(pieces()), sink)
        return
    packers = (deflater(), lzma_packer())
    with tempfile.SpooledTemporaryFile(_HELD) as one, tempfile.SpooledTemporaryFile(_HELD) as other:
        files = (one, other)
        for piece in pieces():
            for file, packer in zip(files, packers, strict=True):
                file.write(packer.compress(piece))
        sizes = {0: size}
        for number, (file, packer) in enumerate(zip(files, packers, strict=True), 1):
            file.write(packer.flush())
            if _allowed(size, file.tell()):
                sizes[number] = file.tell()
        packing = min(sizes, key=sizes.__getitem__)
        sink.write(encode_varint(4 * sizes[packing] + packing))
        for piece in pieces() if packing == 0 else _contents(files[packing - 1]):
            sink.write(piece)


def _contents(file: tempfile.SpooledTemporaryFile[bytes]) -> Iterator[bytes]:
    file.seek(0)
    while piece := file.read(_CHUNK):
        yield piece
