"""Logs to the body of their section: rows sorted by track, and cut into blocks."""

from __future__ import annotations

import itertools
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import CHECKSUM_BYTES, encode_varint
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.layout import (
    MAX_PREAMBLE,
    TableLayout,
    encode_groups,
    encode_layout,
    encode_runs,
    name_of_cell,
)
from gpszip.lossless.order import encode_order
from gpszip.lossless.rows import MAX_CELL, Rows, find_rows
from gpszip.lossless.text import MAX_BLOCK_BYTES, encode_block
from gpszip.lossless.trails import NO_TRAILS, Trails

if TYPE_CHECKING:
    from gpszip.lossless.frame_logs import FrameHead, FrameSource

__all__ = ["APART", "FRAMES", "JOINED", "MAX_SPAN_BYTES", "TEXT", "write_exact_logs"]

#: Kinds of logs: text; rows in spans of their own; rows in text that is joined with other logs;
#: columns with types.
TEXT = 0
APART = 1
JOINED = 2
FRAMES = 3

#: Rows of so much text are sorted by track together.
MAX_SPAN_BYTES = 1 << 25

#: Blocks of sorted rows are about this long in longer spans: a block of 4 MiB would have to be
#: decoded for any track in it, and takes 1.2 % fewer bytes than four.
_SORTED_BLOCK_BYTES = 1 << 20

#: Blocks of equal size may be so much longer, so that whole rows fit.
_SPARE_BYTES = 1 << 12

#: A log of several that is shorter shares blocks with others.
_MIN_APART_BYTES = 1 << 16

#: Bytes up to which blocks stay in memory; more go to a temporary file.
_MAX_IN_MEMORY = 1 << 24

#: Bytes that are copied at a time.
_COPY_BYTES = 1 << 20

#: Tracks have so many rows on average at least, where rows are sorted by them.
_MIN_ROWS_OF_TRACK = 4

#: Bounds of a single block.
_ONE_BLOCK = 2

#: So many of the first columns may order the rows.
_KEY_COLUMNS = 16

_Ints = NDArray[np.int64]


@dataclass
class _Record:
    """What is known of a log: its name, bytes and checksum, kind, columns and tracks."""

    name: str
    kind: int = TEXT
    size: int = 0
    checksum: int = 0
    layout: TableLayout | None = None
    frame: FrameHead | None = None
    cells: dict[bytes, int] = field(default_factory=dict)


def write_exact_logs(
    logs: Iterable[tuple[str, Callable[[], Iterable[bytes]]]],
    sink: BinaryIO,
    trails: Trails = NO_TRAILS,
    layouts: Mapping[str, TableLayout] | None = None,
    frames: Mapping[str, FrameSource] | None = None,
) -> None:
    r"""Write the body of the section.

    A log with a layout is cut into spans of 32 MiB, whose rows are sorted by track and cut into
    blocks. All other logs are joined and cut into blocks, so that small logs share a block. Blocks
    are coded independently of each other.

    Parameters
    ----------
    logs : iterable of (str, callable)
        Name of each log, and what yields its bytes in chunks; two spans are in memory at a time.
    sink : binary file
        Only written to.
    trails : Trails, optional
        Walks that predict the logs; readers then need them, too.
    layouts : mapping of str to TableLayout, optional
        Layouts of logs with rows and columns, by their names.
    frames : mapping of str to FrameSource, optional
        Columns of logs that have some with types, by their names. Their values are kept where
        these take fewer bytes than the log itself.

    Examples
    --------
    >>> import io
    >>> from gpszip.lossless.logs import read_exact_logs
    >>> sink = io.BytesIO()
    >>> write_exact_logs([("a.csv", lambda: [b"t,x,y\n", b"0,1,2\n"])], sink)
    >>> found = read_exact_logs(sink.getvalue(), NO_TRAILS)
    >>> found.logs[0].name, b"".join(found.read(0))
    ('a.csv', b't,x,y\n0,1,2\n')
    """
    # Code the blocks; what stands before them is known only at their end.
    given = list(logs)
    numbers = {name: i for i, name in enumerate(trails.names)}
    with tempfile.SpooledTemporaryFile(_MAX_IN_MEMORY, prefix="gpszip-") as spool:
        writer = _Writer(cast(BinaryIO, spool), GuideFinder(trails))
        for name, chunks in given:
            layout = None if layouts is None else layouts.get(name)
            frame = None if frames is None else frames.get(name)
            record = _Record(name, layout=layout)
            if frame is None or not writer.add_frame(record, frame, chunks()):
                writer.add(record, chunks(), is_only=len(given) == 1)
        writer.flush()

        # Whether walks are needed comes first, then the logs and the blocks.
        records = [_encode_record(record, numbers) for record in writer.records]
        needs_walks = writer.finder.has_found or any(uses_names for _, uses_names in records)
        sink.write(bytes([needs_walks]) + encode_varint(len(records)))
        sink.writelines(record for record, _ in records)
        spool.seek(0)
        while chunk := spool.read(_COPY_BYTES):
            sink.write(chunk)


