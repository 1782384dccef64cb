"""Logs in GPX: tracks with times, and tracks and routes without times, which are shapes.

GPSZip has its own reader because others lose or change data and don't report it. GDAL's driver
reads ``48,1371`` as 48 and takes 0 for what is no number; it leaves out extensions, and times that
are written in unusual ways. gpxpy has had no release since 2023, and took ten times as long.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.gpx.parser import parse_points
from gpszip.io.logs.gpx.points import GpxPoints
from gpszip.io.logs.gpx.xml_text import ReplacedBytes, root_element
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, UnreadableCell
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats
from gpszip.io.values.coordinates import first_unreadable_cell, has_decimal_comma, parse_degrees
from gpszip.io.values.timestamps import times_to_seconds, unit_origin, unit_seconds
from gpszip.model.read_result import LeftOut, Repair

__all__ = ["read_gpx", "sniff_gpx"]

#: Names of one quantity. A request for one name is met by another that the points have.
_SYNONYMS = (
    HEIGHT_NAMES,
    ("hr", "heart_rate", "heartrate"),
    ("cad", "cadence"),
    ("atemp", "temperature", "temp"),
    ("power", "watts"),
)

#: The element with the direction of travel.
_COURSE = "course"

#: How XML writes a number that is not known.
_NAN = r"(?i)^\s*[+-]?nan\s*$"

#: Bytes that NumPy may take for a column of texts; each text takes as much as the longest one.
_MAX_TEXT_BYTES = 1 << 30

#: Letters of a value that messages show.
_MAX_SHOWN_LETTERS = 40

#: Names of elements that messages show.
_MAX_SHOWN_NAMES = 20

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def sniff_gpx(head: bytes) -> bool:
    """Whether a file that starts like this is GPX.

    Parameters
    ----------
    head : bytes
        The first bytes of the file.

    Examples
    --------
    >>> sniff_gpx(b'<?xml version="1.0"?> <gpx version="1.1">'), sniff_gpx(b"<kml>")
    (True, False)
    """
    return (root_element(head) or "").lower() == "gpx"


def read_gpx(source: Source, request: Request) -> RawLog:
    """Read the tracks and routes of a GPX file.

    The segments of a track with times are one track; long pauses between them are gaps. A track
    without any times is a shape, and so is each route. How a shape goes from one segment to the
    next is not known, so each segment becomes a separate shape.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        The unit of times that are numbers, and the elements of points to keep (``ele``, ``hr``,
        ``speed``), also from extensions. Other common names of them are understood
        (``heart_rate``).

    Returns
    -------
    RawLog
        Tracks and routes in the order of the file, with numbers after names that occur twice.
        Coordinates that can't be read are NaN. Waypoints are left out.

    Raises
    ------
    InputError
        If the file is damaged, has a document type or goes beyond a limit; if no point has a
        position, or there are times and none can be read; or if no point has an element to keep.

    Examples
    --------
    >>> point = '<trkpt lat="48.1" lon="11.5"><time>1970-01-01T00:00:01Z</time><hr>120</hr></trkpt>'
    >>> data = f"<gpx><trk><name>walk</name><trkseg>{point}</trkseg></trk></gpx>".encode()
    >>> log = read_gpx(Source("a.gpx", data=data), Request(keep=("heart_rate",)))
    >>> log.ids, log.times.tolist(), log.coordinates.tolist(), log.attributes["heart_rate"].tolist()
    (('walk',), [1.0], [[48.1, 11.5]], [120.0])
    """
    # Collect the texts of all points.
    wanted = {field for name in request.keep for field in _fields_named(name)}
    wanted |= {"time", *((_COURSE,) if request.heading else ())}
    points, replaced = parse_points(source, wanted)
    if not len(points.lat):
        only = f", only {_describe_waypoints(points)}" if points.waypoints else ""
        raise InputError(
            f"no track points{only}; GPSZip reads tracks (trk) and routes (rte)", path=source.name
        )

    # Tell tracks from shapes, and name both.
    no_times = pa.chunked_array([pa.nulls(len(points.lat), pa.string())])
    time_texts = points.fields.get("time", no_times)
    has_times = _has_times(points, time_texts)
    ids, codes, is_shape = _tracks(points, has_times, source.stem)

    # Read positions and times; routes have times that are plans, and are not read.
    comma = has_decimal_comma([points.lat, points.lon])
    coordinates, unreadable = _coordinates(points, comma)
    in_timed_track = pa.array(has_times[_parent_of_points(points)])
    time_texts_of_tracks = pc.if_else(in_timed_track, time_texts, None)
    times = _times(time_texts_of_tracks, request, source.name)
    _require_usable_points(source.name, times, coordinates, is_shape[codes], unreadable)
    unreadable_time = first_unreadable_cell(time_texts_of_tracks, times, "time")
    if unreadable_time is not None:
        unreadable = (unreadable_time, *unreadable)

    # Read the elements to keep; shapes are marked as tracks without times.
    attributes, used = _attributes(points, request, comma, source.name)
    waypoints = f"{source.name}: {_describe_waypoints(points)}"
    return RawLog(
        name=source.name,
        ids=ids,
        codes=codes if ids else None,
        times=times,
        coordinates=coordinates,
        geographic=True,
        attributes=attributes,
        row_noun="point",
        ids_are_titles=True,
        dropped_columns=_dropped(points, used),
        repairs=(
            *_replacements(replaced, source.name),
            *_ignored_times(points, time_texts, source.name),
        ),
        left_out=(LeftOut(waypoints, "not a track"),) if points.waypoints else (),
        unreadable=unreadable,
        untimed=frozenset(np.flatnonzero(is_shape).tolist()),
    )


# Tracks and shapes


def _parent_of_points(points: GpxPoints) -> NDArray[np.intp]:
    """Index of the track or route of each point."""
    return np.repeat(points.parents, _segment_lengths(points))


def _segment_lengths(points: GpxPoints) -> NDArray[np.intp]:
    return np.diff(points.starts, append=len(points.lat))


def _has_times(points: GpxPoints, time_texts: Any) -> Flags:
    """Whether each track has times, readable or not. Those of routes are plans and don't count."""
    filled = time_texts.is_valid().to_numpy()
    has_times = np.zeros(len(points.names), dtype=np.bool_)
    has_times[_parent_of_points(points)[filled]] = True
    return has_times & ~points.routes


