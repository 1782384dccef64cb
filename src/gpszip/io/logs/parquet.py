"""Logs as Parquet: files, of which folders may be keys of partitions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.track_table import track_tables
from gpszip.io.storage.source import Source
from gpszip.io.tables.roles import find_roles
from gpszip.io.tables.table import build_raw_log

__all__ = ["parquet_dataset", "read_parquet", "sniff_parquet", "write_parquet"]


def sniff_parquet(head: bytes) -> bool:
    """Whether a file that starts like this is Parquet."""
    return head[:4] == b"PAR1"


def read_parquet(source: Source, request: Request) -> RawLog:
    """Read a log from a Parquet file; folders that are keys of partitions (``vehicle=7``) are columns.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns, unit of time and attributes.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If it is damaged, has no row, or no column for time or position.
    """
    try:
        dataset = parquet_dataset(source)
        names = [str(name) for name in dataset.schema.names]
        titles = _titles(names, request, source.name)
        roles = find_roles(
            titles,
            request.columns if isinstance(request.columns, Mapping) else None,
            request.keep,
            source.name,
            heading=request.heading,
            times=request.times,
        )
        table = dataset.to_table(columns=[names[i] for i in roles.used])
        table.validate(full=True)  # texts that are no UTF-8, for instance
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{source.name}: damaged Parquet file: {str(error).splitlines()[0]}"
        ) from None
    if table.num_rows == 0:
        raise InputError(f"{source.name}: columns, but no rows")
    return build_raw_log(table.columns, titles, roles, request, source.name)


def write_parquet(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write tracks with the columns that :func:`gpszip.io.logs.csv.write_csv` has.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the earth.
    sink : binary file
        Where to.
    """
    import pyarrow.parquet as pq

    tables = track_tables(tracks)
    first = next(tables)
    with pq.ParquetWriter(sink, first.schema) as writer:
        writer.write_table(first)
        for table in tables:
            writer.write_table(table)


def parquet_dataset(source: Source) -> Any:
    """Open a Parquet file as a dataset, with the keys of its partition as columns."""
    import pyarrow.dataset as ds
    import pyarrow.parquet as pq

    if source.path is not None and not _is_unicode(source.path):
        raise InputError(
            f"{source.name}: the name is no UTF-8, as names of Parquet files have to be; rename it"
        )
    packed = (
        pq.read_table(pa.BufferReader(source.read()))
        if source.path is None or source.is_gzip
        else None
    )
    _check_names(pq.read_schema(str(source.path)) if packed is None else packed.schema, source.name)
    if packed is not None:
        return ds.dataset(packed)
    if source.folder is not None:
        hive = ds.partitioning(flavor="hive")
        return ds.dataset(
            [str(source.path)],
            format="parquet",
            partitioning=hive,
            partition_base_dir=str(source.folder),
        )
    return ds.dataset(str(source.path), format="parquet")


def _check_names(schema: Any, where: str) -> None:
    """Refuse columns of one name: Arrow can't tell them apart."""
    name, times = Counter(schema.names).most_common(1)[0] if schema.names else ("", 0)
    if times > 1:
        raise InputError(
            f"{where}: {times} columns are named {name!r}; give them different names where the file is written"
        )


def _is_unicode(path: Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _titles(names: list[str], request: Request, where: str) -> list[str]:
    if not isinstance(request.columns, tuple):
        return names
    if len(request.columns) > len(names):
        raise InputError(
            f"{where}: has {len(names)} columns, but --columns names {len(request.columns)}"
        )
    given = [
        title if title not in ("", "-", "_") else names[i]
        for i, title in enumerate(request.columns)
    ]
    return [*given, *names[len(given) :]]