def _encode_record(record: _Record, numbers: Mapping[str, int]) -> tuple[bytes, bool]:
    """Encode the record of a log; return whether it names tracks by their numbers, too."""
    name = record.name.encode()
    parts = [
        encode_varint(len(name)),
        name,
        encode_varint(record.size),
        record.checksum.to_bytes(CHECKSUM_BYTES, "little"),
        bytes([record.kind]),
    ]
    if record.frame is not None:
        from gpszip.lossless.frame_logs import encode_head

        parts.append(encode_head(record.frame))
        known = _known(record, numbers)
        if record.frame.track_column is not None:
            parts.append(encode_groups(list(record.cells), known))
        return b"".join(parts), bool(known)
    if record.layout is None:
        return b"".join(parts), False
    parts.append(encode_layout(record.layout))
    if record.kind == JOINED:
        return b"".join(parts), False
    parts.append(record.layout.preamble)

    known = _known(record, numbers)
    if record.layout.track_column is not None:
        parts.append(encode_groups(list(record.cells), known))
    return b"".join(parts), bool(known)


def _known(record: _Record, numbers: Mapping[str, int]) -> dict[bytes, int]:
    """Tracks of a log that the archive names in the same way, by their numbers."""
    known: dict[bytes, int] = {}
    for cell in record.cells:
        name = name_of_cell(cell)
        if name in numbers and name.encode() == cell:
            known[cell] = numbers[name]
    return known


class _Writer:
    """Writes spans of logs, one log after the other.

    Parameters
    ----------
    spool : binary file
        Gets the spans.
    finder : GuideFinder
        Finds what walks tell of the numbers.
    """

    def __init__(self, spool: BinaryIO, finder: GuideFinder) -> None:
        self.records: list[_Record] = []
        self.finder = finder
        self._spool = spool
        self._joined = b""

    def add(self, record: _Record, chunks: Iterable[bytes], *, is_only: bool) -> None:
        """Write a log."""
        # Logs that are short share blocks.
        self.records.append(record)
        counted = _counted(record, chunks)
        head = _take(counted, _MIN_APART_BYTES)
        is_long = is_only or len(head) >= _MIN_APART_BYTES
        layout = record.layout
        if layout is not None and not _suits(layout, head):
            layout = record.layout = None
        if layout is not None and is_long:
            record.kind = APART
            self.flush()
            self._write_rows(record, layout, head[len(layout.preamble) :], counted)
            return
        record.kind = TEXT if layout is None else JOINED
        self._join(head)
        for chunk in counted:
            self._join(chunk)

    def add_frame(self, record: _Record, source: FrameSource, chunks: Iterable[bytes]) -> bool:
        """Write a log of columns with types, unless the log itself takes fewer bytes or memory."""
        from gpszip.lossless.frame_logs import write_spans

        self.flush()
        start = self._spool.tell()
        for _ in _counted(record, chunks):
            pass
        has_found = self.finder.has_found
        try:
            write_spans(source, self.finder, record.cells, self._spool)
            is_smaller = self._spool.tell() - start < record.size
        except OverflowError:
            is_smaller = False
        if is_smaller:
            record.kind, record.frame = FRAMES, source.head
            self.records.append(record)
            return True
        self._spool.seek(start)
        self._spool.truncate()
        self.finder.has_found = has_found
        record.size, record.checksum, record.cells = 0, 0, {}
        return False

    def flush(self) -> None:
        """Write what is left of the joined text."""
        if self._joined:
            self._write_block(self._joined)
        self._joined = b""

    def _join(self, chunk: bytes) -> None:
        """Join text, and write blocks once it is long enough."""
        self._joined += chunk
        while len(self._joined) >= MAX_BLOCK_BYTES:
            # Cut after a line, or anywhere if there is none.
            end = self._joined.rfind(b"\n", 0, MAX_BLOCK_BYTES) + 1 or MAX_BLOCK_BYTES
            self._write_block(self._joined[:end])
            self._joined = self._joined[end:]

    def _write_block(self, text: bytes) -> None:
        coded = encode_block(text, self.finder)
        self._spool.write(encode_varint(len(text)) + encode_varint(len(coded)) + coded)

    def _write_rows(
        self, record: _Record, layout: TableLayout, head: bytes, chunks: Iterator[bytes]
    ) -> None:
        """Write the spans of a log that is apart."""
        pending, is_first = head, True
        while pending := pending + _take(chunks, MAX_SPAN_BYTES + 1 - len(pending)):
            # A span ends with a row, unless a row is longer than it.
            rows = find_rows(pending, layout.delimiter)
            if len(pending) > MAX_SPAN_BYTES:
                fitting = int(np.searchsorted(rows.bounds, MAX_SPAN_BYTES, "right")) - 1
                end = int(rows.bounds[fitting]) or MAX_SPAN_BYTES
                rows, pending = find_rows(pending[:end], layout.delimiter), pending[end:]
            else:
                pending = b""
            if is_first and not _has_tracks(rows, layout):
                layout = record.layout = replace(layout, track_column=None)
            self._write_span(record, layout, rows)
            is_first = False

    def _write_span(self, record: _Record, layout: TableLayout, rows: Rows) -> None:
        """Write a span of rows, sorted by track where a column names them."""
        found = None
        if layout.track_column is not None:
            found = _sort(rows, layout, layout.track_column, record.cells)
        order, groups = b"", np.zeros(0, np.int64)
        if found is not None:
            rows, groups, order = found
        bounds = _block_bounds(rows, groups)
        parts = [encode_varint(len(rows.text)), encode_varint(len(bounds) - 1)]

        # The order of the log, and which tracks each of several blocks has.
        if layout.track_column is not None:
            parts.append(encode_varint(len(groups)))
        if len(groups):
            parts.append(encode_varint(len(order)) + order)
        if len(groups) and len(bounds) > _ONE_BLOCK:
            row_bounds = np.searchsorted(rows.bounds, bounds)
            for first, after in itertools.pairwise(row_bounds.tolist()):
                parts.append(encode_runs(groups[first:after]))

        # The blocks.
        self._spool.write(b"".join(parts))
        for first, after in itertools.pairwise(bounds.tolist()):
            self._write_block(rows.text[first:after].tobytes())


