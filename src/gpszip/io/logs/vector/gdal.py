"""Logs in GeoPackage and FlatGeobuf, which GDAL reads and writes (extra ``gis``)."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError, MissingExtraError, OutputError
from gpszip.geo.crs import METRES
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.vector.geometry import geometry_kinds, parse_lines, parse_points
from gpszip.io.logs.vector.line_rows import read_line_rows
from gpszip.io.logs.vector.point_rows import PointRows, open_point_rows
from gpszip.io.logs.vector.point_tables import point_tables, to_timestamps
from gpszip.io.logs.vector.reference import Reference, find_reference
from gpszip.io.storage.source import Source
from gpszip.model.read_result import LeftOut

__all__ = [
    "read_vector",
    "read_vector_batches",
    "write_flatgeobuf",
    "write_gpkg",
]

#: Rows that are read at a time.
_BATCH_ROWS = 1 << 16

#: Letters of an error message of GDAL that are shown.
_MAX_REASON_LETTERS = 160

#: Name of the column of geometries. No field has a zero byte in its name.
_GEOMETRY = "\x00geometry"

#: Name that GDAL gives to geometries without one.
_UNNAMED_GEOMETRY = "wkb_geometry"

#: Roles that a column may have beside a geometry.
_ROLES = {"t", "id", "heading"}

#: Column of m in a table of positions.
_M_COLUMN = 3

#: Layers that messages name.
_MAX_SHOWN_LAYERS = 8

#: The layer that is written.
_LAYER = "points"

#: The time that GeoPackages name as their last change, so that equal logs give equal files.
_LAST_CHANGE = {"OGR_CURRENT_DATE": "1970-01-01T00:00:00.000Z"}

_Result = TypeVar("_Result")


# Reading


def read_vector(source: Source, request: Request) -> RawLog:
    """Read a log from the layer whose rows are points with times, or else lines.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns of times and names, unit of time, and attributes.

    Returns
    -------
    RawLog
        A point in each row, or a line: the m of its positions are seconds since 1970, and a line
        without m is a shape. Other layers are left out.

    Raises
    ------
    InputError
        If the file is damaged, or not exactly one layer is a log.
    MissingExtraError
        If pyogrio, which brings GDAL, is not installed.
    """
    layer, left_out = _find_log(source, request)
    if layer.points is not None:
        return layer.points.log(request, left_out)
    return read_line_rows(
        layer.tables(layer.fields), _GEOMETRY, layer.reference, request, source.name, left_out
    )


def read_vector_batches(source: Source, request: Request) -> LogBatches | None:
    """Open a file to be read in batches.

    Parameters
    ----------
    source, request
        As for :func:`read_vector`.

    Returns
    -------
    LogBatches or None
        None for rows that are lines.

    Raises
    ------
    InputError, MissingExtraError
        As for :func:`read_vector`.
    """
    layer, left_out = _find_log(source, request)
    if layer.points is None:
        return None
    kind = CoordinateKind(layer.reference.geographic, len(layer.points.roles.axes))
    return LogBatches(layer.points.logs(request, left_out), kind)


@dataclass(frozen=True)
class _Layer:
    """A layer of a file.

    Parameters
    ----------
    name : str
        Its name.
    kind : str
        Kind of its geometries, as the file states it.
    fields : list of str
        Names of its columns, without that of geometries.
    reference : Reference
        Coordinate system of its geometries.
    tables : callable
        Yields tables of all rows with the columns of the given names, and that of geometries.
    first : pyarrow.Table or None
        Geometries of its first rows; None if it has no rows.
    points : PointRows, optional
        The rows if they are points with times.
    problem : InputError, optional
        Why rows that are points can't be read.
    """

    name: str
    kind: str
    fields: list[str]
    reference: Reference
    tables: Callable[[list[str]], Iterator[Any]]
    first: Any
    points: PointRows | None = None
    problem: InputError | None = None

    @property
    def has_lines(self) -> bool:
        """Whether its first rows are lines."""
        return any("Line" in kind for kind in _kinds(self.first))

    @property
    def has_line_times(self) -> bool:
        """Whether its first line has m."""
        cells = [] if self.first is None else self.first
        for cell in cells:
            for table in parse_lines(cell, self.name, "first row"):
                return bool(np.isfinite(table[:, _M_COLUMN]).any())
        return False


class _Opened(NamedTuple):
    """What GDAL says about a layer."""

    meta: Mapping[str, Any]
    reader: Any


def _find_log(source: Source, request: Request) -> tuple[_Layer, tuple[LeftOut, ...]]:
    """Find the layer that is the log, and list the others as left out."""
    # Positions are geometries, so columns can't be named by position, nor hold coordinates.
    columns = request.columns
    if isinstance(columns, tuple) or (columns and not columns.keys() <= _ROLES):
        raise InputError(
            "its positions are geometries, so --columns can't name their columns",
            path=source.name,
            remedy="name only others: --columns t=COLUMN,id=COLUMN",
        )
    layers = _open_layers(source, request)

    # The only layer of points with times; else the only one of lines with m, else of lines.
    for candidates in (
        [layer for layer in layers if layer.points is not None],
        [layer for layer in layers if layer.has_lines and layer.has_line_times],
        [layer for layer in layers if layer.has_lines],
    ):
        if len(candidates) > 1:
            raise InputError(
                f"{len(candidates)} layers may be the log: {_list_layers(candidates)}",
                path=source.name,
                remedy="copy one to a file of its own: ogr2ogr ONE.gpkg FILE LAYER",
            )
        if candidates:
            (chosen,) = candidates
            reason = f"the log is in layer {chosen.name!r}"
            others = (layer for layer in layers if layer is not chosen)
            return chosen, tuple(
                LeftOut(f"{source.name}: {_list_layers([layer])}", reason) for layer in others
            )

    # What is wrong with points says more than that there is no log.
    problems = [layer.problem for layer in layers if layer.problem is not None]
    if len(problems) == 1:
        raise problems[0]
    raise InputError(
        f"no layer has points with times, or lines; it has: {_list_layers(layers) or 'no layers'}",
        path=source.name,
        remedy="name the column of times with --columns t=COLUMN",
    )


def _list_layers(layers: list[_Layer]) -> str:
    shown = [f"{layer.name!r} ({layer.kind})" for layer in layers[:_MAX_SHOWN_LAYERS]]
    more = len(layers) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def _open_layers(source: Source, request: Request) -> list[_Layer]:
    """Look at the start of each layer."""
    pyogrio = _require_pyogrio(f"reading {source.name}")
    # GDAL opens files in place, but not those that are compressed.
    path = source.path
    is_file = path is not None and not source.is_gzip
    target = str(path.resolve()) if path is not None and is_file else source.read()
    with _explained_errors(source.name):
        names = _quietly(pyogrio.list_layers, target).tolist()
        return [
            _open_layer(target, str(name), str(kind or "no geometries"), request, source.name)
            for name, kind in names
        ]


def _open_layer(target: Any, name: str, kind: str, request: Request, where: str) -> _Layer:
    # Read the first rows.
    with ExitStack() as stack:
        opened = _open(stack, target, name, [])
        meta = opened.meta
        has_geometries = meta["geometry_type"] is not None
        batch = _quietly(next, iter(opened.reader), None) if has_geometries else None
        first = None
        if batch is not None and len(batch):
            batch.validate(full=True)
            first = _geometries(batch, meta)
    with ExitStack() as stack:
        fields = [str(field) for field in _open(stack, target, name, None).meta["fields"]]
    reference = find_reference(meta["crs"], where)
    tables = partial(_tables, target, name, where)
    layer = _Layer(name, kind, fields, reference, tables, first)

    # Find the columns of points.
    is_point = "Point" in kind if first is None else "Point" in "".join(_kinds(first))
    if not has_geometries or not is_point:
        return layer
    has_z = "Z" in kind
    if first is not None:
        has_z |= bool(np.isfinite(parse_points(first).table[:, 2]).any())
    try:
        points = open_point_rows(fields, _GEOMETRY, reference, tables, request, where, has_z=has_z)
    except InputError as error:
        return _Layer(name, kind, fields, reference, tables, first, problem=error)
    return _Layer(name, kind, fields, reference, tables, first, points)


def _kinds(first: Any) -> list[str]:
    return [] if first is None else geometry_kinds(first)


def _open(stack: ExitStack, target: Any, layer: str, columns: list[str] | None) -> _Opened:
    """Open a layer; ``columns`` are those to read besides geometries, None for all."""
    import pyogrio

    # Times come as texts, since those of FlatGeobuf may have any offset from UTC.
    manager = pyogrio.open_arrow(
        target,
        layer=layer,
        columns=columns,
        use_pyarrow=True,
        batch_size=_BATCH_ROWS,
        datetime_as_string=True,
    )
    return _Opened(*_quietly(stack.enter_context, manager))


def _tables(target: Any, layer: str, where: str, columns: list[str]) -> Iterator[Any]:
    """Yield the rows of a layer as tables."""
    with _explained_errors(where), ExitStack() as stack:
        fields = [name for name in columns if name != _GEOMETRY]
        opened = _open(stack, target, layer, fields)
        batches = iter(opened.reader)
        while (batch := _quietly(next, batches, None)) is not None:
            batch.validate(full=True)  # GDAL passes on texts that aren't UTF-8
            names = list(batch.schema.names)
            names[_geometry_index(batch, opened.meta)] = _GEOMETRY
            yield pa.Table.from_batches([batch]).rename_columns(names)


def _geometries(batch: Any, meta: Mapping[str, Any]) -> Any:
    return batch.column(_geometry_index(batch, meta))


def _geometry_index(batch: Any, meta: Mapping[str, Any]) -> int:
    # A field may have the same name; geometries are the last column.
    name = meta["geometry_name"] or _UNNAMED_GEOMETRY
    indices = batch.schema.get_all_field_indices(name)
    if not indices:
        raise ValueError("a layer without geometries")
    return int(indices[-1])


def _require_pyogrio(purpose: str) -> Any:
    try:
        import pyogrio
    except ImportError as error:
        raise MissingExtraError("gis", purpose) from error
    return pyogrio


def _quietly(function: Callable[..., _Result], *arguments: Any) -> _Result:
    """Call a function of GDAL without its warnings, as errors say what matters."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments)


