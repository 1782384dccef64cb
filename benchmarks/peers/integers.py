"""Columns of integers as bytes: those of ``gpszip experiment peers``, and an arithmetic one."""

from __future__ import annotations

from gpszip.experiments.peers.coders import (
    CODERS as SHARED,
)
from gpszip.experiments.peers.coders import (
    Coder,
    decode_varint,
    encode_varint,
    join,
    split,
)

from .log import Integers

__all__ = ["CODERS", "Coder", "decode_varint", "encode_varint", "join", "split"]


def encode_arithmetic(table: Integers) -> bytes:
    from .arithmetic import encode

    return encode(table)


def decode_arithmetic(data: bytes, rows: int, columns: int) -> Integers:
    from .arithmetic import decode

    return decode(data, rows, columns)


#: All coders by their names; a file holds the index of its coder. The arithmetic coder here codes
#: each number by the one before it in its row.
CODERS = {
    "pco": SHARED["pco"],
    "arithmetic": Coder(encode_arithmetic, decode_arithmetic),
    "bzip2": SHARED["bzip2"],
    "zstd": SHARED["zstd"],
}
