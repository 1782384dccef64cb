"""Logs in an archive, byte by byte: the body of its section."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from gpszip.container.layout import CHECKSUM_BYTES, Cursor
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.layout import (
    MAX_COLUMNS,
    Groups,
    Runs,
    TableLayout,
    decode_groups,
    decode_layout,
    name_of_cell,
    read_runs,
    rows_of_runs,
)
from gpszip.lossless.order import decode_order, read_key
from gpszip.lossless.rows import check_quotes, cut_cells, find_rows
from gpszip.lossless.text import MAX_BLOCK_BYTES, decode_block, decode_cells
from gpszip.lossless.trails import NO_TRAILS, Trails
from gpszip.lossless.write_logs import (
    APART,
    FRAMES,
    JOINED,
    MAX_SPAN_BYTES,
    TEXT,
    write_exact_logs,
)

if TYPE_CHECKING:
    from gpszip.lossless.frame_logs import FrameHead, FrameLog

__all__ = ["ExactLog", "ExactLogs", "read_exact_logs", "write_exact_logs"]

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
    layout : TableLayout, optional
        How its text falls into rows and columns, if it does. It has what stands before the rows
        only where the log is apart.
    groups : Groups, optional
        The tracks of its rows, where these are sorted by track.
    is_apart : bool, default False
        Whether its rows share no block with other logs.
    preamble_size : int, default 0
        Number of bytes before the rows.
    frame : FrameHead, optional
        What is known of a log of columns with types, such as Parquet, of which values are kept.
    """

    name: str
    size: int
    checksum: int
    layout: TableLayout | None = None
    groups: Groups | None = None
    is_apart: bool = False
    preamble_size: int = 0
    frame: FrameHead | None = None

    @property
    def stored(self) -> int:
        """Number of bytes of text in blocks."""
        if self.frame is not None:
            return 0
        return self.size - self.preamble_size if self.is_apart else self.size


@dataclass(frozen=True)
class _Block:
    """Bytes of text of a block, its coded bytes in the body, and runs of rows of one track."""

    size: int
    offset: int
    length: int
    runs: Runs = ()


@dataclass(frozen=True)
class _Span:
    """Where a part of the joined text lies, its blocks, and how their rows are in order."""

    first: int
    size: int
    blocks: tuple[_Block, ...]
    rows: int = 0
    order: int = 0


