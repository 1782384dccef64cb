"""Tracks as tables with a point in each row, for the formats of geographic information systems."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.raw import HEIGHT_NAMES
from gpszip.io.logs.track_rows import TrackRows
from gpszip.io.logs.track_table import track_tables

__all__ = ["PointTable", "PointTables", "point_tables", "to_timestamps"]

#: Names of columns that rows have besides attributes.
_OWN_NAMES = ("geometry", "bbox", "time", "fid", "geom")

#: Names of coordinates in tables of tracks.
_AXES = (["lat", "lon"], ["x", "y"], ["x", "y", "z"])

#: Types of a point in well-known binary, by the number of its coordinates (ISO).
_POINT_TYPES = {2: 1, 3: 1001}

#: Seconds from 1970 that 64 bits hold as microseconds.
_MAX_SECONDS = 9.2e12

Floats = NDArray[np.float64]


class PointTable(NamedTuple):
    """Some rows.

    Parameters
    ----------
    table : pyarrow.Table
        ``track_id``, ``t`` in seconds if any track has times, the attributes, and ``geometry`` as
        well-known binary.
    xy : float64 array, shape (n, 2)
        Longitude and latitude, or metres.
    """

    table: Any
    xy: Floats


class PointTables(NamedTuple):
    """All rows of a log.

    Parameters
    ----------
    geographic : bool
        Whether positions are longitude and latitude.
    has_z : bool
        Whether points have a third number: z, or the height.
    tables : iterator of PointTable
        At least one, of the same columns.
    """

    geographic: bool
    has_z: bool
    tables: Iterator[PointTable]


def point_tables(tracks: Iterable[TrackRows]) -> PointTables:
    """Make a table of the rows of tracks, about a million rows at a time.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All of the same kind and dimension, with the same attributes. The attribute that is a height
        is the third number of the points as well.

    Raises
    ------
    OutputError
        If the tracks have different columns, more than three coordinates, or an attribute whose
        name is taken.
    """
    # The first table shows the columns, which are those of all tables.
    tables = track_tables(tracks)
    first = next(tables)
    names = first.column_names
    start = 2 if names[1] == "t" else 1
    width = 3 if names[start : start + 3] == _AXES[2] else 2
    axes = names[start : start + width]
    attributes = names[start + width :]
    if axes not in _AXES or "x4" in attributes:
        raise OutputError("only tracks of two or three dimensions can be written as points")
    if taken := [name for name in attributes if name.lower() in _OWN_NAMES]:
        raise OutputError(
            f"an attribute named {taken[0]!r} can't be written beside the geometry",
            remedy="write a .csv or .parquet",
        )

    # Which column is the third number?
    geographic = axes == _AXES[0]
    x, y = (start + 1, start) if geographic else (start, start + 1)
    height = next((names.index(name) for name in HEIGHT_NAMES if name in attributes), None)
    has_height = height is not None and _is_number(first.column(height).type)
    z = start + 2 if width == 3 else (height if has_height and geographic else None)
    columns = [x, y] if z is None else [x, y, z]

    # Replace the coordinates by geometries.
    def replaced() -> Iterator[PointTable]:
        for table in chain([first], tables):
            numbers = np.column_stack([_to_floats(table.column(i)) for i in columns])
            kept = table.select([*range(start), *range(start + width, len(names))])
            points = _encode_points(numbers)
            yield PointTable(kept.append_column("geometry", points), numbers[:, :2])

    return PointTables(geographic, z is not None, replaced())


def to_timestamps(seconds: Any) -> Any:
    """Turn seconds since 1970 into timestamps in UTC, rounded to microseconds.

    Parameters
    ----------
    seconds : pyarrow.Array or ChunkedArray of float64
        Null for a row without a time.

    Returns
    -------
    pyarrow.Array

    Raises
    ------
    OutputError
        If no timestamp can hold a time.

    Examples
    --------
    >>> to_timestamps(pa.array([0.5, None])).to_pylist()[0].isoformat()
    '1970-01-01T00:00:00.500000+00:00'
    """
    values = _to_floats(seconds)
    missing = np.isnan(values)
    if (np.abs(values[~missing]) > _MAX_SECONDS).any():
        raise OutputError(
            "a time is too far from 1970 for a timestamp", remedy="write a .csv or .parquet"
        )
    ticks = np.round(np.where(missing, 0.0, values) * 1e6).astype(np.int64)
    return pa.array(ticks, mask=missing).cast(pa.timestamp("us", "UTC"))


def _is_number(kind: Any) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def _to_floats(column: Any) -> Floats:
    floats: Floats = column.to_numpy(zero_copy_only=False).astype(np.float64)
    return floats


def _encode_points(numbers: Floats) -> Any:
    """Return points in well-known binary."""
    # All have the same length, so they are the rows of a matrix of bytes.
    count, width = numbers.shape
    header = struct.pack("<BI", 1, _POINT_TYPES[width])
    size = len(header) + 8 * width
    encoded = np.empty((count, size), np.uint8)
    encoded[:, : len(header)] = np.frombuffer(header, np.uint8)
    encoded[:, len(header) :] = numbers.astype("<f8").view(np.uint8).reshape(count, 8 * width)
    offsets = np.arange(count + 1, dtype=np.int64) * size
    array = pa.Array.from_buffers(
        pa.large_binary(), count, [None, pa.py_buffer(offsets), pa.py_buffer(encoded)]
    )
    return array.cast(pa.binary())