@contextmanager
def _explained_errors(where: str) -> Iterator[None]:
    """Turn errors of GDAL and Arrow into those of GPSZip."""
    from pyogrio.errors import CRSError, FeatureError, GeometryError

    gdal_errors = (CRSError, FeatureError, GeometryError, RuntimeError, ValueError, OSError)
    try:
        yield
    except InputError:
        raise
    except UnboundLocalError:  # of pyogrio 0.13, where GDAL can't write a system as text
        raise InputError("damaged: its coordinate system can't be read", path=where) from None
    except (*gdal_errors, pa.ArrowException) as error:
        raise InputError(f"damaged, says GDAL: {_reason(error)}", path=where) from None


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())[:_MAX_REASON_LETTERS]


# Writing


def write_gpkg(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write a GeoPackage with the layer ``points``: a row for each point.

    The fields are ``track_id``, ``t`` in seconds since 1970, ``time`` as a date, which has
    milliseconds, and attributes. The height is z of the points, and a field.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If the tracks have different columns, or GDAL can't write them.
    MissingExtraError
        If pyogrio, which brings GDAL, is not installed.
    """
    _write(tracks, sink, "GPKG")


def write_flatgeobuf(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write FlatGeobuf with the fields of :func:`write_gpkg`, in the order of the tracks.

    Parameters
    ----------
    tracks, sink
        As for :func:`write_gpkg`.

    Raises
    ------
    OutputError, MissingExtraError
        As for :func:`write_gpkg`.
    """
    _write(tracks, sink, "FlatGeobuf")


def _write(tracks: Iterable[TrackRows], sink: BinaryIO, driver: str) -> None:
    # GDAL comes with an extra.
    pyogrio = _require_pyogrio(f"writing {driver}")
    from pyogrio.errors import DataLayerError, DataSourceError, FeatureError, GeometryError

    # GDAL takes a table at a time.
    opened = point_tables(tracks)
    tables = (_add_dates(rows.table) for rows in opened.tables)
    first = next(tables)
    reader = pa.RecordBatchReader.from_batches(first.schema, _batches(first, tables))

    # GDAL builds the file in memory: it ignores a full disk when it closes a file. An index would
    # put the rows into another order.
    file = io.BytesIO()
    pyogrio.set_gdal_config_options(_LAST_CHANGE)
    try:
        _quietly(
            partial(
                pyogrio.write_arrow,
                reader,
                file,
                layer=_LAYER,
                driver=driver,
                geometry_name="geometry",
                geometry_type="Point Z" if opened.has_z else "Point",
                crs="EPSG:4326" if opened.geographic else METRES,
                layer_options={"SPATIAL_INDEX": "NO"},
            )
        )
    except (DataLayerError, DataSourceError, FeatureError, GeometryError) as error:
        raise OutputError(
            f"GDAL can't write this: {_reason(error)}", remedy="write a .geoparquet or .csv"
        ) from error
    finally:
        pyogrio.set_gdal_config_options(dict.fromkeys(_LAST_CHANGE))
    sink.write(file.getbuffer())


def _add_dates(table: Any) -> Any:
    """Add the times as dates, for programs that know no other times."""
    if table.column_names[1] != "t":
        return table
    return table.add_column(2, "time", to_timestamps(table.column(1)))


def _batches(first: Any, others: Iterator[Any]) -> Iterator[Any]:
    yield from first.to_batches()
    for table in others:
        yield from table.to_batches()
