"""Parse lines in well-known binary and text (OGC Simple Features, ISO 19125)."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

__all__ = ["WkbLines", "WkbPoints", "parse_wkb_lines", "parse_wkb_points", "parse_wkt_line"]

#: Bytes before the points of a line: byte order (1), type (4), number of points (4).
_HEADER_BYTES = 9

#: Bytes of a vertex with two coordinates.
_VERTEX_BYTES = 16

#: Bytes before the coordinates of a point: byte order (1), type (4).
_POINT_HEADER_BYTES = 5

#: Type of a Point.
_POINT = 1

#: Type of a LineString.
_LINE_STRING = 2

#: Type of a MultiLineString.
_MULTI_LINE_STRING = 5

#: Flag of a z coordinate in extended well-known binary (PostGIS).
_EWKB_Z = 0x80000000

#: Flag of an m coordinate in extended well-known binary.
_EWKB_M = 0x40000000

#: Flag of a number of the coordinate system, which follows the type in extended well-known binary.
_EWKB_SRID = 0x20000000

#: Bytes of that number.
_SRID_BYTES = 4

#: Types are below this; all flags are at or above.
_TYPE_LIMIT = 0x20000000

#: Additional coordinates of a point by the thousands of its ISO type: none, z, m, both.
_ISO_EXTRA_AXES = (0, 1, 1, 2)

#: Whether the first of them is z.
_ISO_HAS_Z = (False, True, False, True)


class WkbLines(NamedTuple):
    """Lines of an array of geometries.

    Parameters
    ----------
    points : float64 array, shape (N, 2)
        First two coordinates of all vertices.
    offsets : int64 array, shape (L + 1,)
        Vertices of line i are ``points[offsets[i]:offsets[i + 1]]``.
    rows : int64 array, shape (L,)
        Index of the geometry to which each line belongs.
    others : int
        Number of geometries that are no lines.
    """

    points: NDArray[np.float64]
    offsets: NDArray[np.int64]
    rows: NDArray[np.int64]
    others: int


class WkbPoints(NamedTuple):
    """Points of an array of geometries.

    Parameters
    ----------
    points : float64 array, shape (n, 3)
        x, y and z; NaN for what a geometry has not, and for those that are no points.
    types : int64 array, shape (n,)
        Type of each geometry: 1 for a point, 2 for a LineString, and so on. 0 for null, -1 for a
        geometry that is damaged.
    """

    points: NDArray[np.float64]
    types: NDArray[np.int64]


def parse_wkb_points(geometries: Any) -> WkbPoints:
    """Parse the points of an array of geometries, and the types of all.

    Parameters
    ----------
    geometries : pyarrow.Array of binary
        Well-known binary, also with the flags of PostGIS.

    Returns
    -------
    WkbPoints

    Examples
    --------
    >>> text = "0101000000000000000000084000000000000010c0"
    >>> cells = parse_wkb_points(pa.array([bytes.fromhex(text), None]))
    >>> cells.points[0].tolist(), cells.types.tolist()
    ([3.0, -4.0, nan], [1, 0])
    """
    # Null is an empty text of bytes; anything else that is shorter than a header is damaged.
    starts, data = _buffers(geometries.cast(pa.large_binary()).fill_null(b""))
    sizes = np.diff(starts)
    types = np.where(sizes > 0, np.int64(-1), np.int64(0))
    points = np.full((len(sizes), 3), np.nan)
    whole = np.flatnonzero(sizes >= _POINT_HEADER_BYTES)
    if not len(whole):
        return WkbPoints(points, types)

    # Geometries have few different headers: parse all of one header at once.
    # As numbers, headers take a tenth of the time to sort.
    bits = 8 * np.arange(_POINT_HEADER_BYTES)
    headers = (
        data[starts[:-1][whole, None] + np.arange(_POINT_HEADER_BYTES)].astype(np.int64) << bits
    )
    distinct, number = np.unique(headers.sum(axis=1), return_inverse=True)
    for i, header in enumerate(distinct.tolist()):
        rows = whole[number == i]
        order = "<" if header % 256 == 1 else ">"
        (kind,) = struct.unpack(order + "I", (header // 256).to_bytes(4, "little"))
        types[rows] = kind % _TYPE_LIMIT % 1000
        if kind % _TYPE_LIMIT % 1000 != _POINT:
            continue

        # The flags of PostGIS, or else the thousands of ISO, tell whether z follows x and y.
        has_z = bool(kind & _EWKB_Z) or _ISO_HAS_Z[kind % _TYPE_LIMIT // 1000 % 4]
        first = _POINT_HEADER_BYTES + (_SRID_BYTES if kind & _EWKB_SRID else 0)
        length = 8 * (3 if has_z else 2)
        is_whole = sizes[rows] >= first + length
        types[rows[~is_whole]] = -1
        rows = rows[is_whole]
        cells = data[starts[:-1][rows, None] + np.arange(first, first + length)]
        points[rows, : length // 8] = cells.view(order + "f8")
    return WkbPoints(points, types)


def parse_wkb_lines(geometries: Any) -> WkbLines:
    """Parse the lines of an array of geometries. A MultiLineString gives several lines.

    Parameters
    ----------
    geometries : pyarrow.BinaryArray
        Well-known binary; null counts as a geometry that is no line.

    Returns
    -------
    WkbLines

    Raises
    ------
    ValueError, IndexError, struct.error
        If a geometry has fewer bytes than its header says.

    Examples
    --------
    >>> text = "0102000000020000000000000000000000000000000000000000000000000008400000000000001040"
    >>> parse_wkb_lines(pa.array([bytes.fromhex(text), None])).points.tolist()
    [[0.0, 0.0], [3.0, 4.0]]
    """
    # Fast path: all are little-endian LineStrings with two coordinates.
    starts, data = _buffers(geometries)
    sizes = np.diff(starts)
    if len(sizes) and (sizes >= _HEADER_BYTES).all():
        # Shape (n, 9): the header of each geometry.
        headers = data[starts[:-1, None] + np.arange(_HEADER_BYTES)]
        types = headers[:, 1:5].copy().view("<u4")
        counts = headers[:, 5:9].copy().view("<u4")[:, 0].astype(np.int64)
        is_plain = (headers[:, 0] == 1) & (types[:, 0] == _LINE_STRING)
        # A damaged line has fewer bytes than its header says.
        if (is_plain & (sizes == _HEADER_BYTES + _VERTEX_BYTES * counts)).all():
            return _parse_plain_lines(starts, data, counts)
    return _parse_mixed(geometries)


def _buffers(geometries: Any) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    """Return the start of each geometry, and the bytes of all."""
    # Large binary arrays have offsets of 64 bits. An array may be a slice of a longer one.
    wide = geometries.cast(pa.large_binary())
    _, offsets, values = wide.buffers()
    starts = np.frombuffer(offsets, np.int64)[wide.offset : wide.offset + len(wide) + 1]
    return starts, np.frombuffer(values, np.uint8) if values is not None else np.empty(0, np.uint8)


def _parse_plain_lines(
    starts: NDArray[np.int64], data: NDArray[np.uint8], counts: NDArray[np.int64]
) -> WkbLines:
    """Parse LineStrings with two coordinates: all bytes outside of headers are coordinates."""
    # Drop the header of each line; the doubles of all vertices then follow each other.
    first, last = int(starts[0]), int(starts[-1])
    is_coordinate = np.ones(last - first, np.bool_)
    is_coordinate[(starts[:-1, None] - first + np.arange(_HEADER_BYTES)).ravel()] = False
    points = data[first:last][is_coordinate].view("<f8").reshape(-1, 2)
    return WkbLines(points, np.append(0, np.cumsum(counts)), np.arange(len(counts)), 0)


def _parse_mixed(geometries: Any) -> WkbLines:
    """Parse geometries of any type one by one."""
    lines: list[NDArray[np.float64]] = []
    rows: list[int] = []
    others = 0
    for row, geometry in enumerate(geometries.to_pylist()):
        lines_of_row = _parse_geometry(geometry, 0)[0] if geometry else []
        others += not lines_of_row
        lines += lines_of_row
        rows += [row] * len(lines_of_row)
    counts = [len(line) for line in lines]
    points = np.concatenate(lines) if lines else np.empty((0, 2))
    offsets = np.append(0, np.cumsum(counts)).astype(np.int64)
    return WkbLines(points, offsets, np.array(rows, np.int64), others)


def _parse_geometry(data: bytes, position: int) -> tuple[list[NDArray[np.float64]], int]:
    """Return the lines of the geometry that starts at a byte, and the byte after it."""
    # Header: byte order, type with the number of coordinates, number of points or lines.
    order = "<" if data[position] == 1 else ">"
    (kind,) = struct.unpack_from(order + "I", data, position + 1)
    position += _SRID_BYTES if kind & _EWKB_SRID else 0
    (count,) = struct.unpack_from(order + "I", data, position + 5)
    # The flags of PostGIS, or else the thousands of ISO, tell which of z and m follow x and y.
    extra_axes = bool(kind & _EWKB_Z) + bool(kind & _EWKB_M)
    width = 2 + (extra_axes or _ISO_EXTRA_AXES[kind % _TYPE_LIMIT // 1000 % 4])
    plain_type = kind % _TYPE_LIMIT % 1000
    position += _HEADER_BYTES

    # Body.
    if plain_type == _LINE_STRING:
        flat = np.frombuffer(data, order + "f8", count * width, position)
        points = flat.reshape(-1, width)[:, :2]
        return [points.astype(np.float64)], position + 8 * count * width
    lines: list[NDArray[np.float64]] = []
    if plain_type == _MULTI_LINE_STRING:
        for _ in range(count):
            members, position = _parse_geometry(data, position)
            lines += members
    return lines, position


def parse_wkt_line(text: str) -> Sequence[tuple[float, float]]:
    """Parse the vertices of a line in well-known text.

    Parameters
    ----------
    text : str
        A ``LINESTRING``, or a ``MULTILINESTRING`` that is one line cut at the antimeridian.

    Returns
    -------
    sequence of (float, float)
        Empty for any other text.

    Examples
    --------
    >>> parse_wkt_line("LINESTRING (1 2, 3.5 4)"), parse_wkt_line("POINT (1 2)")
    ([(1.0, 2.0), (3.5, 4.0)], [])
    >>> parse_wkt_line("MULTILINESTRING ((179 2, 180 3), (-180 3, -179 4))")
    [(179.0, 2.0), (180.0, 3.0), (-180.0, 3.0), (-179.0, 4.0)]
    """
    kind, _, rest = text.partition("(")
    if not kind.strip().upper().startswith(("LINESTRING", "MULTILINESTRING")):
        return []
    texts = [
        [vertex.strip("() ").split() for vertex in line.split(",")]
        for line in re.split(r"\)\s*,\s*\(", rest)
    ]
    try:
        lines = [[(float(vertex[0]), float(vertex[1])) for vertex in line] for line in texts]
    except (ValueError, IndexError):
        return []

    # Each line has to start where the one before ends, perhaps beyond the antimeridian.
    is_one_line = all(_is_same_position(line[-1], after[0]) for line, after in pairwise(lines))
    return [vertex for line in lines for vertex in line] if is_one_line else []


def _is_same_position(first: tuple[float, float], second: tuple[float, float]) -> bool:
    # Longitudes that differ by whole turns are the same.
    return first[1] == second[1] and (first[0] - second[0]) % 360 == 0
