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

#: Above this many bytes, LZMA packs with its default settings only.
LARGE = 1 << 20

#: Bytes of the LZMA dictionary; a reader holds as many in memory.
_LZMA_WINDOW = 1 << 22
_LZMA_READ_FILTERS = [{"id": lzma.FILTER_LZMA2, "dict_size": _LZMA_WINDOW}]

#: Settings of zlib for a raw stream: level, window of 32 kB, memory.
_DEFLATE_LEVEL = 9
_DEFLATE_WINDOW = -15
_DEFLATE_MEMORY = 9


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
    """Compressor that writes a raw deflate stream chunk by chunk."""
    return zlib.compressobj(_DEFLATE_LEVEL, zlib.DEFLATED, _DEFLATE_WINDOW, _DEFLATE_MEMORY)


def inflate(data: bytes, limit: int, offset: int) -> bytes:
    """Undo :func:`deflate`; refuses more than ``limit`` bytes, and all but one complete stream."""
    return _expand(zlib.decompressobj(_DEFLATE_WINDOW), data, limit, offset)


def pack_bz2(data: bytes) -> bytes:
    """One bzip2 stream."""
    return bz2.compress(data, 9)


def unpack_bz2(data: bytes, limit: int, offset: int) -> bytes:
    """Undo :func:`pack_bz2` within a limit."""
    return _expand(bz2.BZ2Decompressor(), data, limit, offset)


def pack_lzma(data: bytes) -> bytes:
    """Raw LZMA2 stream: of small data the shortest of several settings, of large the default."""
    if len(data) > LARGE:
        packer = lzma_packer()
        return packer.compress(data) + packer.flush()

    # Lc and pb are contexts by the byte before and by the position, which short data hardly fill.
    default = {"id": lzma.FILTER_LZMA2, "preset": 9, "dict_size": _LZMA_WINDOW}
    settings = [default, {**default, "lc": 0, "pb": 0}, {**default, "pb": 0}]
    packed = (
        lzma.compress(data, format=lzma.FORMAT_RAW, filters=[filters]) for filters in settings
    )
    return min(packed, key=len)


def lzma_packer() -> _Compressor:
    """Compressor that writes a raw LZMA2 stream of large data chunk by chunk."""
    default = {"id": lzma.FILTER_LZMA2, "preset": 6, "dict_size": _LZMA_WINDOW}
    return lzma.LZMACompressor(format=lzma.FORMAT_RAW, filters=[default])


def unpack_lzma(data: bytes, limit: int, offset: int) -> bytes:
    """Undo :func:`pack_lzma` within a limit."""
    unpacker = lzma.LZMADecompressor(format=lzma.FORMAT_RAW, filters=_LZMA_READ_FILTERS)
    return _expand(unpacker, data, limit, offset)


def _expand(unpacker: _Decompressor, data: bytes, limit: int, offset: int) -> bytes:
    """Expand one complete stream to at most ``limit`` bytes; ``offset`` is for errors."""
    try:
        # One byte past the limit is enough to see that there are more.
        expanded = unpacker.decompress(data, limit + 1)
        # The last bytes of a stream can wait inside until more is asked for.
        more = b"" if unpacker.eof else unpacker.decompress(_pending(unpacker), 1)
    except (OSError, EOFError, ValueError, MemoryError, lzma.LZMAError, zlib.error) as error:
        raise CorruptArchiveError(f"compressed bytes can't be expanded: {error}", offset) from None
    if len(expanded) + len(more) > limit:
        raise CorruptArchiveError(
            f"compressed bytes expand past the limit of {limit} bytes", offset
        )
    # A forged length may cut the stream short, or take in what follows it.
    if not unpacker.eof or unpacker.unused_data:
        raise CorruptArchiveError("compressed bytes are not one complete stream", offset)
    return expanded + more


def _pending(unpacker: _Decompressor) -> bytes:
    """Input that zlib has not taken yet; the other two keep theirs inside."""
    tail: bytes = getattr(unpacker, "unconsumed_tail", b"")
    return tail
