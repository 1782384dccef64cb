"""Geometries of a frame as points or lines in the coordinates of a log."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.crs import is_local, to_degrees
from gpszip.io.frames.stream import frame_errors
from gpszip.io.networks.lines import within_globe
from gpszip.io.networks.wkb import WkbLines, parse_wkb_lines, parse_wkb_points

__all__ = ["PointCells", "in_log_coordinates", "is_on_earth", "read_lines", "read_points"]

#: Names of the types of well-known binary, from 1 on.
_TYPE_NAMES = (
    "Point",
    "LineString",
    "Polygon",
    "MultiPoint",
    "MultiLineString",
    "MultiPolygon",
    "GeometryCollection",
)

#: Types of lines.
_LINE_TYPES = (2, 5)

Floats = NDArray[np.float64]


class PointCells(NamedTuple):
    """Cells of a column of geometries.

    Parameters
    ----------
    points : float64 array, shape (n, 3)
        x, y and z of points; NaN for what a point has not, and for lines.
    are_lines : bool
        Whether all geometries are lines.
    """

    points: Floats
    are_lines: bool


def read_points(cells: Any, encoding: str, frame: str, column: str) -> PointCells:
    """Read points, and find out whether the geometries are lines instead.

    Parameters
    ----------
    cells : pyarrow.ChunkedArray
        The geometries.
    encoding : str
        ``wkb``, ``point`` or ``linestring``.
    frame, column : str
        Names for messages.

    Returns
    -------
    PointCells

    Raises
    ------
    InputError
        If there are points and lines, or anything else.
    """
    # Arrow's own types hold one kind.
    with frame_errors(frame, column):
        if encoding == "linestring":
            return PointCells(np.full((len(cells), 3), np.nan), are_lines=True)
        if encoding == "point":
            return PointCells(_native_points(_storage(cells)), are_lines=False)
        points, types = parse_wkb_points(_storage(cells))

    # Name the first geometry that doesn't fit.
    is_line = np.isin(types, _LINE_TYPES)
    is_other = ~is_line & (types != 0) & (types != 1)
    if not is_other.any() and not (is_line.any() and (types == 1).any()):
        return PointCells(points, bool(is_line.any()))
    row = int((is_other if is_other.any() else is_line).argmax())
    raise InputError(
        f"holds a {_type_name(int(types[row]))}" + ("" if is_other.any() else " beside points"),
        path=frame,
        location=f"column {column!r}: row {row}",
        remedy="keep the points, or the lines, alone",
    )


def _type_name(kind: int) -> str:
    if kind < 0:
        return "damaged geometry"
    return _TYPE_NAMES[kind - 1] if kind <= len(_TYPE_NAMES) else f"geometry of type {kind}"


def read_lines(cells: Any, encoding: str, frame: str, column: str) -> WkbLines:
    """Read lines; parameters as for :func:`read_points`.

    Raises
    ------
    InputError
        If a geometry is damaged.
    """
    with frame_errors(frame, column):
        storage = _storage(cells)
        if encoding == "wkb":
            return parse_wkb_lines(storage.cast(pa.binary()))

        # A list of points for each line; null has no length.
        lengths = pc.fill_null(pc.list_value_length(storage), 0).to_numpy(zero_copy_only=False)
        rows = np.flatnonzero(lengths)
        points = _native_points(pc.list_flatten(storage))[:, :2]
        offsets = np.append(0, np.cumsum(lengths[rows])).astype(np.int64)
        return WkbLines(points, offsets, rows, int((lengths == 0).sum()))


def _storage(cells: Any) -> Any:
    """One array without extension type."""
    array = cells.combine_chunks() if isinstance(cells, pa.ChunkedArray) else cells
    if isinstance(array, pa.ChunkedArray):
        array = pa.concat_arrays(array.chunks) if array.num_chunks else pa.array([], cells.type)
    return array.storage if isinstance(array.type, pa.BaseExtensionType) else array


def _native_points(storage: Any) -> Floats:
    """Points as structures of x, y and z, or as lists of two to four numbers."""
    points = np.full((len(storage), 3), np.nan)
    if pa.types.is_struct(storage.type):
        names = [field.name for field in storage.type]
        for i, axis in enumerate(name for name in "xyz" if name in names):
            cells = pc.struct_field(storage, axis).cast(pa.float64())
            points[:, i] = cells.to_numpy(zero_copy_only=False)
        return points

    # A list of fixed size holds a z if it has three numbers or more.
    width = storage.type.list_size
    filled = storage.flatten() if not storage.null_count else storage.drop_null().flatten()
    values = filled.cast(pa.float64()).to_numpy(zero_copy_only=False).reshape(-1, width)
    points[storage.is_valid().to_numpy(zero_copy_only=False), : min(width, 3)] = values[:, :3]
    return points


def is_on_earth(crs: str | None, frame: str) -> bool:
    """Whether a coordinate system tells where on the earth positions are.

    Raises
    ------
    InputError
        If the system is unknown.
    """
    return crs is not None and not is_local(crs, frame)


def in_log_coordinates(points: Floats, crs: str | None, frame: str, column: str) -> Floats:
    """Return positions as a log has them: latitude and longitude, or metres.

    Parameters
    ----------
    points : float64 array, shape (n, d)
        The first two are x and y: east first, also in degrees.
    crs : str or None
        Their coordinate system.
    frame, column : str
        Names for messages.

    Returns
    -------
    float64 array, shape (n, d)
        Latitude and longitude first if the system is one of the earth.

    Raises
    ------
    InputError
        If there is no system, and positions may be degrees as well as metres.

    Examples
    --------
    >>> in_log_coordinates(np.array([[13.4, 52.5]]), "EPSG:4326", "frame", "geometry").tolist()
    [[52.5, 13.4]]
    """
    if is_on_earth(crs, frame):
        assert crs is not None
        degrees = to_degrees(points[:, :2], crs, frame)[:, ::-1]
        return np.column_stack([degrees, points[:, 2:]])

    # Small numbers may be degrees or the metres of a hall.
    if crs is None and within_globe(points[:, :2]):
        raise InputError(
            "names no coordinate system, and its numbers may be degrees or metres",
            path=frame,
            location=f"column {column!r}",
            remedy="name one, such as frame.set_crs(4326), or give columns x and y",
        )
    return points
