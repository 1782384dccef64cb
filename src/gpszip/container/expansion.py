"""Standard compressors on untrusted bytes: the result never grows past a limit."""

from __future__ import annotations

import bz2
import lzma
import zlib
from typing import Protocol

from gpszip.errors import CorruptArchiveError

__all__ = [
    "LARGE",
    "deflate",
    "deflater",
    "inflate",
    "lzma_packer",
    "pack_bz2",
    "pack_lzma",
    "unpack_bz2",
    "unpack_lzma",
]

#: Above so many bytes, LZMA is asked for its usual settings only.
LARGE = 1 << 20

_LZMA_WINDOW = 1 << 22
_READ = [{"id": lzma.FILTER_LZMA2, "dict_size": _LZMA_WINDOW}]


class _Compressor(Protocol):
    def compress(self, data: bytes, /) -> bytes: ...
    def flush(self) -> bytes: ...


class _Decompressor(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, max_length: int = ..., /) -> bytes: ...


def deflate(data: bytes) -> bytes:
    """Raw deflate stream (RFC 1951)."""
    packer = deflater()
    return packer.compress(data) + packer.flush()


def deflater() -> _Compressor:
    """What writes a raw deflate stream piece by piece."""
    return zlib.compressobj(9, zlib.DEFLATED, -15, 9)


def inflate(data: bytes, limit: int, offset: int) -> bytes:
    """Undo :func:`deflate`; more than ``limit`` bytes or anything but one whole stream is refused."""
    return _whole(zlib.decompressobj(-15), data, limit, offset)


def pack_bz2(data: bytes) -> bytes:
    """One bzip2 stream."""
    return bz2.compress(data, 9)


def unpack_bz2(data: bytes, limit: int, offset: int) -> bytes:
    """Undo :func:`pack_bz2` within a limit."""
    return _whole(bz2.BZ2Decompressor(), data, limit, offset)


def pack_lzma(data: bytes) -> bytes:
    """Raw LZMA2 stream: of small data the shortest of several settings, of large the usual ones."""
    usual = {"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": _LZMA_WINDOW}
    tries = [usual, {**usual, "lc": 0, "pb": 0}, {**usual, "pb": 0}]
    if len(data) > LARGE:
        packer = lzma_packer()
        return packer.compress(data) + packer.flush()
    return min(
        (lzma.compress(data, format=lzma.FORMAT_RAW, filters=[one]) for one in tries), key=len
    )


def lzma_packer() -> _Compressor:
    """What writes a raw LZMA2 stream of much data piece by piece."""
    usual = {"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": _LZMA_WINDOW}
    return lzma.LZMACompressor(format=lzma.FORMAT_RAW, filters=[usual])


def unpack_lzma(data: bytes, limit: int, offset: int) -> bytes:
    """Undo :func:`pack_lzma` within a limit."""
    return _whole(lzma.LZMADecompressor(format=lzma.FORMAT_RAW, filters=_READ), data, limit, offset)


def _whole(unpacker: _Decompressor, data: bytes, limit: int, offset: int) -> bytes:
    try:
        text = unpacker.decompress(data, limit + 1)
        # the last bytes of a stream can wait inside until more is asked for
        more = b"" if unpacker.eof else unpacker.decompress(_pending(unpacker), 1)
    except (OSError, EOFError, ValueError, MemoryError, lzma.LZMAError, zlib.error) as error:
        raise CorruptArchiveError(f"compressed bytes can't be expanded: {error}", offset) from None
    if len(text) + len(more) > limit:
        raise CorruptArchiveError(
            f"compressed bytes expand past the limit of {limit} bytes", offset
        )
    if not unpacker.eof or unpacker.unused_data:
        raise CorruptArchiveError("compressed bytes are not one whole stream", offset)
    return text + more


def _pending(unpacker: _Decompressor) -> bytes:
    tail: bytes = getattr(unpacker, "unconsumed_tail", b"")
    return tail
