"""Geometries as numbers: points and lines in well-known binary, or as GeoArrow encodes them.

Well-known binary (OGC Simple Features, ISO 19125) has a byte for the order of bytes, a type, and
doubles. The type names the numbers of a position: by thousands (ISO), or by flags (PostGIS).
"""

from __future__ import annotations

import struct
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError

__all__ = ["WIDTH", "Points", "geometry_kinds", "parse_lines", "parse_points"]

#: Numbers of a position: x, y, z and m.
WIDTH = 4

#: Types of well-known binary.
_KINDS = {
    1: "Point",
    2: "LineString",
    3: "Polygon",
    4: "MultiPoint",
    5: "MultiLineString",
    6: "MultiPolygon",
    7: "GeometryCollection",
}

_POINT, _LINE, _MULTI_POINT, _MULTI_LINE = 1, 2, 4, 5

#: Bytes of the byte order and the type.
_HEADER_BYTES = 5

#: Bytes of a count, or of the number of a coordinate system.
_WORD_BYTES = 4

#: Flags of PostGIS in a type.
_FLAG_Z, _FLAG_M, _FLAG_CRS = 0x80000000, 0x40000000, 0x20000000

#: Types without flags are below this.
_TYPE_LIMIT = 0x20000000

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]


class Points(NamedTuple):
    """The positions of an array of geometries.

    Parameters
    ----------
    table : float64 array, shape (n, 4)
        x, y, z and m of each point; NaN for what it doesn't have, and for other geometries.
    is_point : bool array, shape (n,)
        Whether a geometry is a point, or a MultiPoint of one.
    """

    table: Floats
    is_point: NDArray[np.bool_]


class _Layout(NamedTuple):
    """The numbers that a type of well-known binary states for a position."""

    kind: int
    has_z: bool
    has_m: bool
    has_crs: bool

    @property
    def columns(self) -> list[int]:
        """Columns of a table that its numbers belong to."""
        return [0, 1, *([2] if self.has_z else []), *([3] if self.has_m else [])]

    @property
    def start(self) -> int:
        """Bytes before the numbers of a point, or before the count of other geometries."""
        return _HEADER_BYTES + (_WORD_BYTES if self.has_crs else 0)


def parse_points(column: Any) -> Points:
    """Parse the points of a column.

    Parameters
    ----------
    column : pyarrow.Array or ChunkedArray of length n
        Well-known binary; or structures with x, y, z, m, or lists of as many numbers.

    Returns
    -------
    Points

    Examples
    --------
    >>> text = "010100000000000000000000400000000000000840"
    >>> parse_points(pa.array([bytes.fromhex(text), None])).table.tolist()
    [[2.0, 3.0, nan, nan], [nan, nan, nan, nan]]
    """
    array = _plain_array(column)
    if _is_binary(array.type):
        return _parse_binary_points(array)
    if pa.types.is_struct(array.type) or _is_fixed_list(array.type):
        table = _native_table(array)
        return Points(table, array.is_valid().to_numpy(zero_copy_only=False))
    return Points(np.full((len(array), WIDTH), np.nan), np.zeros(len(array), np.bool_))


def geometry_kinds(column: Any) -> list[str]:
    """Return the kinds of geometries in a column, such as ``Point``; empty for nulls alone.

    Parameters
    ----------
    column : pyarrow.Array or ChunkedArray
        As for :func:`parse_points`.

    Examples
    --------
    >>> geometry_kinds(pa.array([bytes.fromhex("010200000000000000"), None]))
    ['LineString']
    """
    array = _plain_array(column).drop_null()
    if not len(array):
        return []
    if _is_binary(array.type):
        _, types = _headers(*_buffers(array))
        kinds = np.unique(types % _TYPE_LIMIT % 1000).tolist()
        return [_KINDS.get(kind, "unknown geometry") for kind in kinds]
    if pa.types.is_struct(array.type) or _is_fixed_list(array.type):
        return ["Point"]
    return ["LineString"] if _is_native_line(array.type) else ["unknown geometry"]