def _tracks(
    points: GpxPoints, has_times: Flags, stem: str
) -> tuple[tuple[str, ...], NDArray[np.int32], Flags]:
    """Name tracks and shapes.

    Returns
    -------
    tuple of str
        Their names; empty for a single one without a name.
    int array, shape (n,)
        Index into them for each point.
    bool array
        Whether each is a shape.
    """
    # A track with times starts with its first segment, a shape with each segment.
    starts_parent = np.diff(points.parents, prepend=-1) > 0
    starts_track = starts_parent | ~has_times[points.parents]
    parents = points.parents[starts_track]
    codes = np.repeat(np.cumsum(starts_track) - 1, _segment_lengths(points)).astype(np.int32)
    is_shape: Flags = ~has_times[parents]

    # A track without a name is named after the file, unless it is the only one.
    if points.names == (None,):
        titles = [stem]
        ids = _distinct_names(titles * len(parents)) if len(parents) > 1 else ()
    else:
        titles = [
            f"{stem}-{number}" if name is None else name
            for number, name in enumerate(points.names, 1)
        ]
        ids = _distinct_names([titles[parent] for parent in parents.tolist()])
    return ids, codes, is_shape


def _distinct_names(names: Sequence[str]) -> tuple[str, ...]:
    """Number names that occur twice: the second ``a`` becomes ``a-2``, or the next free one."""
    # Going on from the last number keeps the search short if many tracks share a name.
    distinct: dict[str, None] = {}
    last_number: dict[str, int] = {}
    for name in names:
        new, number = name, last_number.get(name, 1)
        while new in distinct:
            number += 1
            new = f"{name}-{number}"
        last_number[name] = number
        distinct[new] = None
    return tuple(distinct)


# Positions and times


def _coordinates(points: GpxPoints, comma: bool) -> tuple[Floats, tuple[UnreadableCell, ...]]:
    """Return latitude and longitude, and the first value of each that can't be read."""
    lat = parse_degrees(points.lat, "lat", decimal_comma=comma)
    lon = parse_degrees(points.lon, "lon", decimal_comma=comma)
    cells = (_first_unreadable(points.lat, lat, "lat"), _first_unreadable(points.lon, lon, "lon"))
    return np.stack([lat, lon], axis=1), tuple(cell for cell in cells if cell is not None)


def _first_unreadable(texts: Any, values: Floats, name: str) -> UnreadableCell | None:
    """Return the first coordinate that is missing or can't be read: each point must have one."""
    bad = ~np.isfinite(values)
    if not bad.any():
        return None
    row = int(bad.argmax())
    text = texts[row].as_py()
    return UnreadableCell(name, row, f"no {name}" if text is None else text)


def _times(texts: Any, request: Request, where: str) -> Floats:
    if texts.null_count == len(texts):
        return np.full(len(texts), np.nan)
    unit = unit_seconds(request.time_unit) if request.time_unit else None
    return times_to_seconds(
        texts, unit, where, "time", origin=unit_origin(request.time_unit), dates=request.dates
    )


