"""GPX: tracks with times, and routes and tracks without times as shapes.

The points are collected by :mod:`gpszip.io.gpx_points` and read here, column by column. The reader is GPSZip's own, as
those at hand don't fit: GDAL's driver takes ``48,1371`` for 48 and what is no number for 0, and leaves out extensions
and all times that are not quite as they should be; gpxpy is no longer worked on, and ten times as slow.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.arrow_values import numbers, seconds, unit_seconds
from gpszip.io.coordinates import degrees, has_decimal_comma, unread
from gpszip.io.gpx import HEIGHTS
from gpszip.io.gpx_points import GpxPoints, parse_points
from gpszip.io.raw_log import RawLog, Request, Unread
from gpszip.io.source import Source
from gpszip.io.xml_text import root_of
from gpszip.model.reading import LeftOut, Repair

__all__ = ["read_gpx", "sniff_gpx"]

#: Names for one thing: whoever asks for one of them gets another where the points have that.
_SAME = (
    HEIGHTS,
    ("hr", "heart_rate", "heartrate"),
    ("cad", "cadence"),
    ("atemp", "temperature", "temp"),
    ("power", "watts"),
)

#: The element that holds where the agent faces.
_HEADING = "course"

#: What XML calls a number that is not known.
_NAN = r"(?i)^\s*[+-]?nan\s*$"

#: Bytes that a column of texts may take, in which each text takes as many as the longest.
_TEXT_BYTES = 1 << 30

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]


def sniff_gpx(head: bytes) -> bool:
    """Whether a file that starts like this is GPX.

    Examples
    --------
    >>> sniff_gpx(b'<?xml version="1.0"?> <gpx version="1.1">'), sniff_gpx(b"<kml>")
    (True, False)
    """
    return (root_of(head) or "").lower() == "gpx"


def read_gpx(source: Source, request: Request) -> RawLog:
    """Read the tracks and routes of a GPX file.

    The segments of a track with times follow each other, and long pauses between them are gaps. A track without any time
    and a route are shapes. As nothing is known of the way between two segments of a shape, each segment is a shape of
    its own.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Unit of times that are numbers, and elements of the points to keep, those of extensions among them: ``ele``,
        ``hr``, ``speed``. Common other names of them do as well, such as ``heart_rate``.

    Returns
    -------
    RawLog
        Tracks and routes by name, in the order of the file; those of one name are numbered. A point with a latitude or
        longitude that can't be read has NaN for it. Waypoints are left out.

    Raises
    ------
    InputError
        If the file is damaged or refused (a document type, or beyond a limit), has no point of a track or route, none
        with a position, or times of which none can be read; or if no point has what is to be kept.

    Examples
    --------
    >>> point = '<trkpt lat="48.1" lon="11.5"><time>1970-01-01T00:00:01Z</time><hr>120</hr></trkpt>'
    >>> source = Source("a.gpx", data=f"<gpx><trk><name>walk</name>{point}</trk></gpx>".encode())
    >>> log = read_gpx(source, Request(keep=("heart_rate",)))
    >>> log.ids, log.times.tolist(), log.coordinates.tolist(), log.attributes["heart_rate"].tolist()
    (('walk',), [1.0], [[48.1, 11.5]], [120.0])
    """
    # Collect texts.
    wanted = {other for name in request.keep for other in _same(name)}
    points = parse_points(source, {"time", *wanted, *((_HEADING,) if request.heading else ())})
    if not len(points.lat):
        raise InputError(f"{source.name}: no track points{_others(points)}; GPSZip reads tracks (trk) and routes (rte)")
    kept = _kept_fields(points, request, source.name)

    # Tell tracks from shapes.
    cells = points.fields.get("time", pa.chunked_array([pa.nulls(len(points.lat), pa.string())]))
    timed = _is_timed(points, cells)
    ids, codes, shapes = _tracks(points, timed, source.stem)

    # Read texts as numbers.
    comma = has_decimal_comma([points.lat, points.lon])
    coordinates, unplaced = _coordinates(points, comma)
    time_cells = pc.if_else(pa.array(timed[_parent_of_rows(points)]), cells, None)
    times = _times(time_cells, request, source.name)
    found = [*unplaced, unread(time_cells, times, "time")]
    _require_a_point(source.name, times, coordinates, shapes[codes], unplaced)

    attributes = {name: _values(points.fields[field], comma, f"{source.name}: {field}") for name, field in kept.items()}
    if request.heading and _HEADING in points.fields:
        attributes |= _headings(numbers(points.fields[_HEADING], comma))
    return RawLog(
        name=source.name,
        ids=ids,
        codes=codes if ids else None,
        times=times,
        coordinates=coordinates,
        geographic=True,
        attributes=attributes,
        word="point",
        labels=True,
        dropped=_dropped(points, [*kept.values(), *([_HEADING] if "heading" in attributes else [])]),
        repairs=_repairs(points, cells, source.name),
        left_out=_left_out(points, source.name),
        unread=tuple(cell for cell in found if cell is not None),
        untimed=frozenset(np.flatnonzero(shapes).tolist()),
    )


def _same(name: str) -> list[str]:
    """The elements that a name may stand for, itself first."""
    plain = name.lower()
    others = next((group for group in _SAME if plain in group), ())
    return list(dict.fromkeys((plain, *others)))


def _kept_fields(points: GpxPoints, request: Request, where: str) -> dict[str, str]:
    """The element to keep for each name that was asked for."""
    kept = {}
    there = {field: shown for field, shown in points.present.items() if field != "time"}
    for name in request.keep:
        field = next((field for field in _same(name) if field in there), None)
        if field is None:
            raise InputError(f"{where}: no {name!r} to keep; its points have: {', '.join(there.values()) or 'place and time only'}")
        kept[name] = field
    return kept


def _dropped(points: GpxPoints, kept: Iterable[str]) -> tuple[str, ...]:
    others = set(kept) | {"time"}
    return tuple(shown for field, shown in points.present.items() if field not in others)


def _parent_of_rows(points: GpxPoints) -> NDArray[np.intp]:
    """The track or route of each point."""
    return np.repeat(points.parents, np.diff(points.starts, append=len(points.lat)))


def _is_timed(points: GpxPoints, cells: Any) -> Rows:
    """Whether each track or route has a time that counts, whether or not it can be read. Routes are planned: theirs don't."""
    has_time = cells.is_valid().to_numpy()
    timed = np.zeros(len(points.names), dtype=np.bool_)
    timed[_parent_of_rows(points)[has_time]] = True
    return timed & ~points.routes


