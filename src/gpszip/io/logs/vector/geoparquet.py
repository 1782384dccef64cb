"""Geometries in Parquet files: GeoParquet 1.0 and 1.1, and columns of GeoArrow."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.geo.crs import METRES, to_projjson
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.vector.geometry import geometry_kinds, parse_points
from gpszip.io.logs.vector.line_rows import read_line_rows
from gpszip.io.logs.vector.point_rows import PointRows, open_point_rows
from gpszip.io.logs.vector.point_tables import PointTable, point_tables, to_timestamps
from gpszip.io.logs.vector.reference import Reference, ReferenceKind, find_reference
from gpszip.io.tables.roles import find_roles

__all__ = ["GeoParquet", "open_geoparquet", "write_geoparquet"]

#: Encodings of geometries that are read.
_ENCODINGS = ("wkb", "point", "linestring")

#: Prefix of the names by which Arrow marks columns of geometries.
_GEOARROW = b"geoarrow."

#: Roles of coordinates. A user who names one means a column of numbers.
_AXES = {"x", "y", "z", "lat", "lon"}

#: Numbers of a bounding box in two dimensions.
_BOX_NUMBERS = ("xmin", "ymin", "xmax", "ymax")


@dataclass(frozen=True)
class GeoParquet:
    """A Parquet file whose rows have geometries.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    geometry : str
        Name of the column of geometries.
    reference : Reference
        Their coordinate system.
    tables : callable
        Yields tables of all rows with the columns of the given names.
    columns : list of str
        Names of all columns.
    points : PointRows, optional
        The rows if they are points; None if they are lines.
    """

    name: str
    geometry: str
    reference: Reference
    tables: Callable[[list[str]], Iterable[Any]]
    columns: list[str]
    points: PointRows | None

    def read(self, request: Request) -> RawLog:
        """Return all rows as one log.

        Raises
        ------
        InputError
            If there is no row, or none with a position.
        """
        if self.points is not None:
            return self.points.log(request)
        return read_line_rows(
            self.tables(self.columns), self.geometry, self.reference, request, self.name
        )


def open_geoparquet(
    schema: Any,
    tables: Callable[[list[str]], Iterable[Any]],
    request: Request,
    where: str,
) -> GeoParquet | None:
    """Find the geometries of a Parquet file, and which other column holds what.

    Parameters
    ----------
    schema : pyarrow.Schema
        Columns and metadata.
    tables : callable
        Yields tables of all rows with the columns of the given names.
    request : Request
        Columns by role, attributes, and whether times are needed.
    where : str
        Name of the file, for messages.

    Returns
    -------
    GeoParquet or None
        None if positions are in columns of numbers: there are no geometries, the user has named
        such columns, or the geometries are no points and there are such columns.

    Raises
    ------
    InputError
        If there is no column for times, or geometries can't be read.
    """
    # A user who names columns of coordinates means these.
    is_by_position = isinstance(request.columns, tuple)
    if is_by_position or (isinstance(request.columns, Mapping) and _AXES & set(request.columns)):
        return None
    found = _find_geometry(schema)
    if found is None:
        return None
    name, description = found

    # What are they? The file states it, or else its first rows show it.
    first = next((table[name] for table in tables([name]) if len(table)), None)
    stated = description.get("geometry_types")
    kinds = [str(kind) for kind in stated] if isinstance(stated, list) else []
    seen = [] if first is None else geometry_kinds(first)
    are_points = any("Point" in kind for kind in [*kinds, *seen]) or not (kinds or seen)
    properties = [other for other in schema.names if other != name]
    if not are_points and _has_numbers(properties, request, where):
        return None

    # Points are rows of a table.
    _check_encoding(description, name, where)
    reference = _find_reference(description, where)
    points = None
    if are_points:
        has_z = any(kind.endswith((" Z", " ZM")) for kind in kinds)
        has_z = has_z or (first is not None and _has_z(first))
        points = open_point_rows(properties, name, reference, tables, request, where, has_z=has_z)
    columns = [name, *(other for other in properties if _is_plain(schema, other))]
    return GeoParquet(where, name, reference, tables, columns, points)


def _find_geometry(schema: Any) -> tuple[str, Mapping[str, Any]] | None:
    """Return the column of geometries and what the file says about it; None without one."""
    # GeoParquet names the primary column.
    try:
        geo = json.loads((schema.metadata or {})[b"geo"])
        name = geo["primary_column"]
        description = geo["columns"][name]
    except (KeyError, ValueError, TypeError, RecursionError):
        pass
    else:
        if isinstance(description, Mapping) and name in schema.names:
            return name, description

    # Arrow marks columns, by a type or in their metadata.
    for field in schema:
        metadata = field.metadata or {}
        mark = metadata.get(b"ARROW:extension:name", b"")
        details = metadata.get(b"ARROW:extension:metadata", b"")
        if isinstance(field.type, pa.BaseExtensionType):
            mark = str(getattr(field.type, "extension_name", "")).encode()
        if mark.startswith(_GEOARROW):
            encoding = mark.removeprefix(_GEOARROW).decode("utf-8", "replace")
            return field.name, {"encoding": encoding, "crs": _arrow_crs(details)}
    return None


def _arrow_crs(details: bytes) -> Any:
    try:
        return json.loads(details or b"{}").get("crs")
    except (ValueError, AttributeError, RecursionError):
        return None


def _has_numbers(names: list[str], request: Request, where: str) -> bool:
    """Whether columns of numbers hold the positions."""
    columns = request.columns if isinstance(request.columns, Mapping) else None
    try:
        find_roles(names, columns, (), where, times=request.times)
    except InputError:
        return False
    return True


def _check_encoding(description: Mapping[str, Any], name: str, where: str) -> None:
    encoding = str(description.get("encoding", "WKB"))
    if encoding.lower() not in _ENCODINGS:
        raise InputError(
            f"column {name!r} holds geometries of encoding {encoding[:40]!r}",
            path=where,
            remedy="write them as WKB, or as points",
        )


def _find_reference(description: Mapping[str, Any], where: str) -> Reference:
    # Without the member, GeoParquet 1.1 means longitude and latitude; null means that it's unknown.
    if "crs" not in description:
        return Reference(ReferenceKind.WGS84)
    return find_reference(description["crs"], where)


def _has_z(geometries: Any) -> bool:
    return bool(np.isfinite(parse_points(geometries).table[:, 2]).any())


def _is_plain(schema: Any, name: str) -> bool:
    """Whether a column may hold names of tracks."""
    return not pa.types.is_nested(schema.field(name).type)


# Writing


def write_geoparquet(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write tracks as GeoParquet 1.1: ``track_id``, ``t``, attributes, and a point in each row.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe. Times are timestamps in UTC. The height is z of the
        points, and stays a column.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If the tracks have different columns.
    """
    import pyarrow.parquet as pq

    # The column of boxes lets readers pass over rows that lie elsewhere.
    opened = point_tables(tracks)
    columns: Mapping[str, Any] = {
        "encoding": "WKB",
        "geometry_types": ["Point Z" if opened.has_z else "Point"],
        "covering": {"bbox": {name: ["bbox", name] for name in _BOX_NUMBERS}},
        **({} if opened.geographic else {"crs": to_projjson(METRES)}),
    }
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": columns}}
    metadata = {b"geo": json.dumps(geo).encode()}

    # Write table by table.
    tables = map(_finish, opened.tables)
    first = next(tables)
    with pq.ParquetWriter(sink, first.schema.with_metadata(metadata)) as writer:
        for table in chain([first], tables):
            writer.write_table(table.replace_schema_metadata(metadata))


def _finish(rows: PointTable) -> Any:
    """Turn times into timestamps, and add the column of boxes."""
    table = rows.table
    if table.column_names[1] == "t":
        table = table.set_column(1, "t", to_timestamps(table.column(1)))
    # The box of a point is the point.
    numbers = [pa.array(rows.xy[:, i % 2]) for i in range(len(_BOX_NUMBERS))]
    return table.append_column("bbox", pa.StructArray.from_arrays(numbers, list(_BOX_NUMBERS)))
