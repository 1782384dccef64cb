"""Batches of Arrow to bytes and back: columns with types, such as those of Parquet."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import pyarrow as pa

from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.arrays import (
    Integers,
    column_bytes,
    count_integers,
    decode_array,
    encode_array,
)
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.tables import decode_table, encode_table
from gpszip.lossless.trails import Trails

__all__ = ["decode_frame", "encode_frame"]

#: Columns of integers that a column may have; a forged number must not ask for memory.
_MAX_INTEGERS = 1 << 12


def encode_frame(batch: Any, finder: GuideFinder) -> bytes:
    """Encode a batch of rows: all of its numbers are one table.

    Parameters
    ----------
    batch : pyarrow.RecordBatch
        Some rows at least.
    finder : GuideFinder
        Finds what walks tell of the numbers.

    Raises
    ------
    OverflowError
        If columns take more memory than readers give them.

    Examples
    --------
    >>> from gpszip.lossless.trails import NO_TRAILS
    >>> batch = pa.record_batch({"t": [1, 2, None], "x": [0.5, float("nan"), -0.0]})
    >>> data = encode_frame(batch, GuideFinder(NO_TRAILS))
    >>> decode_frame(Cursor(data), batch.schema, 3, NO_TRAILS)["x"].to_pylist()
    [0.5, nan, -0.0]
    """
    integers, parts = Integers(), []
    for column in batch.columns:
        record = encode_array(column, integers, finder)
        parts.append(encode_varint(len(record)) + record)
    if len(integers.columns) > _MAX_INTEGERS:
        raise OverflowError(f"{len(integers.columns)} columns of numbers")
    table = encode_table(integers.columns, integers.digits, finder) if integers.columns else b""
    return b"".join([*parts, encode_varint(len(integers.columns)), table])


def decode_frame(
    cursor: Cursor,
    schema: Any,
    rows: int,
    trails: Trails,
    columns: Collection[int] | None = None,
) -> Any:
    """Undo :func:`encode_frame`; the rest of the cursor's bytes are the batch.

    Parameters
    ----------
    schema : pyarrow.Schema
        Types of the columns.
    rows : int
        Number of rows.
    trails : Trails
        The walks.
    columns : collection of int, optional
        Columns to decode, and those that predict them; by default all.

    Returns
    -------
    pyarrow.RecordBatch
        The columns asked for, in the order of the schema.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no such batch.
    """
    try:
        return _decode(cursor, schema, rows, trails, columns)
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        # Arrow has no error of its own for damaged bytes.
        raise cursor.error(f"columns are damaged: {error}") from None
    except StopIteration:
        raise cursor.error("a column lacks its numbers") from None


def _decode(
    cursor: Cursor, schema: Any, rows: int, trails: Trails, columns: Collection[int] | None
) -> Any:
    """Decode columns."""
    # Which columns of integers are those of which column.
    chosen = sorted(range(len(schema)) if columns is None else set(columns))
    records = [column_bytes(cursor) for _ in schema]
    own, first = [], 0
    for field, record in zip(schema, records, strict=True):
        again = Cursor(record.data, record.offset, record.end, record.base)
        count = count_integers(again, field.type, rows)
        own.append(range(first, first + count))
        first += count
    total = cursor.read_varint("a number of columns")
    if total != first or total > _MAX_INTEGERS:
        raise cursor.error(f"{total} columns of numbers, not {first}")

    # The table, and the columns that are asked for.
    wanted = {i for column in chosen for i in own[column]}
    integers = decode_table(cursor, rows, total, trails, wanted) if total else []
    cursor.expect_end("a batch of columns")
    arrays = []
    for column in chosen:
        numbers = iter([integers[i] for i in own[column]])
        arrays.append(
            decode_array(records[column], schema.field(column).type, rows, numbers, trails)
        )
    found = pa.record_batch(arrays, schema=pa.schema([schema.field(column) for column in chosen]))
    try:
        found.validate(full=True)
    except pa.ArrowException as error:
        raise CorruptArchiveError(f"columns are damaged: {error}", cursor.offset) from None
    return found