def parse_lines(geometry: Any, where: str, location: str) -> list[Floats]:
    """Parse the lines of one geometry; none for a geometry of another kind.

    Parameters
    ----------
    geometry : pyarrow.Scalar
        A cell of a column of geometries.
    where, location : str
        The file and the row, for messages.

    Returns
    -------
    list of float64 array, shape (n, 4)
        x, y, z and m; several for a MultiLineString.

    Raises
    ------
    InputError
        If it is cut short.

    Examples
    --------
    >>> line = struct.pack("<BII4d", 1, 2, 2, 0, 1, 2, 3)
    >>> parse_lines(pa.scalar(line), "a.gpkg", "row 1")[0][:, :2].tolist()
    [[0.0, 1.0], [2.0, 3.0]]
    """
    if not geometry.is_valid:
        return []
    if isinstance(geometry, pa.ExtensionScalar):
        geometry = geometry.value
    if _is_native_line(geometry.type):
        return [_native_table(geometry.values)]
    if not _is_binary(geometry.type):
        return []

    # A member of a MultiLineString is a geometry by itself.
    data = geometry.as_py()
    try:
        layout, order = _read_layout(data, 0)
        if layout.kind == _LINE:
            return [_parse_line(data, 0)[0]]
        if layout.kind != _MULTI_LINE:
            return []
        (count,) = struct.unpack_from(order + "I", data, layout.start)
        lines, position = [], layout.start + _WORD_BYTES
        for _ in range(count):
            line, position = _parse_line(data, position)
            lines.append(line)
    except (struct.error, ValueError, IndexError):
        raise InputError("its geometry is cut short", path=where, location=location) from None
    return lines


# Well-known binary


def _parse_binary_points(array: Any) -> Points:
    starts, data = _buffers(array)
    sizes, (orders, types) = np.diff(starts), _headers(starts, data)
    table = np.full((len(array), WIDTH), np.nan)
    is_point = np.zeros(len(array), np.bool_)

    # A file has points of one or two types, so they are read type by type, all of one at once.
    combinations = set(zip(orders.tolist(), types.tolist(), strict=True))
    for order, kind in combinations & set(product((0, 1), _POINT_TYPES)):
        layout, letter = _layout_of(kind), "<" if order else ">"
        rows = np.flatnonzero((orders == order) & (types == kind))
        first = layout.start
        if layout.kind == _MULTI_POINT:
            rows = rows[sizes[rows] >= first + _WORD_BYTES]
            counts = _take(data, starts[rows] + first, _WORD_BYTES).view(letter + "u4")[:, 0]
            rows = rows[counts == 1]
            first += _WORD_BYTES + _HEADER_BYTES

        # Points that are cut short have no position.
        length = 8 * len(layout.columns)
        rows = rows[sizes[rows] >= first + length]
        numbers = _take(data, starts[rows] + first, length).view(letter + "f8")
        table[rows[:, np.newaxis], layout.columns] = numbers
        is_point[rows] = True
    return Points(table, is_point & array.is_valid().to_numpy(zero_copy_only=False))


def _layout_of(kind: int) -> _Layout:
    """Return what a type states. The flags of PostGIS and the thousands of ISO go together."""
    thousands = kind % _TYPE_LIMIT // 1000
    return _Layout(
        kind % _TYPE_LIMIT % 1000,
        bool(kind & _FLAG_Z) or thousands in (1, 3),
        bool(kind & _FLAG_M) or thousands in (2, 3),
        bool(kind & _FLAG_CRS),
    )


#: All types of points: with z, m, both or none, as ISO and PostGIS have them.
_POINT_TYPES = tuple(
    kind + 1000 * thousands + flags * _FLAG_CRS
    for kind in (_POINT, _MULTI_POINT)
    for thousands in range(4)
    for flags in range(8)
)


