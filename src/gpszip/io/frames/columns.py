"""The columns of any frame: their names, and Arrow columns of those that are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.frames.geometry_columns import GeometryColumn, find_geometry
from gpszip.io.frames.stream import open_stream, stream_batches

__all__ = ["ColumnReader", "FrameColumns", "lazy_columns", "stream_columns"]

#: Rows of a batch.
_BATCH_ROWS = 1 << 17

#: Makes an Arrow column when it is asked for.
ColumnReader = Callable[[], Any]


@dataclass(frozen=True, eq=False)
class FrameColumns:
    """The columns of a frame.

    Parameters
    ----------
    names : tuple of str
        Names of all columns.
    read : callable
        Gets indices of columns. It yields tables of these columns, with the rows in order.
    geometry : GeometryColumn, optional
        The column with the positions.
    rows : int, optional
        Number of rows; None if only reading tells.
    """

    names: tuple[str, ...]
    read: Callable[[Sequence[int]], Iterator[Any]]
    geometry: GeometryColumn | None = None
    rows: int | None = None


def stream_columns(frame: Any, where: str) -> FrameColumns:
    """Columns of a frame with ``__arrow_c_stream__``, read batch by batch.

    Parameters
    ----------
    frame : object with ``__arrow_c_stream__``
        The frame.
    where : str
        Its name in messages.

    Raises
    ------
    InputError
        If it is a single column, or its package refuses.

    Examples
    --------
    >>> columns = stream_columns(pa.table({"t": [0, 1], "x": [2, 3]}), "Table")
    >>> columns.names, [table.to_pydict() for table in columns.read([1])]
    (('t', 'x'), [{'x': [2, 3]}])
    """
    # Some streams can be opened only once: the one that tells the schema is the first to be read.
    reader = open_stream(frame, where)
    unread = [reader]

    def read(indices: Sequence[int]) -> Iterator[Any]:
        opened = unread.pop() if unread else open_stream(frame, where)
        for batch in stream_batches(opened, where):
            yield pa.Table.from_batches([batch.select(list(indices))])

    rows = getattr(frame, "num_rows", getattr(frame, "height", None))
    return FrameColumns(
        tuple(reader.schema.names),
        read,
        find_geometry(reader.schema, where),
        rows if isinstance(rows, int) else None,
    )


def lazy_columns(
    readers: Mapping[str, ColumnReader],
    where: str,
    rows: int,
    geometry: GeometryColumn | None = None,
) -> FrameColumns:
    """Columns in memory, each of which is converted to Arrow when it is asked for.

    Parameters
    ----------
    readers : mapping of str to callable
        Returns the column of each name as a ``pyarrow.ChunkedArray``.
    where : str
        Name of the frame in messages.
    rows : int
        Number of rows.
    geometry : GeometryColumn, optional
        The column with the positions.

    Examples
    --------
    >>> columns = lazy_columns({"t": lambda: pa.chunked_array([[0, 1]])}, "dict", 2)
    >>> [table.to_pydict() for table in columns.read([0])]
    [{'t': [0, 1]}]
    """
    names = tuple(readers)

    def read(indices: Sequence[int]) -> Iterator[Any]:
        # All columns have to have the same rows.
        columns = {names[i]: readers[names[i]]() for i in indices}
        if len({len(column) for column in columns.values()}) > 1:
            lengths = ", ".join(f"{name!r} {len(column):,}" for name, column in columns.items())
            raise InputError(f"columns differ in length: {lengths}", path=where)

        # Yield them batch by batch.
        table = pa.table(list(columns.values()), names=list(columns))
        for batch in table.to_batches(max_chunksize=_BATCH_ROWS):
            yield pa.Table.from_batches([batch])

    return FrameColumns(names, read, geometry, rows)