def _sort(
    rows: Rows, layout: TableLayout, column: int, known: dict[bytes, int]
) -> tuple[Rows, _Ints, bytes] | None:
    """Sort rows by track; return them, the track of each, and the order of the log.

    None where they would not come back. Tracks are numbered as they first appear in the log.
    """
    # Rows of a track follow one another.
    groups, cells = rows.groups(column)
    numbers = [known.setdefault(cell, len(known)) for cell in cells]
    groups = np.array(numbers, np.int64)[groups]
    by_track = np.argsort(groups, kind="stable")
    sorted_rows = find_rows(rows.pick(by_track), layout.delimiter)

    # A quote that is never closed would make other rows of them; blocks have a limit.
    lengths = np.diff(rows.bounds)
    if not np.array_equal(np.diff(sorted_rows.bounds), lengths[by_track]):
        return None
    if lengths.max() > MAX_BLOCK_BYTES:
        return None
    columns = range(min(_count_columns(rows), _KEY_COLUMNS))
    order = encode_order(by_track, lambda key, count: rows.head(count).keys(key), columns)
    return sorted_rows, groups[by_track], order


def _count_columns(rows: Rows) -> int:
    """Number of cells of the first row."""
    return int(np.searchsorted(rows.delimiters, rows.bounds[1])) + 1


def _has_tracks(rows: Rows, layout: TableLayout) -> bool:
    """Whether rows have tracks by which it pays to sort them."""
    if layout.track_column is None:
        return False
    starts, ends = rows.cells(layout.track_column)
    if int((ends - starts).max(initial=0)) > MAX_CELL:
        return False
    return len(rows.groups(layout.track_column)[1]) * _MIN_ROWS_OF_TRACK <= len(rows)


def _block_bounds(rows: Rows, groups: _Ints) -> _Ints:
    """Where the blocks of a span begin, and its end."""
    # Blocks of about the same size; where rows are sorted, they are short in long spans.
    size = len(rows.text)
    is_short = size > MAX_BLOCK_BYTES and len(groups) > 0 and groups[0] != groups[-1]
    limit = _SORTED_BLOCK_BYTES if is_short else MAX_BLOCK_BYTES
    limit = min(-(-size // -(-size // limit)) + _SPARE_BYTES, MAX_BLOCK_BYTES)
    begins = np.flatnonzero(np.diff(groups)) + 1
    bounds, row = [0], 0
    while bounds[-1] < size:
        # Cut after a row, and where a track ends, if one does late enough.
        after = int(np.searchsorted(rows.bounds, bounds[-1] + limit, "right")) - 1
        between = begins[(begins > (row + after) // 2) & (begins < after)]
        if len(between) and after < len(rows):
            after = int(between[-1])
        # A row that is longer than a block is cut anywhere.
        end = int(rows.bounds[after])
        if end <= bounds[-1]:
            end = min(bounds[-1] + MAX_BLOCK_BYTES, size)
            after = int(np.searchsorted(rows.bounds, end, "right")) - 1
        bounds.append(end)
        row = after
    return np.array(bounds, np.int64)


def _suits(layout: TableLayout, head: bytes) -> bool:
    """Whether a log begins as its layout says."""
    return len(layout.preamble) <= MAX_PREAMBLE and head.startswith(layout.preamble)


def _counted(record: _Record, chunks: Iterable[bytes]) -> Iterator[bytes]:
    """Yield chunks, and count their bytes and checksum."""
    for chunk in chunks:
        record.size += len(chunk)
        record.checksum = zlib.crc32(chunk, record.checksum)
        yield chunk


def _take(chunks: Iterator[bytes], size: int) -> bytes:
    """Join chunks up to a size at least, as long as there are any."""
    parts, taken = [], 0
    while taken < size and (chunk := next(chunks, None)) is not None:
        parts.append(chunk)
        taken += len(chunk)
    return b"".join(parts)
