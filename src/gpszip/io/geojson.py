"""GeoJSON: lines with the times of their positions, and points with a time each."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError, OutputError
from gpszip.io.columns import find_roles
from gpszip.io.raw_log import RawLog, Request
from gpszip.io.source import Source
from gpszip.io.table import table_log
from gpszip.io.timestamps import seconds, unit_origin, unit_seconds
from gpszip.io.track_rows import TrackRows, as_lines, decimal
from gpszip.model.reading import LeftOut

__all__ = ["METRES", "read_geojson", "sniff_geojson", "write_geojson"]

#: Member of a collection whose coordinates are metres on the log's own plane, as GeoJSON has no word for them.
METRES = {"gpszip": {"coordinates": "metres"}}

_TIMES = ("coordTimes", "times", "timestamps", "time", "coordinateTimes", "t")
_ID = ("track_id", "id", "trackid", "vehicle", "vehicle_id", "trip_id", "name")
_HEIGHTS = ("alt", "altitude", "ele", "elevation", "height")

#: Decimals of metres of heights.
_HEIGHT_DECIMALS = 3


def sniff_geojson(head: bytes) -> bool:
    """Whether a file that starts like this is JSON with types.

    Examples
    --------
    >>> sniff_geojson(b'{"type": "FeatureCollection"')
    True
    """
    return head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"


@dataclass
class _Lines:
    """What the lines of a file say, piece by piece."""

    names: list[str] = field(default_factory=list)
    coordinates: list[Sequence[Sequence[float]]] = field(default_factory=list)
    times: list[Any] = field(default_factory=list)
    anonymous: bool = True


def read_geojson(source: Source, request: Request) -> RawLog:
    """Read a log from LineStrings or from Points.

    A line has its times in the property ``coordTimes`` or ``times``, or as the fourth number of each position, and its
    name in ``track_id``, ``id`` or ``name``. A point has both among its properties.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Unit of time, attributes, and for points the columns among the properties.

    Returns
    -------
    RawLog

    Raises
    ------
    InputError
        If it is no GeoJSON, or has no line and no point with times.
    """
    try:
        data = json.loads(source.read().decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source.name}: damaged JSON file: {str(error)[:120]}") from None
    metric = isinstance(data, Mapping) and data.get("gpszip") == METRES["gpszip"]
    try:
        features = [feature for feature in _features(data) if isinstance(feature, Mapping)]
        lines = _collect(features, source.name)
        if lines.names:
            return _line_log(lines, source, request, metric, _left_out(features, source.name))
        return _point_log(features, source, request, metric)
    except (TypeError, AttributeError, ValueError, LookupError, pa.ArrowException) as error:
        raise InputError(f"{source.name}: not as GeoJSON should be: {str(error).splitlines()[0][:120]}") from None


def write_geojson(tracks: Iterable[TrackRows], sink: BinaryIO) -> None:
    """Write each track as a LineString with ``track_id`` and ``times`` in seconds, one for each position.

    A track with gaps, or one that crosses the antimeridian, is a MultiLineString, of which ``times`` has a list for each line. As a
    line has two positions or more, a lone one is a Point among the features of its track.

    Parameters
    ----------
    tracks : iterable of TrackRows
        All in x and y, or all on the earth. Metres are marked by the member ``gpszip``. Heights of tracks on the earth are
        written as third numbers, other attributes as lists among the properties. Tracks without times have no ``times``.
    sink : binary file
        Where to.

    Raises
    ------
    OutputError
        If some tracks are in metres and some in degrees.
    """
    start, geographic = b"", None
    for name, lines in as_lines(tracks):
        if geographic is None:
            geographic = lines[0].geographic
            member = "" if geographic else f"{json.dumps(METRES)[1:-1]}, "
            sink.write(f'{{"type": "FeatureCollection", {member}"features": [\n'.encode())
        if geographic != lines[0].geographic:
            raise OutputError("tracks in metres and tracks in degrees can't be written together")
        for feature in _track_features(name, lines):
            sink.write(start + json.dumps(feature, ensure_ascii=False).encode())
            start = b",\n"
    sink.write(b"\n]}\n" if geographic is not None else b'{"type": "FeatureCollection", "features": []}\n')


def _track_features(name: str, lines: Sequence[TrackRows]) -> Iterator[dict[str, Any]]:
    """A feature for the lines of a track; where positions lie alone among them, several in the order of travel."""
    for long, some in groupby(lines, key=lambda line: len(line) > 1):
        parts = [_part(line) for line in some]
        for group in [parts] if long else [[part] for part in parts]:
            yield _track_feature(name, group, "LineString" if long else "Point")


def _track_feature(name: str, parts: Sequence[tuple[list[Any], dict[str, list[Any]]]], kind: str) -> dict[str, Any]:
    coordinates = [positions for positions, _ in parts]
    columns = {key: [own[key] for _, own in parts] for key in parts[0][1]}
    geometry: dict[str, Any] = {"type": f"Multi{kind}", "coordinates": coordinates}
    if len(parts) == 1:
        columns = {key: values[0] for key, values in columns.items()}
        geometry = {"type": kind, "coordinates": coordinates[0][0] if kind == "Point" else coordinates[0]}
    times = {"times": columns.pop("times")} if "times" in columns else {}
    return {"type": "Feature", "properties": {**columns, "track_id": name, **times}, "geometry": geometry}


def _part(line: TrackRows) -> tuple[list[Any], dict[str, list[Any]]]:
    """Positions of a line, and the properties that have a value for each."""
    positions = line.places[:, ::-1] if line.geographic else line.places
    others = dict(line.attributes)
    height = next((name for name in _HEIGHTS if name in others), None) if line.geographic else None
    if height is not None and _is_known(others[height]):
        positions = np.column_stack([positions, decimal(others.pop(height).astype(np.float64), _HEIGHT_DECIMALS)])
    columns = {name: _list(values) for name, values in others.items()}
    if line.times is not None:
        columns["times"] = line.times.tolist()
    return positions.tolist(), columns


def _list(values: NDArray[np.generic]) -> list[Any]:
    """Values for JSON, which has no word for what is not finite."""
    plain: list[Any] = values.tolist()
    return [None if isinstance(value, float) and not math.isfinite(value) else value for value in plain]


def _is_known(heights: NDArray[np.generic]) -> bool:
    return heights.dtype.kind in "if" and bool(np.isfinite(heights.astype(np.float64)).all())


def _features(data: Any) -> Iterator[Any]:
    if not isinstance(data, Mapping):
        return
    if data.get("type") == "FeatureCollection":
        yield from data.get("features") or ()
    elif data.get("type") == "Feature":
        yield data
    else:
        yield {"type": "Feature", "properties": {}, "geometry": data}


def _kind(feature: Mapping[str, Any]) -> str:
    geometry = feature.get("geometry")
    return str(geometry.get("type")) if isinstance(geometry, Mapping) else "nothing"


def _properties(feature: Mapping[str, Any]) -> Mapping[str, Any]:
    properties = feature.get("properties")
    return properties if isinstance(properties, Mapping) else {}


def _collect(features: Sequence[Mapping[str, Any]], where: str) -> _Lines:
    lines = _Lines()
    for number, feature in enumerate(features, 1):
        kind, properties = _kind(feature), _properties(feature)
        times = _times(properties)
        if kind == "LineString":
            pieces = [(feature["geometry"].get("coordinates") or [], times)]
        elif kind == "MultiLineString":
            several = feature["geometry"].get("coordinates") or []
            pieces = list(zip(several, times if times is not None else [None] * len(several), strict=False))
        elif _is_line(feature):
            pieces = [([feature["geometry"].get("coordinates")], times)]
        else:
            continue
        name = _name(feature, properties)
        lines.anonymous &= name is None
        for coordinates, own in pieces:
            if coordinates:
                lines.names.append(name if name is not None else str(number - 1))
                lines.coordinates.append(coordinates)
                lines.times.append(_checked(own, coordinates, f"{where}: feature {number}"))
    return lines


def _times(properties: Mapping[str, Any]) -> list[Any] | None:
    places = (properties, properties.get("coordinateProperties"))
    for place in places:
        if isinstance(place, Mapping):
            for key in _TIMES:
                if isinstance(place.get(key), list):
                    return list(place[key])
    return None


def _name(feature: Mapping[str, Any], properties: Mapping[str, Any]) -> str | None:
    found = next((properties[key] for key in _ID if isinstance(properties.get(key), (str, int))), feature.get("id"))
    return None if found is None else str(found)


def _checked(times: Any, coordinates: Sequence[Sequence[float]], where: str) -> Sequence[Any]:
    if times is None and all(len(position) >= 4 for position in coordinates):
        return [position[3] for position in coordinates]
    if times is None:
        raise InputError(f"{where}: no times; a LineString needs the property 'coordTimes' or 'times', one for each position")
    if len(times) != len(coordinates):
        raise InputError(f"{where}: has {len(coordinates)} positions, but {len(times)} times")
    return list(times)


def _line_log(lines: _Lines, source: Source, request: Request, metric: bool, left_out: tuple[LeftOut, ...]) -> RawLog:
    flat = [position for piece in lines.coordinates for position in piece]
    width = _width(flat)
    table = np.array([position[:width] for position in flat], dtype=np.float64)
    unit = unit_seconds(request.time_unit) if request.time_unit else None
    cells = _column([time for piece in lines.times for time in piece])
    times = seconds(cells, unit, f"{source.name}: times", origin=unit_origin(request.time_unit), dates=request.dates)
    ids = tuple(dict.fromkeys(lines.names))
    index = {name: i for i, name in enumerate(ids)}
    codes = np.repeat([index[name] for name in lines.names], [len(piece) for piece in lines.coordinates]).astype(np.int32)
    kept = {name: table[:, 2] for name in request.keep if name in _HEIGHTS and width == 3}
    if missing := [name for name in request.keep if name not in kept]:
        raise InputError(f"{source.name}: its positions have no {missing[0]!r}; only a third number, alt, can be kept")
    plain = lines.anonymous and len(ids) == 1
    return RawLog(
        name=source.name,
        ids=() if plain else ids,
        codes=None if plain else codes,
        times=times,
        coordinates=table if metric else table[:, 1::-1].copy(),
        geographic=not metric,
        attributes=kept,
        word="position",
        dropped=("alt",) if width == 3 and not metric and not kept else (),
        left_out=left_out,
    )


def _point_log(features: Sequence[Mapping[str, Any]], source: Source, request: Request, metric: bool) -> RawLog:
    points = [feature for feature in features if _kind(feature) == "Point"]
    if not points:
        raise InputError(f"{source.name}: no LineString and no Point in it")
    keys = list(dict.fromkeys(key for feature in points for key in _properties(feature)))
    positions = [feature["geometry"]["coordinates"] for feature in points]
    axes = ["x", "y", "z"][: _width(positions)] if metric else ["lon", "lat"]
    names = [*axes, *(key for key in keys if key not in axes)]
    own = {"x": "x", "y": "y"} if metric else {"lat": "lat", "lon": "lon"}
    by_role = request.columns if isinstance(request.columns, Mapping) else {}
    roles = find_roles(names, {**by_role, **own}, request.keep, source.name, heading=request.heading)
    columns = [[position[i] for position in positions] for i in range(len(axes))]
    columns += [[_properties(feature).get(name) for feature in points] for name in names[len(axes) :]]
    return table_log([_column(columns[i]) for i in roles.used], names, roles, request, source.name)


def _width(positions: Sequence[Sequence[float]]) -> int:
    least = min(3, *map(len, positions))
    if least < 2:
        raise ValueError("a position has fewer than two numbers")
    return least


def _column(values: list[Any]) -> Any:
    try:
        array = pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        array = pa.array([None if value is None else str(value) for value in values], pa.string())
    return pa.chunked_array([array])


def _left_out(features: Sequence[Mapping[str, Any]], where: str) -> tuple[LeftOut, ...]:
    counts = Counter(_kind(feature) for feature in features if not _is_line(feature))
    return tuple(LeftOut(f"{where}: {count} {kind}", "not a line with times") for kind, count in sorted(counts.items()))


def _is_line(feature: Mapping[str, Any]) -> bool:
    single = _kind(feature) == "Point" and len(_times(_properties(feature)) or ()) == 1  # a track of one sample, as we write it
    return single or _kind(feature) in ("LineString", "MultiLineString")
