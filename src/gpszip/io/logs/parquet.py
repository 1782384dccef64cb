"""Logs as Parquet: files, also in folders that are keys of partitions (``vehicle=7``).

Positions are in columns of numbers, or in geometries (GeoParquet).
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.coreset_files import is_coreset
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.table_batches import TableBatch, interpret_batches
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.track_table import track_tables
from gpszip.io.logs.vector.geoparquet import open_geoparquet
from gpszip.io.storage.source import Source
from gpszip.io.tables.given_columns import find_requested_roles, rename_columns
from gpszip.io.tables.roles import Roles
from gpszip.io.tables.table import build_raw_log

__all__ = ["read_parquet", "read_parquet_batches", "write_parquet"]

#: Rows of a batch.
_BATCH_ROWS = 1 << 17

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 120


# Reading


def read_parquet(source: Source, request: Request) -> RawLog:
    """Read a log from a Parquet file; folders that are keys of partitions are columns.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns, unit of time and attributes.

    Raises
    ------
    InputError
        If the file is damaged, has no row, or no column for time or position.
    """
    try:
        dataset = _open_dataset(source)
        geometries = open_geoparquet(
            dataset.schema, partial(_tables, dataset), request, source.name
        )
        if geometries is not None:
            return geometries.read(request)
        names = rename_columns(dataset.schema.names, request, source.name)
        roles = find_requested_roles(names, request, source.name)
        table = dataset.to_table(columns=_columns_used(dataset.schema, roles))
        table.validate(full=True)  # finds texts that aren't UTF-8, for instance
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise InputError(
            f"damaged Parquet file: {reason}", path=source.name, remedy="fetch or write it again"
        ) from None
    if table.num_rows == 0:
        raise NoPositionsError("columns, but no rows", path=source.name)
    return build_raw_log(table.columns, names, roles, request, source.name)


def read_parquet_batches(source: Source, request: Request) -> LogBatches | None:
    """Open a Parquet file to be read in batches.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns, unit of time and attributes.

    Returns
    -------
    LogBatches or None
        None for a stream or a gzip file: the footer of Parquet has to be reached by seeking. None
        for rows that are lines, too.

    Raises
    ------
    InputError
        If there is no column for time or position.
    """
    # What has to be read at once.
    path = source.path
    if path is None or source.is_gzip:
        return None

    # Positions in geometries, if these are points.
    dataset = _open_dataset(source)
    schema = dataset.schema
    geometries = open_geoparquet(schema, partial(_tables, dataset), request, source.name)
    if geometries is not None:
        points = geometries.points
        if points is None:
            return None
        return LogBatches(
            points.logs(request),
            CoordinateKind(points.reference.geographic, len(points.roles.axes)),
            count_rows=lambda: _count_rows(path),
        )

    # Positions in columns of numbers.
    names = rename_columns(schema.names, request, source.name)
    roles = find_requested_roles(names, request, source.name)
    return LogBatches(
        interpret_batches(_ParquetReader(source, names, roles), request),
        CoordinateKind(roles.geographic, len(roles.axes), _geoparquet_crs(schema)),
        count_rows=lambda: _count_rows(path),
    )


@dataclass(frozen=True)
class _ParquetReader:
    """Reads batches of cells, see :class:`gpszip.io.logs.table_batches.TableReader`."""

    source: Source
    column_names: tuple[str, ...]
    roles: Roles
    first_row_number: int = 1

    @property
    def name(self) -> str:
        return self.source.name

    def read(self) -> Iterator[TableBatch]:
        """Yield all rows."""
        dataset = _open_dataset(self.source)
        for table in _tables(dataset, _columns_used(dataset.schema, self.roles)):
            yield TableBatch(table)

    def read_as_text(self) -> Iterator[Any]:
        """Yield all rows as tables, with the types that the file has."""
        return (batch.table for batch in self.read())

    def uses_decimal_comma(self) -> None:
        """Leave decimal marks of texts to be found in the first rows."""

    def explain_error(self, error: Exception) -> str:
        return f"damaged: {str(error).splitlines()[0][:_MAX_REASON_LETTERS]}"


def _open_dataset(source: Source) -> Any:
    """Open a Parquet file as a dataset, with the keys of its partition as columns."""
    import pyarrow.dataset as ds
    import pyarrow.parquet as pq

    # Arrow takes paths as UTF-8 only.
    path = source.path
    if path is not None and not _is_unicode(path):
        raise InputError(
            "the name is no UTF-8, as names of Parquet files have to be",
            path=source.name,
            remedy="rename it",
        )

    # A stream or a gzip file is read into memory.
    if path is None or source.is_gzip:
        table = pq.read_table(pa.BufferReader(source.read()))
        _check_schema(table.schema, source.name)
        return ds.dataset(table)

    # Open the file in place. In a folder, parts of its path (key=value) are columns as well.
    _check_schema(pq.read_schema(str(path)), source.name)
    if source.folder is None:
        return ds.dataset(str(path), format="parquet")
    return ds.dataset(
        [str(path)],
        format="parquet",
        partitioning=ds.partitioning(flavor="hive"),
        partition_base_dir=str(source.folder),
    )


def _tables(dataset: Any, columns: list[str]) -> Iterator[Any]:
    """Yield the rows of a dataset as tables, so that few are in memory."""
    for batch in dataset.to_batches(
        columns=columns,
        batch_size=_BATCH_ROWS,
        batch_readahead=1,
        fragment_readahead=1,
        use_threads=False,
    ):
        batch.validate(full=True)  # finds texts that aren't UTF-8, for instance
        yield pa.Table.from_batches([batch])


def _is_unicode(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _check_schema(schema: Any, where: str) -> None:
    """Refuse coresets, and columns of one name: Arrow can't tell them apart."""
    if is_coreset(schema):
        raise InputError(
            "is the coreset of a log, not a log",
            path=where,
            remedy="give the log; compress and segments take a coreset as their only LOG",
        )
    name, times = Counter(schema.names).most_common(1)[0] if schema.names else ("", 0)
    if times > 1:
        raise InputError(
            f"{times} columns are named {name!r}",
            path=where,
            remedy="give them different names where the file is written",
        )


def _columns_used(schema: Any, roles: Roles) -> list[str]:
    return [str(schema.names[i]) for i in roles.used]


def _geoparquet_crs(schema: Any) -> str:
    """Return the coordinate systems that GeoParquet names, as JSON; empty if it names none."""
    try:
        columns = json.loads((schema.metadata or {})[b"geo"])["columns"].values()
        return json.dumps([column.get("crs") for column in columns], sort_keys=True)
    except (KeyError, ValueError, AttributeError, TypeError):
        return ""


def _count_rows(path: Path) -> int:
    import pyarrow.parquet as pq

    return int(pq.ParquetFile(str(path)).metadata.num_rows)


# Writing


def write_parquet(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write tracks with the columns that :func:`gpszip.io.logs.csv.write_csv` has.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe.
    sink : binary file
        The file to write to.
    """
    import pyarrow.parquet as pq

    tables = track_tables(tracks)
    first = next(tables)
    with pq.ParquetWriter(sink, first.schema) as writer:
        writer.write_table(first)
        for table in tables:
            writer.write_table(table)