@dataclass(frozen=True, eq=False)
class ExactLogs:
    """All logs of an archive, whose blocks are decoded when they are asked for.

    Parameters
    ----------
    logs : tuple of ExactLog
        In the order in which they were compressed.
    body : bytes
        Body of the section.
    spans : tuple
        Where parts of the joined text lie in it.
    trails : Trails, optional
        Walks that predict the logs; None in sections of kind 9.
    is_guided : bool, default False
        Whether the walks, or names of tracks, are needed.
    frames : mapping of int to FrameLog
        Logs of columns with types, by their numbers.
    """

    logs: tuple[ExactLog, ...]
    body: bytes
    spans: tuple[_Span, ...]
    trails: Trails | None = None
    is_guided: bool = False
    frames: Mapping[int, FrameLog] = field(default_factory=dict)

    def read(self, number: int, first: int = 0, count: int | None = None) -> Iterator[bytes]:
        """Yield bytes of a log in chunks; only parts that hold some of them are decoded.

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
        # Columns with types are written anew, whatever bytes the log had.
        log = self.logs[number]
        if number in self.frames:
            yield from _cut(self.frames[number].file(), first, count)
            return

        # What stands before the rows of a log that is apart.
        begin = min(first, log.size)
        end = log.size if count is None else min(first + count, log.size)
        is_whole = end - begin == log.size
        preamble = log.layout.preamble if log.is_apart and log.layout else b""
        checksum = zlib.crc32(preamble) if is_whole else 0
        if preamble[begin:end]:
            yield preamble[begin:end]

        # The logs are joined, one after the other.
        start = self._start(number) - len(preamble)
        begin, end = start + max(begin, len(preamble)), start + max(end, len(preamble))
        for span in self.spans:
            if span.first < end and span.first + span.size > begin:
                place = span.first
                for text in self._texts(span, log):
                    part = text[max(begin - place, 0) : max(end - place, 0)]
                    place += len(text)
                    checksum = zlib.crc32(part, checksum) if is_whole else 0
                    if part:
                        yield part
        if is_whole and checksum != log.checksum:
            raise CorruptArchiveError(f"log {log.name!r} differs from its checksum", 0)

    def layout(self, number: int) -> TableLayout | None:
        """How the text of a log falls into rows and columns; None if it does not."""
        log = self.logs[number]
        if log.layout is None or log.is_apart:
            return log.layout
        return replace(log.layout, preamble=b"".join(self.read(number, 0, log.preamble_size)))

    def tracks(self, number: int) -> tuple[str, ...] | None:
        """Names of the tracks of a log's rows; None where no column names any."""
        log = self.logs[number]
        if log.groups is not None:
            return log.groups.names
        if log.layout is None or log.layout.track_column is None:
            return None
        rows = find_rows(self._row_text(number), log.layout.delimiter)
        return tuple(name_of_cell(cell) for cell in rows.groups(log.layout.track_column)[1])

    def rows(
        self, number: int, track: str | None = None, columns: Sequence[int] | None = None
    ) -> Iterator[bytes]:
        """Yield the text of some rows and columns of a log in chunks.

        Blocks without such rows are not decoded. Of the others, columns are decoded that are
        asked for, and those by which they are predicted.

        Parameters
        ----------
        number : int
            Number of the log, which has a layout.
        track : str, optional
            Name of a track; by default rows of all tracks, in the order of the log.
        columns : sequence of int, optional
            Numbers of columns, which come with a newline after each row. By default whole rows,
            as they are in the log.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged.
        OptionError
            If quotes within cells hide where rows and cells end, and some are asked for.
        """
        log = self.logs[number]
        assert log.layout is not None
        if not log.is_apart:
            yield _rows_of_text(self._row_text(number), log.layout, track, columns, None)
            return
        start, end = self._start(number), self._start(number) + log.stored
        wanted = None
        if track is not None and log.groups is not None:
            wanted = {i for i, name in enumerate(log.groups.names) if name == track}
            if not wanted:
                return
        for span in self.spans:
            if not start <= span.first < end:
                continue
            if wanted is None:
                yield from self._texts(span, log, columns)
                continue
            if len(span.blocks) > 1 and span.rows:
                for block in span.blocks:
                    if any(group in wanted for group, _ in block.runs):
                        text = self._decode(block, log.layout, columns)
                        yield _take_runs(text, log.layout.delimiter, block, wanted)
                continue
            # Which rows are of the track, their cells tell.
            assert track is not None and log.layout.track_column is not None
            needed = None if columns is None else [*columns, log.layout.track_column]
            text = b"".join(self._decode(block, log.layout, needed) for block in span.blocks)
            yield _rows_of_text(text, log.layout, track, columns, needed)

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

    def _start(self, number: int) -> int:
        """Where a log begins in the joined text."""
        return sum(log.stored for log in self.logs[:number])

    def _row_text(self, number: int) -> bytes:
        """The rows of a log that shares blocks with others."""
        return b"".join(self.read(number, self.logs[number].preamble_size))

    def _texts(
        self, span: _Span, log: ExactLog, columns: Sequence[int] | None = None
    ) -> Iterator[bytes]:
        """Yield the text of a span in the order of the log."""
        # The rows as they are sorted.
        layout = log.layout
        if not span.order or layout is None:
            for block in span.blocks:
                yield self._decode(block, layout, columns)
            return
        cursor = Cursor(self.body, span.order)
        key = read_key(cursor, MAX_COLUMNS)
        order = decode_order(cursor, span.rows, None) if key is None else None
        if key is None and order is None:
            for block in span.blocks:
                yield self._decode(block, layout, columns)
            return
        needed = columns if columns is None or key is None else [*columns, key]
        text = b"".join(self._decode(block, layout, needed) for block in span.blocks)
        rows = find_rows(text, layout.delimiter)
        if len(rows) != span.rows:
            raise CorruptArchiveError(f"{len(rows)} rows, where {span.rows} are due", span.order)

        # Their order in the log, by the column of keys, which was decoded last.
        if key is not None:
            keys = rows.keys(key if columns is None else len(columns))
            order = decode_order(cursor, span.rows, keys)
        if order is not None:
            text = rows.pick(order)
        if needed is columns:
            yield text
        else:
            assert columns is not None
            yield cut_cells(text, layout.delimiter, range(len(columns)))

    def _decode(
        self, block: _Block, layout: TableLayout | None = None, columns: Sequence[int] | None = None
    ) -> bytes:
        cursor = Cursor(self.body, block.offset, block.offset + block.length)
        if columns is None or layout is None:
            return decode_block(cursor, block.size, self.trails)
        trails = NO_TRAILS if self.trails is None else self.trails
        return decode_cells(cursor, block.size, trails, layout.delimiter, columns)