def _require_usable_points(
    where: str,
    times: Floats,
    coordinates: Floats,
    in_shape: Flags,
    unreadable: Sequence[UnreadableCell],
) -> None:
    """Raise unless a point has a position and, in a track, a time."""
    has_position: Flags = np.asarray(np.isfinite(coordinates).all(axis=1))
    if not has_position.any():
        first = unreadable[0]
        raise InputError(
            "no point has a position that can be read; the first has "
            f"{first.column}={_quote(first.value)}",
            path=where,
            remedy="write degrees such as lat='48.1371'",
        )
    if not (has_position & (in_shape | np.isfinite(times))).any():
        raise InputError("no point has both a position and a time that can be read", path=where)


# Attributes


def _attributes(
    points: GpxPoints, request: Request, comma: bool, where: str
) -> tuple[dict[str, NDArray[np.generic]], list[str]]:
    """Read the elements to keep.

    Returns
    -------
    dict of str to array
        Their values, by the names that were asked for.
    list of str
        The elements that were read.
    """
    kept = _kept_fields(points, request, where)
    attributes = {
        name: _values(points.fields[field], comma, where, field) for name, field in kept.items()
    }
    used = list(kept.values())

    # The course is the heading, if it is known anywhere.
    if _COURSE in points.fields and request.heading:
        headings = to_floats(points.fields[_COURSE], comma)
        if np.isfinite(headings).any():
            attributes["heading"] = headings
            used.append(_COURSE)
    return attributes, used


def _fields_named(name: str) -> list[str]:
    """Return the elements that a name may stand for, itself first."""
    field = name.lower()
    synonyms = next((group for group in _SYNONYMS if field in group), ())
    return list(dict.fromkeys((field, *synonyms)))


def _kept_fields(points: GpxPoints, request: Request, where: str) -> dict[str, str]:
    """Return the element to keep for each name that was asked for."""
    present = {field: shown for field, shown in points.present.items() if field != "time"}
    kept = {}
    for name in request.keep:
        field = next((field for field in _fields_named(name) if field in present), None)
        if field is None:
            names = ", ".join(list(present.values())[:_MAX_SHOWN_NAMES])
            shown = names or "position and time only"
            raise InputError(f"no {name!r} to keep", path=where, remedy=f"its points have: {shown}")
        kept[name] = field
    return kept


def _dropped(points: GpxPoints, used: Iterable[str]) -> tuple[str, ...]:
    known = {"time", *used}
    return tuple(shown for field, shown in points.present.items() if field not in known)


def _values(texts: Any, comma: bool, where: str, field: str) -> NDArray[np.generic]:
    """Return floats if all texts are numbers, NaN for those that are missing; else texts."""
    # In XML, NaN is a number that is not known; for to_floats it is a text.
    is_unknown = pc.fill_null(pc.match_substring_regex(texts, _NAN), True)
    floats = to_floats(texts, comma)
    unknown = is_unknown.to_numpy(zero_copy_only=False).astype(np.bool_)
    if (np.isfinite(floats) | unknown).all():
        return floats

    # Bound the memory of NumPy's texts, which are all as long as the longest one.
    letters = int(pc.max(pc.utf8_length(texts)).as_py())
    if letters * np.dtype("U1").itemsize * len(texts) > _MAX_TEXT_BYTES:
        raise InputError(
            f"texts of {letters} letters are too long to keep for {len(texts)} points",
            path=where,
            location=field,
            remedy="leave them out",
        )
    return np.array(pc.fill_null(texts, "").to_pylist(), dtype=np.str_)


# Repairs and what is left out


def _replacements(replaced: ReplacedBytes, where: str) -> tuple[Repair, ...]:
    if not replaced.count:
        return ()
    what = "bytes that don't fit the file's encoding read as Windows-1252"
    return (
        Repair(what, replaced.count, where, drops=False, value=f"text {_quote(replaced.first)}"),
    )


def _ignored_times(points: GpxPoints, time_texts: Any, where: str) -> tuple[Repair, ...]:
    in_route = points.routes[_parent_of_points(points)]
    rows = np.flatnonzero(time_texts.is_valid().to_numpy() & in_route)
    if not len(rows):
        return ()
    first = int(rows[0])
    what = "times of route points not read, as routes are shapes"
    value = f"time {_quote(time_texts[first].as_py())}"
    return (Repair(what, len(rows), f"{where}: point {first + 1}", drops=False, value=value),)


def _describe_waypoints(points: GpxPoints) -> str:
    return f"{points.waypoints} waypoint{'' if points.waypoints == 1 else 's'}"


def _quote(text: str) -> str:
    return repr(text if len(text) <= _MAX_SHOWN_LETTERS else text[:_MAX_SHOWN_LETTERS] + "...")
