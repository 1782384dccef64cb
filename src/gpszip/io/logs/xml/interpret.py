"""Interpret the points of a log in XML: names, tracks, positions, times and further fields.

What XML holds are texts. They are read column by column, alike for all formats.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import HEIGHT_NAMES, RawLog, Request, UnreadableCell
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.logs.xml.text import ReplacedBytes
from gpszip.io.storage.source import Source
from gpszip.io.values.arrow import to_floats
from gpszip.io.values.coordinates import first_unreadable_cell, has_decimal_comma, parse_degrees
from gpszip.io.values.timestamps import times_to_seconds, unit_origin, unit_seconds
from gpszip.model.read_result import Repair

__all__ = ["fields_to_collect", "interpret_points", "replacement_repairs"]

#: Names of one quantity. A request for one name is met by another that the points have.
_SYNONYMS = (
    HEIGHT_NAMES,
    ("hr", "heart_rate", "heartrate", "heartratebpm"),
    ("cad", "cadence", "runcadence"),
    ("atemp", "temperature", "temp"),
    ("power", "watts"),
)

#: Elements with the direction of travel.
_COURSES = ("course", "heading")

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


def fields_to_collect(request: Request) -> set[str]:
    """Return the fields of points that a request needs, by name in lower case.

    Examples
    --------
    >>> sorted(fields_to_collect(Request(keep=("power",))))
    ['power', 'time', 'watts']
    """
    wanted = {field for name in request.keep for field in _fields_named(name)}
    return wanted | {"time", *(_COURSES if request.heading else ())}


def interpret_points(
    points: LogPoints, source: Source, request: Request, plan_noun: str = "route"
) -> RawLog:
    """Turn the points of a file into a log.

    The segments of a track with times are one track; long pauses between them are gaps. A track
    without any times is a shape, and so is each planned route. How a shape goes from one segment to
    the next is not known, so each segment becomes a separate shape.

    Parameters
    ----------
    points : LogPoints
        At least one point.
    source : Source
        The file, for names.
    request : Request
        The unit of times that are numbers, and the fields of points to keep. Other common names of
        them are understood (``heart_rate`` for ``hr``).
    plan_noun : str
        What the format calls a planned route.

    Returns
    -------
    RawLog
        Tracks and routes in the order of the file, with numbers after names that occur twice.
        Coordinates that can't be read are NaN.

    Raises
    ------
    InputError
        If no point has a position, or there are times and none can be read; or if no point has a
        field to keep.
    """
    # Tell tracks from shapes, and name both.
    no_times = pa.chunked_array([pa.nulls(len(points), pa.string())])
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

    # Read the fields to keep; shapes are marked as tracks without times.
    attributes, used = _attributes(points, request, comma, source.name)
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
        repairs=_ignored_times(points, time_texts, source.name, plan_noun),
        unreadable=unreadable,
        untimed=frozenset(np.flatnonzero(is_shape).tolist()),
    )


def replacement_repairs(replaced: ReplacedBytes, where: str) -> tuple[Repair, ...]:
    """Return the repair for bytes that don't fit the encoding of a file, if there are any."""
    if not replaced.count:
        return ()
    what = "bytes that don't fit the file's encoding read as Windows-1252"
    return (
        Repair(what, replaced.count, where, drops=False, value=f"text {_quote(replaced.first)}"),
    )


# Tracks and shapes


def _parent_of_points(points: LogPoints) -> NDArray[np.intp]:
    """Index of the track or route of each point."""
    return np.repeat(points.parents, _segment_lengths(points))


def _segment_lengths(points: LogPoints) -> NDArray[np.intp]:
    return np.diff(points.starts, append=len(points.lat))


def _has_times(points: LogPoints, time_texts: Any) -> Flags:
    """Whether each track has times, readable or not. Those of planned routes don't count."""
    filled = time_texts.is_valid().to_numpy()
    has_times = np.zeros(len(points.names), dtype=np.bool_)
    has_times[_parent_of_points(points)[filled]] = True
    return has_times & ~points.plans


def _tracks(
    points: LogPoints, has_times: Flags, stem: str
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
    # The segments of a track with times are one track; each segment of a shape is one. Tracks are
    # numbered in the order of their first segments.
    numbers = len(points.names) + np.arange(len(points.parents))
    keys = np.where(has_times[points.parents], points.parents, numbers)
    _, first, track_of_segment = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    codes = np.repeat(rank[track_of_segment], _segment_lengths(points)).astype(np.int32)
    parents = points.parents[first[order]]
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


def _coordinates(points: LogPoints, comma: bool) -> tuple[Floats, tuple[UnreadableCell, ...]]:
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
    points: LogPoints, request: Request, comma: bool, where: str
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
    course = next((field for field in _COURSES if field in points.fields), None)
    if course is not None and request.heading:
        headings = to_floats(points.fields[course], comma)
        if np.isfinite(headings).any():
            attributes["heading"] = headings
            used.append(course)
    return attributes, used


def _fields_named(name: str) -> list[str]:
    """Return the elements that a name may stand for, itself first."""
    field = name.lower()
    synonyms = next((group for group in _SYNONYMS if field in group), ())
    return list(dict.fromkeys((field, *synonyms)))


def _kept_fields(points: LogPoints, request: Request, where: str) -> dict[str, str]:
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


def _dropped(points: LogPoints, used: Iterable[str]) -> tuple[str, ...]:
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


def _ignored_times(
    points: LogPoints, time_texts: Any, where: str, plan_noun: str
) -> tuple[Repair, ...]:
    in_route = points.plans[_parent_of_points(points)]
    rows = np.flatnonzero(time_texts.is_valid().to_numpy() & in_route)
    if not len(rows):
        return ()
    first = int(rows[0])
    what = f"times of {plan_noun} points not read, as {plan_noun}s are shapes"
    value = f"time {_quote(time_texts[first].as_py())}"
    return (Repair(what, len(rows), f"{where}: point {first + 1}", drops=False, value=value),)


def _quote(text: str) -> str:
    return repr(text if len(text) <= _MAX_SHOWN_LETTERS else text[:_MAX_SHOWN_LETTERS] + "...")
