"""Logs in an archive, byte by byte: the body of its section."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from gpszip.container.layout import CHECKSUM_BYTES, Cursor, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.text import MAX_BLOCK_BYTES, decode_block, encode_block
from gpszip.lossless.trails import NO_TRAILS, Trails

__all__ = ["ExactLog", "ExactLogs", "read_exact_logs", "write_exact_logs"]

#: Bytes up to which blocks stay in memory; more go to a temporary file.
_MAX_IN_MEMORY = 1 << 24

#: Bytes that are copied at a time.
_COPY_BYTES = 1 << 20

#: Longest name, and bytes of the shortest record of a log: a name of one byte, size, checksum.
_MAX_NAME = 1 << 12
_MIN_RECORD = 3 + CHECKSUM_BYTES


@dataclass(frozen=True)
class ExactLog:
    """One log.

    Parameters
    ----------
    name : str
        Name of its file, without folders.
    size : int
        Number of bytes, unpacked.
    checksum : int
        CRC-32 of these bytes.
    """

    name: str
    size: int
    checksum: int


@dataclass(frozen=True)
class _Block:
    """Where a block lies in the joined text, and its coded bytes in the body."""

    first: int
    size: int
    offset: int
    length: int


@dataclass(frozen=True, eq=False)
class ExactLogs:
    """All logs of an archive, whose blocks are decoded when they are asked for.

    Parameters
    ----------
    logs : tuple of ExactLog
        In the order in which they were compressed.
    body : bytes
        Body of the section.
    trails : Trails, optional
        Walks that predict the logs; None in sections of kind 9.
    is_guided : bool, default False
        Whether the walks are needed.
    """

    logs: tuple[ExactLog, ...]
    body: bytes
    blocks: tuple[_Block, ...]
    trails: Trails | None = None
    is_guided: bool = False

    def read(self, number: int, first: int = 0, count: int | None = None) -> Iterator[bytes]:
        """Yield bytes of a log in chunks; only blocks that hold some of them are decoded.

        Parameters
        ----------
        number : int
            Number of the log, from 0.
        first : int, default 0
            First byte.
        count : int, optional
            Number of bytes; by default all up to the end of the log, whose checksum is then
            compared if they are the whole log.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged, or the checksum differs.
        """
        # The logs are joined, one after the other.
        log = self.logs[number]
        start = sum(other.size for other in self.logs[:number])
        begin = start + min(first, log.size)
        end = start + (log.size if count is None else min(first + count, log.size))
        checksum = 0
        for block in self.blocks:
            if block.first < end and block.first + block.size > begin:
                text = self._decode(block)
                text = text[max(begin - block.first, 0) : end - block.first]
                checksum = zlib.crc32(text, checksum)
                yield text
        if end - begin == log.size and checksum != log.checksum:
            raise CorruptArchiveError(f"log {log.name!r} differs from its checksum", 0)

    def check(self) -> None:
        """Decode all logs and compare their checksums.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged, or a checksum differs.
        """
        for number in range(len(self.logs)):
            for _ in self.read(number):
                pass

    def _decode(self, block: _Block) -> bytes:
        cursor = Cursor(self.body, block.offset, block.offset + block.length)
        return decode_block(cursor, block.size, self.trails)


def write_exact_logs(
    logs: Iterable[tuple[str, Callable[[], Iterable[bytes]]]],
    sink: BinaryIO,
    trails: Trails = NO_TRAILS,
) -> None:
    r"""Write the body of the section.

    The logs are joined and cut into blocks, after lines where possible, so that small logs share a
    block. Blocks are coded independently of each other.

    Parameters
    ----------
    logs : iterable of (str, callable)
        Name of each log, and what yields its bytes in chunks; two blocks are in memory at a time.
    sink : binary file
        Only written to.
    trails : Trails, optional
        Walks that predict the logs; readers then need them, too.

    Examples
    --------
    >>> import io
    >>> sink = io.BytesIO()
    >>> write_exact_logs([("a.csv", lambda: [b"t,x,y\n", b"0,1,2\n"])], sink)
    >>> found = read_exact_logs(sink.getvalue(), NO_TRAILS)
    >>> found.logs[0].name, b"".join(found.read(0))
    ('a.csv', b't,x,y\n0,1,2\n')
    """
    # Code the blocks; what stands before them is known only at their end.
    records: list[ExactLog] = []
    with tempfile.SpooledTemporaryFile(_MAX_IN_MEMORY, prefix="gpszip-") as spool:
        finder = GuideFinder(trails)
        for block in _blocks(logs, records):
            coded = encode_block(block, finder)
            spool.write(encode_varint(len(block)) + encode_varint(len(coded)) + coded)

        # Whether walks are needed comes first, then the logs and the blocks.
        sink.write(bytes([finder.has_found]))
        sink.write(encode_varint(len(records)))
        for record in records:
            name = record.name.encode()
            sink.write(encode_varint(len(name)) + name + encode_varint(record.size))
            sink.write(record.checksum.to_bytes(CHECKSUM_BYTES, "little"))
        spool.seek(0)
        while chunk := spool.read(_COPY_BYTES):
            sink.write(chunk)


def read_exact_logs(body: bytes, trails: Trails | None = None) -> ExactLogs:
    """Read the head of the section, and where its blocks lie; nothing is decoded.

    Parameters
    ----------
    body : bytes
        Body of the section.
    trails : Trails, optional
        The walks of the archive; None for a section of kind 9, which needs none.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no such section.
    """
    # The logs.
    cursor = Cursor(body)
    is_guided = False
    if trails is not None:
        flag = cursor.read_byte("whether walks predict the logs")
        if flag > 1:
            raise cursor.error(f"logs of kind {flag}")
        is_guided = flag == 1
    count = cursor.read_varint("the number of logs")
    if count * _MIN_RECORD > cursor.remaining:
        raise cursor.error(f"{count} logs in {cursor.remaining} bytes")
    logs = tuple(_read_log(cursor) for _ in range(count))
    if len({log.name for log in logs}) < count:
        raise cursor.error("two logs of one name")

    # The blocks.
    total, first = sum(log.size for log in logs), 0
    blocks: list[_Block] = []
    while first < total:
        size = cursor.read_varint("the size of a block")
        length = cursor.read_varint("the length of a block")
        if not 0 < size <= min(MAX_BLOCK_BYTES, total - first):
            raise cursor.error(f"a block of {size} bytes, where {total - first} are left")
        blocks.append(_Block(first, size, cursor.offset, length))
        cursor.read_bytes(length, "a block")
        first += size
    cursor.expect_end("the exact logs")
    return ExactLogs(logs, body, tuple(blocks), trails, is_guided)


def _read_log(cursor: Cursor) -> ExactLog:
    """Read the record of a log."""
    length = cursor.read_varint("the length of a log's name")
    if not 0 < length <= _MAX_NAME:
        raise cursor.error(f"a log's name of {length} bytes")
    try:
        name = cursor.read_bytes(length, "a log's name").decode()
    except UnicodeDecodeError:
        raise cursor.error("a log's name is not UTF-8") from None
    # A name must not lead out of the folder into which logs are written.
    if "/" in name or "\\" in name or "\0" in name or name in {".", ".."}:
        raise cursor.error(f"a log's name holds a folder: {name!r}")
    size = cursor.read_varint("the size of a log")
    checksum = int.from_bytes(cursor.read_bytes(CHECKSUM_BYTES, "a log's checksum"), "little")
    return ExactLog(name, size, checksum)


def _blocks(
    logs: Iterable[tuple[str, Callable[[], Iterable[bytes]]]], records: list[ExactLog]
) -> Iterator[bytes]:
    """Yield the joined text of logs in blocks; enter a record for each log."""
    pending = b""
    for name, chunks in logs:
        size, checksum = 0, 0
        for chunk in chunks():
            size, checksum = size + len(chunk), zlib.crc32(chunk, checksum)
            pending += chunk
            while len(pending) >= MAX_BLOCK_BYTES:
                # Cut after a line, or anywhere if there is none.
                end = pending.rfind(b"\n", 0, MAX_BLOCK_BYTES) + 1 or MAX_BLOCK_BYTES
                yield pending[:end]
                pending = pending[end:]
        records.append(ExactLog(name, size, checksum))
    if pending:
        yield pending