def _headers(starts: NDArray[np.int64], data: Bytes) -> tuple[Bytes, NDArray[np.uint32]]:
    """Return the byte order and the type of each geometry; zeros for one without."""
    sizes = np.diff(starts)
    orders, types = np.zeros(len(sizes), np.uint8), np.zeros(len(sizes), np.uint32)
    rows = np.flatnonzero(sizes >= _HEADER_BYTES)
    header = _take(data, starts[rows], _HEADER_BYTES)
    orders[rows] = header[:, 0]
    words = header[:, 1:].copy()
    types[rows] = np.where(
        header[:, 0] == 1, words.view("<u4")[:, 0], words.view(">u4")[:, 0].astype(np.uint32)
    )
    return orders, types


def _take(data: Bytes, starts: NDArray[np.int64], length: int) -> Bytes:
    """Return as many bytes from each start, shape (n, length)."""
    taken: Bytes = data[starts[:, np.newaxis] + np.arange(length)]
    return taken


def _buffers(array: Any) -> tuple[NDArray[np.int64], Bytes]:
    """Return the start of each geometry and the end of the last, and the bytes of all."""
    # Large binary arrays have offsets of 64 bits. An array may be a slice of a longer one.
    wide = pc.fill_null(array.cast(pa.large_binary()), b"")
    _, offsets, values = wide.buffers()
    starts = np.frombuffer(offsets, np.int64)[wide.offset : wide.offset + len(wide) + 1]
    return starts, np.frombuffer(values, np.uint8) if values is not None else np.empty(0, np.uint8)


def _read_layout(data: bytes, position: int) -> tuple[_Layout, str]:
    order = "<" if data[position] == 1 else ">"
    (kind,) = struct.unpack_from(order + "I", data, position + 1)
    return _layout_of(kind), order


def _parse_line(data: bytes, position: int) -> tuple[Floats, int]:
    """Return the line that starts at a byte, and the byte after it."""
    layout, order = _read_layout(data, position)
    if layout.kind != _LINE:
        raise ValueError("no line")
    position += layout.start
    (count,) = struct.unpack_from(order + "I", data, position)
    position += _WORD_BYTES
    width = len(layout.columns)
    numbers = np.frombuffer(data, order + "f8", count * width, position)
    table = np.full((count, WIDTH), np.nan)
    table[:, layout.columns] = numbers.reshape(-1, width)
    return table, position + 8 * count * width


# GeoArrow


def _plain_array(column: Any) -> Any:
    """Return a column as one array, without its extension type."""
    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if isinstance(array.type, pa.BaseExtensionType):
        array = array.storage
    if pa.types.is_binary_view(array.type):
        array = array.cast(pa.large_binary())
    return array


def _is_binary(kind: Any) -> bool:
    return bool(pa.types.is_binary(kind) or pa.types.is_large_binary(kind))


def _is_fixed_list(kind: Any) -> bool:
    return bool(pa.types.is_fixed_size_list(kind)) and pa.types.is_floating(kind.value_type)


def _is_native_line(kind: Any) -> bool:
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind)):
        return False
    return bool(pa.types.is_struct(kind.value_type)) or _is_fixed_list(kind.value_type)


def _native_table(array: Any) -> Floats:
    """Return points of structures, or of lists of two to four numbers, as a table."""
    table = np.full((len(array), WIDTH), np.nan)
    if pa.types.is_struct(array.type):
        for i, name in enumerate("xyzm"):
            if array.type.get_field_index(name) >= 0:
                table[:, i] = _to_floats(pc.struct_field(array, name))
        return table

    # The i-th numbers of all lists are every size-th value.
    size = array.type.list_size
    for i in range(min(size, WIDTH)):
        table[:, i] = _to_floats(pc.list_element(array, i))
    return table


def _to_floats(values: Any) -> Floats:
    floats: Floats = pc.cast(values, pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return floats
