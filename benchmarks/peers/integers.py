"""Columns of integers as bytes: pcodec, an adaptive arithmetic coder, bzip2, Zstandard."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .log import Integers


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

    encode: Callable[[Integers], bytes]
    decode: Callable[[bytes, int, int], Integers]


def encode_pco(table: Integers) -> bytes:
    """Each column by pcodec, which chooses bins and differences itself."""
    from pcodec import ChunkConfig, standalone

    config = ChunkConfig(compression_level=PCO_LEVEL)
    columns = [narrow(column) for column in table.T]
    return join([standalone.simple_compress(column, config) for column in columns])


def decode_pco(data: bytes, rows: int, columns: int) -> Integers:
    from pcodec import standalone

    # pcodec returns None for an empty column.
    parts = split(data, columns)
    table = [standalone.simple_decompress(part) if rows else [] for part in parts]
    return np.column_stack(table).astype(np.int64)


def encode_bzip2(table: Integers) -> bytes:
    return join([bytes([len(column)]) + bz2.compress(column) for column in planes(table)])


def decode_bzip2(data: bytes, rows: int, columns: int) -> Integers:
    parts = split(data, columns)
    return from_planes([(part[0], bz2.decompress(part[1:])) for part in parts], rows)


def encode_zstd(table: Integers) -> bytes:
    import pyarrow as pa

    codec = pa.Codec("zstd", compression_level=ZSTD_LEVEL)
    return join(
        [
            bytes([len(column)]) + codec.compress(column.tobytes(), asbytes=True)
            for column in planes(table)
        ]
    )


def decode_zstd(data: bytes, rows: int, columns: int) -> Integers:
    import pyarrow as pa

    codec, parts = pa.Codec("zstd"), split(data, columns)
    plain = [(part[0], codec.decompress(part[1:], rows * part[0], asbytes=True)) for part in parts]
    return from_planes(plain, rows)


def encode_arithmetic(table: Integers) -> bytes:
    from .arithmetic import encode

    return encode(table)


def decode_arithmetic(data: bytes, rows: int, columns: int) -> Integers:
    from .arithmetic import decode

    return decode(data, rows, columns)


#: The level of pcodec that takes longest to find its bins.
PCO_LEVEL = 12

#: A high level of Zstandard; 20 and more need more memory for small gains.
ZSTD_LEVEL = 19

#: All coders by their names; a file holds the index of its coder.
CODERS = {
    "pco": Coder(encode_pco, decode_pco),
    "arithmetic": Coder(encode_arithmetic, decode_arithmetic),
    "bzip2": Coder(encode_bzip2, decode_bzip2),
    "zstd": Coder(encode_zstd, decode_zstd),
}


def narrow(column: Integers) -> Integers:
    """The column in the narrowest type that holds it."""
    for kind in (np.int16, np.int32):
        if (
            np.iinfo(kind).min
            <= column.min(initial=0)
            <= column.max(initial=0)
            <= np.iinfo(kind).max
        ):
            return np.ascontiguousarray(column, kind)
    return np.ascontiguousarray(column)


def planes(table: Integers) -> list[Integers]:
    """For each column, an array of shape (bytes of a number, rows): its lowest bytes come first."""
    columns = [narrow(column) for column in table.T]
    return [np.ascontiguousarray(c.view(np.uint8).reshape(len(c), c.itemsize).T) for c in columns]


def from_planes(parts: list[tuple[int, bytes]], rows: int) -> Integers:
    """The table of the planes of each column, given with the bytes of a number."""
    kinds = {2: np.int16, 4: np.int32, 8: np.int64}
    columns = []
    for width, data in parts:
        plane = np.frombuffer(data, np.uint8).reshape(width, rows)
        columns.append(np.ascontiguousarray(plane.T).view(kinds[width]).ravel())
    return np.column_stack(columns).astype(np.int64)


def join(parts: list[bytes]) -> bytes:
    """Parts behind one another, each after its length."""
    return b"".join(encode_varint(len(part)) + part for part in parts)


def split(data: bytes, count: int) -> list[bytes]:
    """The parts that were joined."""
    parts, at = [], 0
    for _ in range(count):
        length, at = decode_varint(data, at)
        parts.append(data[at : at + length])
        at += length
    return parts


def encode_varint(value: int) -> bytes:
    """Seven bits in a byte, lowest first; the high bit says that more follow."""
    data = bytearray()
    while value > 127:
        data.append(value & 127 | 128)
        value >>= 7
    return bytes([*data, value])


def decode_varint(data: bytes, at: int) -> tuple[int, int]:
    """The number at an offset, and the offset behind it."""
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        shift += 7
        at += 1
        if data[at - 1] < 128:
            return value, at