def _tracks(points: GpxPoints, timed: Rows, stem: str) -> tuple[tuple[str, ...], NDArray[np.int32], Rows]:
    """Names of all tracks and shapes (none for a nameless one that is alone), the code of each point, and which are shapes."""
    # A track with times is one, whatever its segments; a shape is one segment.
    first_of_parent = np.diff(points.parents, prepend=-1) > 0
    is_first = first_of_parent | ~timed[points.parents]
    parents = points.parents[is_first]
    codes = np.repeat(np.cumsum(is_first) - 1, np.diff(points.starts, append=len(points.lat))).astype(np.int32)
    shapes: Rows = ~timed[parents]

    # A nameless track among others is named after the file and numbered.
    alone = len(points.names) == 1
    titles = [name if name is not None else stem if alone else f"{stem}-{i + 1}" for i, name in enumerate(points.names)]
    nameless = points.names == (None,) and len(parents) == 1
    return (() if nameless else _distinct([titles[i] for i in parents.tolist()])), codes, shapes


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Names of which no two are the same: the second ``a`` becomes ``a-2``, or the next such name that is free."""
    found: dict[str, None] = {}
    last: dict[str, int] = {}
    for name in names:
        new, number = name, last.get(name, 1)
        while new in found:
            number += 1
            new = f"{name}-{number}"
        last[name] = number
        found[new] = None
    return tuple(found)


def _coordinates(points: GpxPoints, comma: bool) -> tuple[Floats, list[Unread]]:
    """Latitudes and longitudes, and the first of each that can't be read."""
    lat, lon = degrees(points.lat, "lat", decimal_comma=comma), degrees(points.lon, "lon", decimal_comma=comma)
    found = [_first_unread(points.lat, lat, "lat"), _first_unread(points.lon, lon, "lon")]
    return np.stack([lat, lon], axis=1), [cell for cell in found if cell is not None]


