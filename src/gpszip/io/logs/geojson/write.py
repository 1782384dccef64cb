"""Tracks written as GeoJSON: lines with the times of their positions."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.io.logs.raw import HEIGHT_NAMES
from gpszip.io.logs.track_rows import TrackRows, group_into_lines, round_decimals

__all__ = ["METRES_MEMBER", "to_json_list", "write_collection", "write_geojson", "write_geojsonl"]

#: Member of a collection whose coordinates are metres on the log's own plane, as GeoJSON has no
#: word for them.
METRES_MEMBER = {"gpszip": {"coordinates": "metres"}}

#: Decimals of heights in metres.
_HEIGHT_DECIMALS = 3

_EMPTY_COLLECTION = b'{"type": "FeatureCollection", "features": []}\n'


class _LineColumns(NamedTuple):
    """A line as lists for JSON.

    Parameters
    ----------
    positions : list
        Longitude, latitude and perhaps height, or metres.
    properties : dict of str to list
        Properties with a value for each position.
    """

    positions: list[Any]
    properties: dict[str, list[Any]]


def write_geojson(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a LineString with ``track_id`` and ``times``, one for each position.

    A track with gaps, or one that crosses the antimeridian, is a MultiLineString, whose ``times``
    has a list for each line. As a line has two positions or more, a single position is a Point
    among the features of its track.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe. Metres are marked by the member ``gpszip``. Heights of
        tracks on the globe are written as third numbers, other attributes as lists among the
        properties. Times are in seconds; tracks without times have no ``times``.
    sink : binary file
        The file to write to.

    Raises
    ------
    OutputError
        If some tracks are in metres and some in degrees.
    """
    write_collection(tracks, sink, _track_features, {}, {})


def write_collection(
    tracks: Iterable[TrackRows],
    sink: BinaryIO,
    make_features: Callable[[str, Sequence[TrackRows]], Iterable[dict[str, Any]]],
    crs: Mapping[str, Any],
    members: Mapping[str, Any],
) -> None:
    """Write the features of all tracks as a collection.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the globe. Metres are marked by :data:`METRES_MEMBER`.
    sink : binary file
        The file to write to.
    make_features : callable
        Returns the features of a track of this name and of these lines.
    crs : mapping of str to object
        Member of a collection of tracks on the globe that names their coordinate system.
    members : mapping of str to object
        Members of any collection.

    Raises
    ------
    OutputError
        If some tracks are in metres and some in degrees.
    """
    # Write feature by feature. The first track decides whether the collection is in metres.
    separator, geographic = b"", None
    for name, lines in group_into_lines(tracks):
        if geographic is None:
            geographic = lines[0].geographic
            system = crs if geographic else METRES_MEMBER
            start = json.dumps({"type": "FeatureCollection", **system, **members})[:-1]
            sink.write(f'{start}, "features": [\n'.encode())
        if geographic != lines[0].geographic:
            raise OutputError("tracks in metres and tracks in degrees can't be written together")

        for feature in make_features(name, lines):
            sink.write(separator + json.dumps(feature, ensure_ascii=False).encode())
            separator = b",\n"

    # Without a track, no collection was begun.
    sink.write(_EMPTY_COLLECTION if geographic is None else b"\n]}\n")


def write_geojsonl(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write the features of :func:`write_geojson`, one on each line, without a collection.

    Parameters
    ----------
    tracks : iterable of TrackRows
        As for :func:`write_geojson`. A feature in metres is marked by the member ``gpszip``.
    sink : binary file
        The file to write to.
    """
    for name, lines in group_into_lines(tracks):
        member = {} if lines[0].geographic else METRES_MEMBER
        for feature in _track_features(name, lines):
            sink.write(json.dumps({**feature, **member}, ensure_ascii=False).encode() + b"\n")


def _track_features(name: str, lines: Sequence[TrackRows]) -> Iterator[dict[str, Any]]:
    """Yield one feature for successive lines of a track, and one for each single position."""
    # Successive lines share a feature, so a single position between lines parts them in two.
    for is_line, group in groupby(lines, key=lambda line: len(line) > 1):
        columns = [_line_columns(line) for line in group]
        if is_line:
            yield _track_feature(name, columns, "LineString")
        else:
            yield from (_track_feature(name, [column], "Point") for column in columns)


def _track_feature(name: str, lines: Sequence[_LineColumns], kind: str) -> dict[str, Any]:
    """Return the feature of several lines, of one line, or of a position."""
    # Several lines become one Multi geometry, with a list of each property for each line.
    if len(lines) > 1:
        properties: dict[str, Any] = {
            key: [line.properties[key] for line in lines] for key in lines[0].properties
        }
        positions = [line.positions for line in lines]
        geometry = {"type": f"Multi{kind}", "coordinates": positions}
    else:
        (line,) = lines
        properties = dict(line.properties)
        coordinates = line.positions[0] if kind == "Point" else line.positions
        geometry = {"type": kind, "coordinates": coordinates}

    # Times come last, as they are long.
    times = {"times": properties.pop("times")} if "times" in properties else {}
    return {
        "type": "Feature",
        "properties": {**properties, "track_id": name, **times},
        "geometry": geometry,
    }


def _line_columns(line: TrackRows) -> _LineColumns:
    # Rows have the latitude first, GeoJSON the longitude (RFC 7946, 3.1.1).
    positions = line.coordinates[:, ::-1] if line.geographic else line.coordinates
    attributes = dict(line.attributes)

    # A height that is known everywhere is the third number.
    height = next((name for name in HEIGHT_NAMES if name in attributes), None)
    if line.geographic and height is not None and _is_known(attributes[height]):
        heights = round_decimals(attributes.pop(height).astype(np.float64), _HEIGHT_DECIMALS)
        positions = np.column_stack([positions, heights])

    properties = {name: to_json_list(values) for name, values in attributes.items()}
    if line.times is not None:
        properties["times"] = line.times.tolist()
    return _LineColumns(positions.tolist(), properties)


def to_json_list(values: NDArray[np.generic]) -> list[Any]:
    """Return values for JSON: null for numbers that are not finite, which JSON can't hold."""
    # Python's json.dumps would write NaN and Infinity, which other readers refuse.
    plain: list[Any] = values.tolist()
    return [
        None if isinstance(value, float) and not math.isfinite(value) else value for value in plain
    ]


def _is_known(heights: NDArray[np.generic]) -> bool:
    # A position can't hold null, so one unknown height keeps all of them among the properties.
    return heights.dtype.kind in "if" and bool(np.isfinite(heights.astype(np.float64)).all())
