"""Logs of typed columns, such as Parquet: spans of rows sorted by track, in blocks."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO, cast

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.container.expansion import deflate, inflate
from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.arrays import order_keys
from gpszip.lossless.columns import decode_column, encode_column
from gpszip.lossless.frames import decode_frame, encode_frame
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.layout import Groups, Runs, decode_groups, encode_runs, read_runs, rows_of_runs
from gpszip.lossless.order import decode_order, encode_order, read_key
from gpszip.lossless.trails import Trails

__all__ = [
    "FrameHead",
    "FrameLog",
    "FrameSource",
    "encode_head",
    "name_of_value",
    "read_frame_log",
    "read_head",
    "write_spans",
]

#: Rows that are sorted by track together, of a block of them in logs of more, and of logs that are
#: one block.
_SPAN_ROWS = 1 << 18
_BLOCK_ROWS = 1 << 15
_ONE_BLOCK_ROWS = 1 << 17

#: How Parquet packs columns: the numbers of these names.
_CODECS = ("none", "snappy", "gzip", "brotli", "zstd", "lz4")

#: Bytes of a schema, and rows of a log, at most.
_MAX_SCHEMA = 1 << 22
_MAX_ROWS = 1 << 40

#: Bytes of a file that stay in memory, and that are handed out at a time.
_MAX_IN_MEMORY = 1 << 24
_CHUNK = 1 << 20

#: The column of one value takes no bytes for each row: so many rows of a block for each of its
#: bytes, and so many more, so that a forged number must not ask for memory.
_ROWS_PER_BYTE = 1 << 13
_FREE_ROWS = 1 << 12

_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FrameHead:
    """What is known of a log of typed columns.

    Parameters
    ----------
    schema : pyarrow.Schema
        Names and types of columns, and what the file says of them.
    codec : str
        How Parquet packs columns.
    row_groups : tuple of int
        Rows of each row group.
    track_column : int, optional
        Number of the column that names the track of each row.
    """

    schema: Any
    codec: str
    row_groups: tuple[int, ...]
    track_column: int | None = None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return sum(self.row_groups)


@dataclass(frozen=True, eq=False)
class FrameSource:
    """A log to be kept, which is read once.

    Parameters
    ----------
    head : FrameHead
        What is known of it.
    batches : callable
        Yields its rows in batches of at most so many.
    """

    head: FrameHead
    batches: Callable[[int], Iterator[Any]]


@dataclass(frozen=True)
class _Block:
    """Rows of a block, its bytes in the body, and runs of rows of one track."""

    rows: int
    offset: int
    length: int
    runs: Runs = ()


@dataclass(frozen=True)
class _Span:
    """Blocks of a span, its rows, and where their order is; 0 for the order of the log."""

    blocks: tuple[_Block, ...]
    rows: int
    order: int


@dataclass(frozen=True, eq=False)
class FrameLog:
    """A log that is kept as typed columns.

    Parameters
    ----------
    head : FrameHead
        What is known of it.
    spans : tuple
        Where its rows lie.
    body : bytes
        Body of the section.
    trails : Trails
        Walks that predict it.
    groups : Groups, optional
        The tracks of its rows.
    """

    head: FrameHead
    spans: tuple[_Span, ...]
    body: bytes
    trails: Trails
    groups: Groups | None = None

    def batches(
        self, track: str | None = None, columns: Sequence[int] | None = None
    ) -> Iterator[Any]:
        """Yield rows of a track, or all, in the order of the log, and columns in the order given.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged.
        """
        wanted = None
        if track is not None and self.groups is not None:
            wanted = {i for i, name in enumerate(self.groups.names) if name == track}
        for span in self.spans:
            if wanted is None:
                yield from self._in_order(span, columns)
                continue
            for block in span.blocks:
                if any(group in wanted for group, _ in block.runs):
                    batch = self._decode(block, columns)
                    yield batch.filter(pa.array(rows_of_runs(block.runs, wanted)))

    def file(self) -> Iterator[bytes]:
        """Yield the bytes of a file of Parquet with the same schema, rows and row groups.

        Raises
        ------
        CorruptArchiveError
            If a block is damaged, or Parquet can't hold the columns.
        """
        with tempfile.SpooledTemporaryFile(_MAX_IN_MEMORY, prefix="gpszip-") as file:
            try:
                self._write(cast(BinaryIO, file))
            except (pa.ArrowException, ValueError) as error:
                raise CorruptArchiveError(f"columns are damaged: {error}") from None
            file.seek(0)
            while chunk := file.read(_CHUNK):
                yield chunk

    def _write(self, file: BinaryIO) -> None:
        """Write a file of Parquet, one row group after the other."""
        import pyarrow.parquet as pq

        schema, batches = self.head.schema, self.batches()
        pending = schema.empty_table()
        with pq.ParquetWriter(file, schema, compression=self.head.codec) as writer:
            for rows in self.head.row_groups:
                while pending.num_rows < rows:
                    batch = pa.Table.from_batches([next(batches)])
                    pending = pa.concat_tables([pending, batch.cast(schema)])
                writer.write_table(pending.slice(0, rows), row_group_size=max(rows, 1))
                pending = pending.slice(rows)

    def _in_order(self, span: _Span, columns: Sequence[int] | None) -> Iterator[Any]:
        """Yield the rows of a span in the order of the log."""
        if not span.order:
            for block in span.blocks:
                yield self._decode(block, columns)
            return
        cursor = Cursor(self.body, span.order)
        key = read_key(cursor, len(self.head.schema))
        needed = columns if columns is None or key is None else [*columns, key]
        parts = [self._decode(block, needed) for block in span.blocks]
        batch = _joined(parts)
        keys = None
        if key is not None:
            # The key was decoded last, unless all columns were.
            place = key if columns is None else len(columns)
            keys = order_keys(batch.column(place))
            if keys is None:
                raise CorruptArchiveError("rows have no order", span.order)
        order = decode_order(cursor, span.rows, keys)
        if order is not None:
            batch = batch.take(pa.array(order))
        yield batch if columns is None else batch.select(list(range(len(columns))))

    def _decode(self, block: _Block, columns: Sequence[int] | None) -> Any:
        """Decode columns of a block, in the order given."""
        cursor = Cursor(self.body, block.offset, block.offset + block.length)
        batch = decode_frame(cursor, self.head.schema, block.rows, self.trails, columns)
        if columns is None:
            return batch
        known = sorted(set(columns))
        return batch.select([known.index(column) for column in columns])


def encode_head(head: FrameHead) -> bytes:
    """Encode what is known of a log, but for its tracks."""
    schema = head.schema.serialize().to_pybytes()
    packed = deflate(schema)
    track = 0 if head.track_column is None else head.track_column + 1
    codec = _CODECS.index(head.codec) if head.codec in _CODECS else 1
    return b"".join(
        [
            encode_varint(len(schema)),
            encode_varint(len(packed)),
            packed,
            bytes([codec]),
            encode_varint(len(head.row_groups)),
            encode_column(np.array(head.row_groups, np.int64))[0],
            encode_varint(track),
        ]
    )


def read_head(cursor: Cursor, trails: Trails) -> tuple[FrameHead, Groups | None]:
    """Undo :func:`encode_head`, and read the tracks after it.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no head.
    """
    size = cursor.read_varint("bytes of a schema")
    packed = cursor.read_bytes(cursor.read_varint("bytes of a packed schema"), "a schema")
    if size > _MAX_SCHEMA:
        raise cursor.error(f"a schema of {size} bytes")
    try:
        schema = pa.ipc.read_schema(pa.py_buffer(inflate(packed, size, cursor.offset)))
        # Names are read, and found to be no UTF-8, only now.
        names = schema.names
    except (pa.ArrowException, OSError, ValueError) as error:
        raise cursor.error(f"a schema is damaged: {error}") from None

    # How the file was written, and which column names tracks.
    codec = cursor.read_byte("a codec")
    count = cursor.read_varint("a number of row groups")
    if codec >= len(_CODECS) or count > cursor.remaining * _ROWS_PER_BYTE:
        raise cursor.error(f"{count} row groups by codec {codec}")
    groups, _ = decode_column(cursor, count)
    if count and (groups.min() < 0 or groups.max() > _MAX_ROWS):
        raise cursor.error("a row group is out of range")
    track = cursor.read_varint("a column of tracks")
    if track > len(names):
        raise cursor.error(f"tracks in column {track} of {len(names)}")
    head = FrameHead(schema, _CODECS[codec], tuple(groups.tolist()), track - 1 if track else None)
    return head, decode_groups(cursor, trails) if track else None


def write_spans(
    source: FrameSource, finder: GuideFinder, known: dict[bytes, int], spool: BinaryIO
) -> None:
    """Write the spans of a log; ``known`` gets its tracks, numbered as they first appear.

    Raises
    ------
    OverflowError
        If columns of a block take more memory than readers give them.
    """
    head = source.head
    is_sorted = head.track_column is not None
    for span in _whole_spans(source.batches(_ONE_BLOCK_ROWS), is_sorted=is_sorted):
        batch, groups, order = span, np.zeros(0, np.int64), b""
        if head.track_column is not None:
            groups = _groups(batch.column(head.track_column), known)
            by_track = np.argsort(groups, kind="stable")
            order = _encode_order(batch, by_track)
            batch, groups = batch.take(pa.array(by_track)), groups[by_track]

        # Blocks are short in long logs whose rows are sorted.
        is_long = is_sorted and head.rows > _ONE_BLOCK_ROWS
        limit = _BLOCK_ROWS if is_long else _SPAN_ROWS
        bounds = [*range(0, batch.num_rows, limit), batch.num_rows]
        spool.write(encode_varint(batch.num_rows) + encode_varint(len(bounds) - 1))
        if is_sorted:
            spool.write(encode_varint(len(order)) + order)
        for first, after in itertools.pairwise(bounds):
            if is_sorted:
                spool.write(encode_runs(groups[first:after]))
            coded = encode_frame(batch.slice(first, after - first), finder)
            spool.write(encode_varint(after - first) + encode_varint(len(coded)) + coded)


def read_frame_log(
    cursor: Cursor, head: FrameHead, groups: Groups | None, trails: Trails
) -> FrameLog:
    """Read where the rows of a log lie; nothing is decoded.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no spans of so many rows.
    """
    spans, left = [], head.rows
    while left:
        rows = cursor.read_varint("rows of a span")
        count = cursor.read_varint("a number of blocks")
        if not 0 < rows <= min(left, _SPAN_ROWS) or not 0 < count <= rows:
            raise cursor.error(f"{rows} rows in {count} blocks, where {left} are left")
        order = 0
        if groups is not None:
            length = cursor.read_varint("the length of an order")
            order = cursor.offset
            cursor.read_bytes(length, "an order")
        blocks = tuple(_read_block(cursor, groups) for _ in range(count))
        if sum(block.rows for block in blocks) != rows:
            raise cursor.error(f"blocks do not have {rows} rows")
        spans.append(_Span(blocks, rows, order))
        left -= rows
    return FrameLog(head, tuple(spans), cursor.data, trails, groups)


def name_of_value(value: object) -> bytes:
    """Name of a track in a column of any type, as bytes; empty for a missing value."""
    return b"" if value is None else str(value).encode()


def _read_block(cursor: Cursor, groups: Groups | None) -> _Block:
    """Read the head of a block, and pass over its bytes."""
    runs = () if groups is None else read_runs(cursor, len(groups.cells))
    rows = cursor.read_varint("rows of a block")
    length = cursor.read_varint("the length of a block")
    if not 0 < rows <= min(_SPAN_ROWS, _FREE_ROWS + _ROWS_PER_BYTE * length):
        raise cursor.error(f"{rows} rows in {length} bytes")
    if groups is not None and rows != sum(count for _, count in runs):
        raise cursor.error(f"tracks do not have {rows} rows")
    block = _Block(rows, cursor.offset, length, runs)
    cursor.read_bytes(length, "a block")
    return block


def _whole_spans(batches: Iterator[Any], *, is_sorted: bool) -> Iterator[Any]:
    """Join batches to spans, and cut them."""
    limit = _SPAN_ROWS if is_sorted else _ONE_BLOCK_ROWS
    pending: list[Any] = []
    for batch in batches:
        rest = batch
        while rest.num_rows:
            free = limit - sum(part.num_rows for part in pending)
            pending.append(rest.slice(0, free))
            rest = rest.slice(free)
            if sum(part.num_rows for part in pending) == limit:
                yield _joined(pending)
                pending = []
    if pending:
        yield _joined(pending)


def _joined(batches: Sequence[Any]) -> Any:
    """One batch of several."""
    table = pa.Table.from_batches(batches).unify_dictionaries()
    return table.combine_chunks().to_batches()[0]


def _groups(column: Any, known: dict[bytes, int]) -> _Ints:
    """Number of the track of each row."""
    coded = column if pa.types.is_dictionary(column.type) else column.dictionary_encode("encode")
    names = [name_of_value(value) for value in [*coded.dictionary.to_pylist(), None]]
    codes = np.asarray(coded.indices.fill_null(len(names) - 1)).astype(np.int64)
    # In the order in which rows first have them.
    used, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    numbers = np.zeros(len(used), np.int64)
    for i in np.argsort(first).tolist():
        numbers[i] = known.setdefault(names[int(used[i])], len(known))
    found: _Ints = numbers[inverse]
    return found


def _encode_order(batch: Any, by_track: _Ints) -> bytes:
    """Encode the order of rows, by the column that tells it best."""
    columns = [i for i, column in enumerate(batch.columns) if order_keys(column[:1]) is not None]

    def keys(column: int, count: int | None) -> _Ints:
        found = order_keys(batch.column(column)[:count])
        assert found is not None
        return found

    return encode_order(by_track, keys, columns)