def _rows_of_text(
    text: bytes,
    layout: TableLayout,
    track: str | None,
    columns: Sequence[int] | None,
    decoded: Sequence[int] | None,
) -> bytes:
    """Rows of a track, or all, and columns of a text that holds all columns, or those decoded."""
    if track is not None or columns is not None:
        check_quotes(text, layout.delimiter)
    if track is not None and layout.track_column is not None:
        column = layout.track_column if decoded is None else len(decoded) - 1
        rows = find_rows(text, layout.delimiter)
        groups, cells = rows.groups(column)
        wanted = [i for i, cell in enumerate(cells) if name_of_cell(cell) == track]
        text = rows.pick(np.flatnonzero(np.isin(groups, wanted)))
    if columns is None:
        return text
    places = columns if decoded is None else range(len(columns))
    return cut_cells(text, layout.delimiter, places)


def _cut(chunks: Iterator[bytes], first: int, count: int | None) -> Iterator[bytes]:
    """Yield some of the bytes in chunks."""
    place, end = 0, None if count is None else first + count
    for chunk in chunks:
        part = chunk[max(first - place, 0) : None if end is None else max(end - place, 0)]
        place += len(chunk)
        if part:
            yield part


def _take_runs(text: bytes, delimiter: int, block: _Block, wanted: set[int]) -> bytes:
    """Rows of some tracks in the text of a block."""
    check_quotes(text, delimiter)
    if all(group in wanted for group, _ in block.runs):
        return text
    rows = find_rows(text, delimiter)
    is_wanted = rows_of_runs(block.runs, wanted)
    if len(is_wanted) != len(rows):
        raise CorruptArchiveError(f"{len(rows)} rows, where {len(is_wanted)} are due", block.offset)
    return rows.pick(np.flatnonzero(is_wanted))


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
    logs = tuple(_read_log(cursor, trails) for _ in range(count))
    if len({log.name for log in logs}) < count:
        raise cursor.error("two logs of one name")

    # The spans; those of a log that is apart end where it ends.
    spans: list[_Span] = []
    frames: dict[int, FrameLog] = {}
    first = 0
    for stored, log in _shared_runs(logs):
        if log is not None and log.frame is not None:
            from gpszip.lossless.frame_logs import read_frame_log

            assert trails is not None
            frame = read_frame_log(cursor, log.frame, log.groups, trails)
            frames[logs.index(log)] = frame
            continue
        end = first + stored
        while first < end:
            left = end - first
            if trails is None or log is None:
                size = _read_size(cursor, min(MAX_BLOCK_BYTES, left))
                span = _Span(first, size, (_read_block(cursor, size),))
            else:
                span = _read_span(cursor, first, left, log)
            spans.append(span)
            first += span.size
    cursor.expect_end("the exact logs")
    return ExactLogs(logs, body, tuple(spans), trails, is_guided, frames)