def _first_unread(column: Any, values: Floats, name: str) -> Unread | None:
    """The first cell that can't be read; that holds nothing counts, too, as each point must have a position."""
    bad = ~np.isfinite(values)
    if not bad.any():
        return None
    row = int(bad.argmax())
    cell = column[row].as_py()
    return Unread(name, row, f"no {name}" if cell is None else cell)


def _times(cells: Any, request: Request, where: str) -> Floats:
    if cells.null_count == len(cells):
        return np.full(len(cells), np.nan)
    unit = unit_seconds(request.time_unit) if request.time_unit else None
    return seconds(cells, unit, f"{where}: time")


def _require_a_point(where: str, times: Floats, coordinates: Floats, in_shape: Rows, unplaced: Sequence[Unread]) -> None:
    placed: Rows = np.asarray(np.isfinite(coordinates).all(axis=1))
    if not placed.any():
        first = f"; the first has {unplaced[0].column}={unplaced[0].value!r}" if unplaced else ""
        raise InputError(f'{where}: no point has a position that can be read{first}; write degrees such as lat="48.1371"')
    if not (placed & (in_shape | np.isfinite(times))).any():
        raise InputError(f"{where}: no point has both a position and a time that can be read")


def _values(column: Any, comma: bool, where: str) -> NDArray[np.generic]:
    """Floats where all cells that hold something are numbers, else texts."""
    unknown = pc.fill_null(pc.match_substring_regex(column, _NAN), True).to_numpy(zero_copy_only=False)
    floats = numbers(column, comma)
    if (np.isfinite(floats) | unknown.astype(np.bool_)).all():
        return floats
    longest = int(pc.max(pc.utf8_length(column)).as_py() or 0)
    if longest * np.dtype("U1").itemsize * len(column) > _TEXT_BYTES:
        raise InputError(f"{where}: holds texts of {longest} letters, too long to keep for {len(column)} points; don't keep it")
    return np.array(pc.fill_null(column, "").to_pylist(), dtype=np.str_)


def _headings(courses: Floats) -> Mapping[str, NDArray[np.generic]]:
    return {"heading": courses} if np.isfinite(courses).any() else {}


def _repairs(points: GpxPoints, cells: Any, where: str) -> tuple[Repair, ...]:
    repairs = []
    if points.replaced.count:
        what = "bytes that don't fit the file's encoding read as Windows-1252"
        repairs.append(Repair(what, points.replaced.count, where, drops=False, value=f"text {points.replaced.first!r}"))
    planned = np.flatnonzero(cells.is_valid().to_numpy() & points.routes[_parent_of_rows(points)])
    if len(planned):
        first = int(planned[0])
        what = "times of route points not read, as a route is a shape"
        repairs.append(Repair(what, len(planned), f"{where}: point {first + 1}", drops=False, value=f"time {cells[first].as_py()!r}"))
    return tuple(repairs)


def _waypoints(points: GpxPoints) -> str:
    return f"{points.waypoints} waypoint{'s' if points.waypoints > 1 else ''}" if points.waypoints else ""


def _others(points: GpxPoints) -> str:
    return f", only {_waypoints(points)}" if points.waypoints else ""


def _left_out(points: GpxPoints, where: str) -> tuple[LeftOut, ...]:
    return (LeftOut(f"{where}: {_waypoints(points)}", "not a track"),) if points.waypoints else ()
