"""Read roads from tables: GeoParquet, and CSV with lines in well-known text or with their ends."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.crs import METRES
from gpszip.io.frames.geometries import read_lines
from gpszip.io.frames.geometry_columns import find_geometry
from gpszip.io.networks.features import RoadFeatures, find_columns, road_lines
from gpszip.io.networks.lines import RoadLines
from gpszip.io.networks.wkb import WkbLines, parse_wkt_line
from gpszip.io.storage.source import Source

__all__ = ["is_road_table", "read_csv_lines", "read_parquet_lines"]

#: Features that are read at a time.
_BATCH_FEATURES = 65_536

#: Bytes of a block of CSV at least, which is what Arrow takes by default.
_MIN_BLOCK = 1 << 20

#: Bytes of a block of CSV at most: Arrow counts them with 32 bits.
_MAX_BLOCK = (1 << 31) - 1

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 160

#: Columns of lines in well-known text.
_WKT_NAMES = ("line", "wkt", "geometry")

#: Axes of the columns with both ends of straight lines, such as ``u_lon``.
_END_AXES = (("lon", "lat"), ("x", "y"))

#: Vertices of a straight line.
_STRAIGHT = 2

Floats = NDArray[np.float64]


# GeoParquet


def read_parquet_lines(source: Source, *, metric: bool | None = None) -> RoadLines:
    """Read the lines of a GeoParquet file, with the columns that say direction, speed and class.

    Parameters
    ----------
    source : Source
        The file.
    metric : bool, optional
        Whether the log is in x and y; None if no log is given.

    Raises
    ------
    InputError
        If it is damaged, holds no lines, or is in degrees and the log is not.
    """
    try:
        return _read_parquet(source, metric)
    except (pa.ArrowException, OSError) as error:
        reason = " ".join(str(error).split())[:_MAX_REASON_LETTERS]
        raise InputError(f"can't be read as lines: {reason}", path=source.name) from error


def _read_parquet(source: Source, metric: bool | None) -> RoadLines:
    # Find the column of lines.
    is_file = source.path is not None and not source.is_gzip
    with pq.ParquetFile(str(source.path) if is_file else pa.BufferReader(source.read())) as file:
        names = file.schema_arrow.names
        geometry = find_geometry(file.schema_arrow, source.name)
        if geometry is None:
            raise InputError(
                "a table without a column of geometries",
                path=source.name,
                remedy="write it as GeoParquet, with the lines in well-known binary",
            )

        # Read batches of it, and of the columns with a role.
        column, roles = names[geometry.number], find_columns(names)
        features = RoadFeatures()
        used = list({column, *roles.values()})
        _check_names(names, used, source.name)
        for batch in file.iter_batches(_BATCH_FEATURES, columns=used):
            batch.validate(full=True)  # finds texts that aren't UTF-8, for instance
            lines = read_lines(batch.column(column), geometry.encoding, source.name, column)
            columns = {role: batch.column(name) for role, name in roles.items()}
            features.add(lines, batch.num_rows, columns)
    return road_lines(features, geometry.crs, source.name, metric=metric)


def _check_names(names: Sequence[str], used: Sequence[str], where: str) -> None:
    """Refuse a table in which two columns have the name of one that is used."""
    for name in used:
        if names.count(name) > 1:
            raise InputError(
                f"{names.count(name)} columns are named {name!r}", path=where, remedy="rename them"
            )


# CSV


class _RoadColumns(NamedTuple):
    """Where a table has its lines: in well-known text, or by the ends of straight ones."""

    wkt: str | None
    ends: tuple[str, ...]

    @property
    def crs(self) -> str | None:
        """Coordinate system that the names of the columns tell."""
        if not self.ends:
            return None
        return "EPSG:4326" if self.ends[0].endswith("lon") else METRES


def is_road_table(head: bytes) -> bool:
    """Whether text begins with a header that has columns of lines.

    Examples
    --------
    >>> is_road_table(b"u,v,u_x,u_y,v_x,v_y"), is_road_table(b"t,lat,lon")
    (True, False)
    """
    names = _header(head)
    found = _find_road_columns(names)
    return found.wkt is not None or bool(found.ends)


def _header(head: bytes) -> list[str]:
    first = head.partition(b"\n")[0].decode("utf-8-sig", "replace").rstrip("\r")
    try:
        return next(csv.reader(io.StringIO(first)), [])
    except csv.Error:
        return []


def _find_road_columns(names: Sequence[str]) -> _RoadColumns:
    wkt = next((name for name in names if name.lower() in _WKT_NAMES), None)
    for axes in _END_AXES:
        ends = tuple(f"{end}_{axis}" for end in "uv" for axis in axes)
        if set(ends) <= set(names):
            return _RoadColumns(wkt, ends)
    return _RoadColumns(wkt, ())


def read_csv_lines(source: Source, *, metric: bool | None = None) -> RoadLines:
    """Read the lines of a CSV file, such as a map that GPSZip wrote.

    Parameters
    ----------
    source : Source
        The file. A column ``line``, ``wkt`` or ``geometry`` holds well-known text; where it is
        missing, lines are straight from ``u_lon, u_lat`` to ``v_lon, v_lat``, or from
        ``u_x, u_y`` to ``v_x, v_y``.
    metric : bool, optional
        Whether the log is in x and y; None if no log is given.

    Raises
    ------
    InputError
        If it is damaged, or holds no lines.
    """
    # Cells stay texts, except for the ends.
    names = _header(source.head())
    where, roles = _find_road_columns(names), find_columns(names)
    used = [*where.ends, *roles.values(), *([] if where.wkt is None else [where.wkt])]
    _check_names(names, used, source.name)
    types = {name: pa.string() for name in names} | dict.fromkeys(where.ends, pa.float64())
    try:
        options = pc.ConvertOptions(column_types=types, strings_can_be_null=True)
        # Arrow reads no row longer than a block, and one line may have a million vertices.
        data = source.read()
        reading = pc.ReadOptions(block_size=min(max(len(data), _MIN_BLOCK), _MAX_BLOCK))
        table = pc.read_csv(pa.BufferReader(data), reading, convert_options=options)
    except (pa.ArrowException, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:_MAX_REASON_LETTERS]
        raise InputError(f"can't be read as lines: {reason}", path=source.name) from error

    # Lines, and the columns with a role.
    features = RoadFeatures()
    columns = {role: table.column(name).combine_chunks() for role, name in roles.items()}
    features.add(_table_lines(table, where), table.num_rows, columns)
    return road_lines(features, where.crs, source.name, metric=metric)


def _table_lines(table: Any, where: _RoadColumns) -> WkbLines:
    """Lines of all rows; a row without one counts as another geometry."""
    # Straight lines
    if where.wkt is None:
        ends = np.stack([table.column(name).to_numpy() for name in where.ends], axis=1)
        rows = np.flatnonzero(np.isfinite(ends).all(axis=1))
        offsets = _STRAIGHT * np.arange(len(rows) + 1)
        return WkbLines(ends[rows].reshape(-1, 2), offsets, rows, len(ends) - len(rows))

    # Well-known text
    lines = [parse_wkt_line(text or "") for text in table.column(where.wkt).to_pylist()]
    rows = np.array([i for i, line in enumerate(lines) if line], np.int64)
    counts = [len(lines[i]) for i in rows.tolist()]
    points = np.array([point for line in lines for point in line], np.float64).reshape(-1, 2)
    offsets = np.append(0, np.cumsum(counts)).astype(np.int64)
    return WkbLines(points, offsets, rows, len(lines) - len(rows))
