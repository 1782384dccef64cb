"""Tables of integers as bytes: bzip2, xz, Zstandard, pcodec, and an adaptive arithmetic coder."""

from __future__ import annotations

import bz2
import lzma
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["CODERS", "Coder", "decode_varint", "encode_varint", "join", "missing_coders", "split"]

#: The level of pcodec that takes longest to find its bins.
_PCO_LEVEL = 12

#: A high level of Zstandard; 20 and more need more memory for small gains.
_ZSTD_LEVEL = 19

#: Least bytes of a dictionary of xz.
_XZ_DICTIONARY = 4096

#: Bits of a byte of a variable-length number that hold digits; the other says that more follow.
_DIGITS = 7

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Coder:
    """A way to write a table of integers.

    Parameters
    ----------
    encode : callable
        Bytes of an int64 array of shape (rows, columns).
    decode : callable
        The array of its bytes, number of rows and number of columns.
    """

    encode: Callable[[Ints], bytes]
    decode: Callable[[bytes, int, int], Ints]


def _encode_pco(table: Ints) -> bytes:
    """Each column by pcodec, which chooses bins and differences itself."""
    from pcodec import ChunkConfig, standalone

    config = ChunkConfig(compression_level=_PCO_LEVEL)
    columns = [_narrow(column) for column in table.T]
    return join([standalone.simple_compress(column, config) for column in columns])


def _decode_pco(data: bytes, rows: int, columns: int) -> Ints:
    from pcodec import standalone

    # pcodec returns None for an empty column.
    parts = split(data, columns)
    table = [standalone.simple_decompress(part) if rows else [] for part in parts]
    return np.column_stack(table).astype(np.int64)


def _encode_arithmetic(table: Ints) -> bytes:
    """Each column by the range coder of ``compress --lossless``, which adapts to what it codes."""
    from gpszip.lossless.columns import encode_column

    return join([encode_column(np.ascontiguousarray(column))[0] for column in table.T])


def _decode_arithmetic(data: bytes, rows: int, columns: int) -> Ints:
    from gpszip.container.layout import Cursor
    from gpszip.lossless.columns import decode_column

    parts = split(data, columns)
    return np.column_stack([decode_column(Cursor(part), rows)[0] for part in parts])


def _encode_bytes(compress: Callable[[bytes], bytes]) -> Callable[[Ints], bytes]:
    """Return a function that compresses each column: all lowest bytes, then the next ones, ..."""
    return lambda table: join(
        [bytes([len(plane)]) + compress(plane.tobytes()) for plane in _planes(table)]
    )


def _decode_bytes(decompress: Callable[[bytes, int], bytes]) -> Callable[[bytes, int, int], Ints]:
    """Return the inverse; ``decompress`` is also given the number of bytes that it returns."""

    def decode(data: bytes, rows: int, columns: int) -> Ints:
        parts = split(data, columns)
        return _from_planes([(p[0], decompress(p[1:], rows * p[0])) for p in parts], rows)

    return decode


def _compress_xz(data: bytes) -> bytes:
    """Compress with a dictionary as long as the data: that of level 9 takes 64 MiB to set up."""
    size = max(len(data), _XZ_DICTIONARY)
    filters = [{"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": size}]
    return lzma.compress(data, filters=filters)


def _compress_zstd(data: bytes) -> bytes:
    import pyarrow as pa

    compressed: bytes = pa.Codec("zstd", compression_level=_ZSTD_LEVEL).compress(data, asbytes=True)
    return compressed


def _decompress_zstd(data: bytes, size: int) -> bytes:
    import pyarrow as pa

    plain: bytes = pa.Codec("zstd").decompress(data, size, asbytes=True)
    return plain


#: All coders by their names. Files hold the index of theirs, so new ones come last.
CODERS = {
    "pco": Coder(_encode_pco, _decode_pco),
    "arithmetic": Coder(_encode_arithmetic, _decode_arithmetic),
    "bzip2": Coder(
        _encode_bytes(bz2.compress), _decode_bytes(lambda data, _: bz2.decompress(data))
    ),
    "zstd": Coder(_encode_bytes(_compress_zstd), _decode_bytes(_decompress_zstd)),
    "xz": Coder(
        _encode_bytes(_compress_xz),
        _decode_bytes(lambda data, _: lzma.decompress(data)),
    ),
}


def missing_coders() -> list[str]:
    """Return the names of coders whose packages are not installed."""
    from importlib.util import find_spec

    return [] if find_spec("pcodec") else ["pco"]


def _narrow(column: Ints) -> NDArray[np.signedinteger]:
    """The column in the narrowest type that holds it."""
    low, high = column.min(initial=0), column.max(initial=0)
    for kind in (np.int16, np.int32):
        if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max:
            return np.ascontiguousarray(column, kind)
    return np.ascontiguousarray(column)


def _planes(table: Ints) -> list[NDArray[np.uint8]]:
    """For each column, an array of shape (bytes of a number, rows): its lowest bytes come first."""
    columns = [_narrow(column) for column in table.T]
    return [np.ascontiguousarray(c.view(np.uint8).reshape(len(c), c.itemsize).T) for c in columns]


def _from_planes(parts: Sequence[tuple[int, bytes]], rows: int) -> Ints:
    """The table of the planes of each column, given with the bytes of a number."""
    kinds = {2: np.int16, 4: np.int32, 8: np.int64}
    columns = []
    for width, data in parts:
        plane = np.frombuffer(data, np.uint8).reshape(width, rows)
        columns.append(np.ascontiguousarray(plane.T).view(kinds[width]).ravel())
    return np.column_stack(columns).astype(np.int64)


def join(parts: Sequence[bytes]) -> bytes:
    r"""Parts behind one another, each after its length.

    Examples
    --------
    >>> join([b"ab", b""])
    b'\x02ab\x00'
    """
    return b"".join(encode_varint(len(part)) + part for part in parts)


def split(data: bytes, count: int) -> list[bytes]:
    r"""The parts that were joined.

    Examples
    --------
    >>> split(b"\x02ab\x00", 2)
    [b'ab', b'']
    """
    parts, at = [], 0
    for _ in range(count):
        length, at = decode_varint(data, at)
        parts.append(data[at : at + length])
        at += length
    return parts


def encode_varint(value: int) -> bytes:
    """Seven bits in a byte, lowest first; the high bit says that more follow.

    Examples
    --------
    >>> list(encode_varint(300))
    [172, 2]
    """
    data = bytearray()
    more = 1 << _DIGITS
    while value >= more:
        data.append(value & (more - 1) | more)
        value >>= _DIGITS
    return bytes([*data, value])


def decode_varint(data: bytes, at: int) -> tuple[int, int]:
    """The number at an offset, and the offset behind it.

    Examples
    --------
    >>> decode_varint(bytes([172, 2, 9]), 0)
    (300, 2)
    """
    value = shift = 0
    more = 1 << _DIGITS
    while True:
        value |= (data[at] & (more - 1)) << shift
        shift += _DIGITS
        at += 1
        if data[at - 1] < more:
            return value, at
