"""Write stays, trips and places: as tables, as JSON, or as points and lines."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OutputError
from gpszip.geo.degree_lines import cut_at_antimeridian
from gpszip.io.logs.geojson.write import METRES_MEMBER
from gpszip.io.logs.track_rows import DEGREE_DIGITS, TIME_DECIMALS, round_decimals
from gpszip.io.storage.sink import open_sink
from gpszip.model.trips import Place, Stay, Trip, Trips

__all__ = [
    "PLACE_FORMATS",
    "TRIP_FORMATS",
    "matrix_rows",
    "place_rows",
    "table_format",
    "trip_rows",
    "write_places",
    "write_trips",
]

#: Formats of stays and trips, and of places, with their suffixes; the first is that of a stream.
TRIP_FORMATS = {
    "csv": (".csv",),
    "json": (".json",),
    "geojson": (".geojson",),
    "parquet": (".parquet", ".geoparquet"),
}
PLACE_FORMATS = TRIP_FORMATS

#: Decimals of metres and of seconds that are no times of the log.
_DECIMALS = 3

Rows = list[dict[str, Any]]
Floats = NDArray[np.float64]


def table_format(target: str, formats: Mapping[str, Sequence[str]], what: str) -> str:
    """Name of the format of a file, from its suffix; the first one for standard output.

    Raises
    ------
    OutputError
        If there is no such format.

    Examples
    --------
    >>> table_format("T.parquet", TRIP_FORMATS, "trips"), table_format("-", TRIP_FORMATS, "trips")
    ('parquet', 'csv')
    """
    if target == "-":
        return next(iter(formats))
    suffix = Path(target).suffix.lower()
    for name, suffixes in formats.items():
        if suffix in suffixes:
            return name
    shown = ", ".join(suffixes[0] for suffixes in formats.values())
    raise OutputError(
        f"{what} are written as {shown}, not as {suffix or 'a file without a suffix'}",
        path=target,
        remedy="name such a file",
    )


def write_trips(found: Trips, target: str, zone: tzinfo | None) -> None:
    """Write stays and trips, track by track in the order of time.

    Parameters
    ----------
    found : Trips
        What was found.
    target : str
        Name of the file, whose suffix says the format; ``-`` is standard output.
    zone : tzinfo or None
        Time zone of local times; None for a log whose times are no dates.

    Raises
    ------
    OutputError
        If the file can't be written.
    """
    kind = table_format(target, TRIP_FORMATS, "trips")
    rows = trip_rows(found, zone)
    if kind == "geojson":
        _write_features(_trip_features(found, rows), target, geographic=found.geographic)
    elif kind == "json":
        document = {
            "timezone": found.timezone or None,
            "rows": rows,
            "places": place_rows(found, zone),
            "matrix": matrix_rows(found),
        }
        _write_text(json.dumps(_strict(document), ensure_ascii=False) + "\n", target)
    else:
        _write_table(rows, _trip_columns(found), target, kind)


def write_places(found: Trips, target: str, zone: tzinfo | None) -> None:
    """Write places, by the time spent there; parameters and errors as of :func:`write_trips`."""
    kind = table_format(target, PLACE_FORMATS, "places")
    rows = place_rows(found, zone)
    if kind == "geojson":
        features = (
            _feature(row, {"type": "Point", "coordinates": _point(place.position, found)})
            for row, place in zip(rows, found.places, strict=True)
        )
        _write_features(features, target, geographic=found.geographic)
    elif kind == "json":
        _write_text(json.dumps(_strict({"places": rows}), ensure_ascii=False) + "\n", target)
    else:
        _write_table(rows, list(rows[0]) if rows else _place_columns(found), target, kind)


# Rows.


def trip_rows(found: Trips, zone: tzinfo | None) -> Rows:
    """Rows of stays and trips, track by track in the order of time."""
    # A pause lies within its trip, and follows it.
    order = {name: number for number, name in enumerate(_track_names(found))}
    items: list[Stay | Trip] = [*found.stays, *found.trips]
    items.sort(key=lambda item: (order[item.track], item.start, isinstance(item, Stay)))
    return [
        _stay_row(item, found, zone) if isinstance(item, Stay) else _trip_row(item, found, zone)
        for item in items
    ]


def _track_names(found: Trips) -> list[str]:
    """Names of the tracks; those of stays come in the order of the log, as those of trips."""
    return list(dict.fromkeys(item.track for items in (found.stays, found.trips) for item in items))


def _stay_row(stay: Stay, found: Trips, zone: tzinfo | None) -> dict[str, Any]:
    return {
        "track_id": stay.track,
        "kind": "stay",
        **_times(stay.start, stay.end),
        "place": stay.place,
        **_axes(stay.position, found),
        "length": 0.0,
        "moving_s": 0.0,
        "from_place": stay.place,
        "pause": stay.pause,
        "first_seen": _time(stay.first_seen),
        "last_seen": _time(stay.last_seen),
        "spread": round(stay.spread, _DECIMALS),
        **_local(stay.start, stay.end, zone),
    }


def _trip_row(trip: Trip, found: Trips, zone: tzinfo | None) -> dict[str, Any]:
    return {
        "track_id": trip.track,
        "kind": "trip",
        **_times(trip.start, trip.end),
        "place": trip.goal,
        **_axes(trip.finish, found),
        "length": round(trip.length, _DECIMALS),
        "moving_s": round(trip.moving, _DECIMALS),
        "from_place": trip.origin,
        "pause": False,
        "first_seen": None,
        "last_seen": None,
        "spread": None,
        **_local(trip.start, trip.end, zone),
    }


def _trip_columns(found: Trips) -> list[str]:
    """Names of the columns, which a table without rows has, too."""
    zone = None if not found.timezone else True
    axes = ["lat", "lon"] if found.geographic else ["x", "y"]
    return [
        *("track_id", "kind", "t_start", "t_end", "place", *axes, "length", "moving_s"),
        *("from_place", "pause", "first_seen", "last_seen", "spread"),
        *(("local_start", "local_end") if zone else ()),
    ]


def place_rows(found: Trips, zone: tzinfo | None) -> Rows:
    """Rows of places, by the time spent there."""
    return [_place_row(place, found, zone) for place in found.places]


def _place_row(place: Place, found: Trips, zone: tzinfo | None) -> dict[str, Any]:
    row = {
        "place": place.number,
        **_axes(place.position, found),
        "spread": round(place.spread, _DECIMALS),
        "visits": place.visits,
        "dwell_s": round(place.dwell, _DECIMALS),
        "first": _time(place.first),
        "last": _time(place.last),
        "departures": place.departures,
        "arrivals": place.arrivals,
        "role": place.role,
        "evidence": place.evidence,
        "usual_hours": place.usual,
    }
    if zone is not None:
        row |= {f"h{hour:02}": round(value) for hour, value in enumerate(place.hours)}
        names = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
        row |= {name: round(value) for name, value in zip(names, place.weekdays, strict=True)}
    return row


def _place_columns(found: Trips) -> list[str]:
    axes = ["lat", "lon"] if found.geographic else ["x", "y"]
    return ["place", *axes, "spread", "visits", "dwell_s"]


def matrix_rows(found: Trips) -> Rows:
    """Trips from place to place, most frequent first, with the median of their durations."""
    durations: dict[tuple[int, int], list[float]] = {}
    for trip in found.trips:
        durations.setdefault((trip.origin, trip.goal), []).append(trip.end - trip.start)
    return [
        {
            "from": origin,
            "to": goal,
            "trips": count,
            "median_s": round(float(np.median(durations[origin, goal])), _DECIMALS),
        }
        for (origin, goal), count in found.matrix.items()
    ]


def _times(start: float, end: float) -> dict[str, float | None]:
    return {"t_start": _time(start), "t_end": _time(end)}


def _time(seconds: float) -> float | None:
    return round(seconds, TIME_DECIMALS) if math.isfinite(seconds) else None


def _local(start: float, end: float, zone: tzinfo | None) -> dict[str, str]:
    """Both times as a local clock shows them, with its offset."""
    if zone is None:
        return {}
    texts = (datetime.fromtimestamp(round(time), zone).isoformat() for time in (start, end))
    return dict(zip(("local_start", "local_end"), texts, strict=True))


def _axes(position: tuple[float, ...], found: Trips) -> dict[str, float]:
    names = ["lat", "lon"] if found.geographic else [*"xyz"]
    names += [f"x{i}" for i in range(4, len(position) + 1)]
    digits = _DECIMALS + DEGREE_DIGITS if found.geographic else _DECIMALS
    return {name: round(value, digits) + 0.0 for name, value in zip(names, position, strict=False)}


# Files.


def _write_table(rows: Rows, columns: Sequence[str], target: str, kind: str) -> None:
    import pyarrow as pa

    # Rows of 3-D tracks have a column more.
    names = list(rows[0]) if rows else list(columns)
    table = pa.table({name: pa.array([row[name] for row in rows]) for name in names})
    with open_sink(target) as sink:
        if kind == "parquet":
            import pyarrow.parquet as pq

            pq.write_table(table, sink)
            return
        import pyarrow.csv as pc

        sink.write((",".join(names) + "\n").encode())
        if rows:
            pc.write_csv(table, sink, pc.WriteOptions(include_header=False, quoting_style="needed"))


def _write_text(text: str, target: str) -> None:
    with open_sink(target) as sink:
        sink.write(text.encode("utf-8", "backslashreplace"))


def _write_features(features: Iterable[dict[str, Any]], target: str, *, geographic: bool) -> None:
    # The slice strips the braces, so that the member stands beside "features".
    member = "" if geographic else f"{json.dumps(METRES_MEMBER)[1:-1]}, "
    lines = ",\n".join(json.dumps(_strict(each), ensure_ascii=False) for each in features)
    text = f'{{"type": "FeatureCollection", {member}"features": [\n{lines}\n]}}\n'
    _write_text(text, target)


def _trip_features(found: Trips, rows: Rows) -> Iterator[dict[str, Any]]:
    """Yield points of stays and lines of trips, in the order of the rows."""
    stays = {(stay.track, _time(stay.start)): stay for stay in found.stays}
    trips = {(trip.track, _time(trip.start)): trip for trip in found.trips}
    for row in rows:
        key = (row["track_id"], row["t_start"])
        if row["kind"] == "stay":
            point = _point(stays[key].position, found)
            yield _feature(row, {"type": "Point", "coordinates": point})
        else:
            yield _feature(row, _line(trips[key].line, geographic=found.geographic))


def _feature(row: dict[str, Any], geometry: dict[str, Any]) -> dict[str, Any]:
    hidden = {"lat", "lon", "x", "y", "z"}
    properties = {name: value for name, value in row.items() if name not in hidden}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _point(position: tuple[float, ...], found: Trips) -> list[float]:
    values = list(_axes(position, found).values())
    return [values[1], values[0], *values[2:]] if found.geographic else values


def _line(line: Floats, *, geographic: bool) -> dict[str, Any]:
    """Geometry of a line, cut where it crosses the antimeridian (RFC 7946, 3.1.9)."""
    if not geographic:
        return {"type": "LineString", "coordinates": round_decimals(line, _DECIMALS).tolist()}
    points = round_decimals(line[:, [1, 0]], _DECIMALS + DEGREE_DIGITS)
    digits = _DECIMALS + DEGREE_DIGITS
    cut = cut_at_antimeridian(points, np.array([0, len(points)]), decimals=digits)
    parts = [part.tolist() for part in np.split(cut.points, cut.cuts)]
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def _strict(value: Any) -> Any:
    """Return a value in which numbers that JSON doesn't know are null."""
    if isinstance(value, dict):
        return {name: _strict(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