def _shared_runs(logs: Sequence[ExactLog]) -> Iterator[tuple[int, ExactLog | None]]:
    """Yield bytes of text that share spans, and the log if it is apart."""
    joined = 0
    for log in logs:
        if not log.is_apart and log.frame is None:
            joined += log.size
            continue
        if joined:
            yield joined, None
        joined = 0
        yield log.stored, log
    yield joined, None


def _read_span(cursor: Cursor, first: int, left: int, log: ExactLog) -> _Span:
    """Read the head of a span of a log that is apart, and pass over its blocks."""
    size = _read_size(cursor, min(MAX_SPAN_BYTES, left))
    count = cursor.read_varint("the number of blocks")
    if not 0 < count <= min(size, cursor.remaining):
        raise cursor.error(f"{count} blocks of {size} bytes")
    if log.groups is None:
        blocks = _read_blocks(cursor, size, [()] * count)
        return _Span(first, size, blocks)

    # The order of sorted rows, and the tracks of several blocks.
    rows = cursor.read_varint("a number of rows")
    if not rows:
        return _Span(first, size, _read_blocks(cursor, size, [()] * count))
    if rows > size:
        raise cursor.error(f"{rows} rows in {size} bytes")
    length = cursor.read_varint("the length of an order")
    order = cursor.offset
    cursor.read_bytes(length, "an order")
    groups = len(log.groups.cells)
    runs = [read_runs(cursor, groups) if count > 1 else () for _ in range(count)]
    if count > 1 and rows != sum(rows for block in runs for _, rows in block):
        raise cursor.error(f"blocks do not have {rows} rows")
    return _Span(first, size, _read_blocks(cursor, size, runs), rows, order)


def _read_blocks(cursor: Cursor, size: int, runs: Sequence[Runs]) -> tuple[_Block, ...]:
    """Read the heads of the blocks of a span."""
    blocks = []
    left = size
    for each in runs:
        block_size = _read_size(cursor, min(MAX_BLOCK_BYTES, left))
        blocks.append(_read_block(cursor, block_size, each))
        left -= block_size
    if left:
        raise cursor.error(f"blocks lack {left} bytes of a span")
    return tuple(blocks)


def _read_block(cursor: Cursor, size: int, runs: Runs = ()) -> _Block:
    """Read the length of a block, and pass over its bytes."""
    length = cursor.read_varint("the length of a block")
    block = _Block(size, cursor.offset, length, runs)
    cursor.read_bytes(length, "a block")
    return block


def _read_size(cursor: Cursor, limit: int) -> int:
    """Read bytes of text of a block or span."""
    size = cursor.read_varint("the size of a block")
    if not 0 < size <= limit:
        raise cursor.error(f"a block of {size} bytes, where {limit} are left")
    return size


def _read_log(cursor: Cursor, trails: Trails | None) -> ExactLog:
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
    log = ExactLog(name, size, checksum)
    return log if trails is None else _read_rows_of_log(cursor, log, trails)


def _read_rows_of_log(cursor: Cursor, log: ExactLog, trails: Trails) -> ExactLog:
    """Read how a log falls into rows and columns, and its tracks."""
    kind = cursor.read_byte("the kind of a log")
    if kind == TEXT:
        return log
    if kind == FRAMES:
        # Few archives need Arrow.
        from gpszip.lossless.frame_logs import read_head

        head, groups = read_head(cursor, trails)
        return replace(log, frame=head, groups=groups)
    if kind not in {APART, JOINED}:
        raise cursor.error(f"a log of kind {kind}")
    layout, before = decode_layout(cursor)
    if before > log.size:
        raise cursor.error(f"{before} bytes before the rows of {log.size}")
    if kind == JOINED:
        return replace(log, layout=layout, preamble_size=before)
    layout = replace(layout, preamble=cursor.read_bytes(before, "what stands before the rows"))
    groups = None if layout.track_column is None else decode_groups(cursor, trails)
    return replace(log, layout=layout, groups=groups, is_apart=True, preamble_size=before)
