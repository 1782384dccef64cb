"""Write stays, trips and places: as tables, as JSON, or as points and lines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import datetime, tzinfo
from typing import Any

import numpy as np

from gpszip.io.feature_tables import (
    check_table_format,
    line_geometry,
    write_features,
    write_json,
    write_table,
)
from gpszip.io.logs.track_rows import DEGREE_DIGITS, TIME_DECIMALS
from gpszip.model.trips import Place, Stay, Trip, Trips

__all__ = [
    "matrix_rows",
    "place_rows",
    "trip_rows",
    "write_places",
    "write_trips",
]

#: Decimals of metres and of seconds that are no times of the log.
_DECIMALS = 3

#: Columns of seconds at a place in each hour of the day, and on each weekday.
_HOURS = tuple(f"h{hour:02}" for hour in range(24))
_WEEKDAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")

#: Columns of times as local clocks show them.
_LOCAL_TIMES = ("local_start", "local_end")

Rows = list[dict[str, Any]]


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
    kind = check_table_format(target, "trips")
    rows = trip_rows(found, zone)
    if kind == "geojson":
        geometries = _trip_geometries(found, rows)
        write_features(_without_axes(rows, found), geometries, target, geographic=found.geographic)
    elif kind == "json":
        document = {
            "timezone": found.timezone or None,
            "rows": rows,
            "places": place_rows(found, zone),
            "matrix": matrix_rows(found),
        }
        write_json(document, target)
    else:
        write_table(rows, _trip_kinds(found, zone), target, kind)


def write_places(found: Trips, target: str, zone: tzinfo | None) -> None:
    """Write places, by the time spent there; parameters and errors as of :func:`write_trips`."""
    kind = check_table_format(target, "places")
    rows = place_rows(found, zone)
    if kind == "geojson":
        geometries = (_point(place.position, found) for place in found.places)
        write_features(_without_axes(rows, found), geometries, target, geographic=found.geographic)
    elif kind == "json":
        write_json({"places": rows}, target)
    else:
        write_table(rows, _place_kinds(found, zone), target, kind)


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


def _trip_kinds(found: Trips, zone: tzinfo | None) -> dict[str, str]:
    """Columns of stays and trips, and kinds of their values."""
    kinds = dict.fromkeys(("track_id", "kind"), "U")
    kinds |= dict.fromkeys(("t_start", "t_end"), "f")
    kinds |= {"place": "i", **dict.fromkeys(_axis_names(found), "f")}
    kinds |= {"length": "f", "moving_s": "f", "from_place": "i", "pause": "b"}
    kinds |= dict.fromkeys(("first_seen", "last_seen", "spread"), "f")
    return kinds | (dict.fromkeys(_LOCAL_TIMES, "U") if zone is not None else {})


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
        seconds = (*place.hours, *place.weekdays)
        names = (*_HOURS, *_WEEKDAYS)
        row |= {name: round(value) for name, value in zip(names, seconds, strict=True)}
    return row


def _place_kinds(found: Trips, zone: tzinfo | None) -> dict[str, str]:
    """Columns of places, and kinds of their values."""
    kinds = {"place": "i", **dict.fromkeys(_axis_names(found), "f"), "spread": "f"}
    kinds |= {"visits": "i", "dwell_s": "f", "first": "f", "last": "f"}
    kinds |= dict.fromkeys(("departures", "arrivals"), "i")
    kinds |= dict.fromkeys(("role", "evidence", "usual_hours"), "U")
    hours = (*_HOURS, *_WEEKDAYS) if zone is not None else ()
    return kinds | dict.fromkeys(hours, "i")


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
    return dict(zip(_LOCAL_TIMES, texts, strict=True))


def _axes(position: Sequence[float], found: Trips) -> dict[str, float]:
    digits = _DECIMALS + DEGREE_DIGITS if found.geographic else _DECIMALS
    numbers = (round(value, digits) + 0.0 for value in position)
    return dict(zip(_axis_names(found), numbers, strict=True))


def _axis_names(found: Trips) -> list[str]:
    """Names of coordinates; two of them where nothing was found."""
    if found.geographic:
        return ["lat", "lon"]
    count = len(found.places[0].position) if found.places else 2
    return [*"xyz", *(f"x{axis}" for axis in range(4, count + 1))][:count]


# GeoJSON.


def _without_axes(rows: Rows, found: Trips) -> Rows:
    """Rows without coordinates, which geometries tell."""
    axes = _axis_names(found)
    return [{name: row[name] for name in row if name not in axes} for row in rows]


def _trip_geometries(found: Trips, rows: Rows) -> Iterator[dict[str, Any]]:
    """Yield points of stays and lines of trips, in the order of the rows."""
    digits = _DECIMALS + DEGREE_DIGITS if found.geographic else _DECIMALS
    stays = {(stay.track, _time(stay.start)): stay for stay in found.stays}
    trips = {(trip.track, _time(trip.start)): trip for trip in found.trips}
    for row in rows:
        key = (row["track_id"], row["t_start"])
        if row["kind"] == "stay":
            yield _point(stays[key].position, found)
        else:
            yield line_geometry(trips[key].line, digits, geographic=found.geographic)


def _point(position: tuple[float, ...], found: Trips) -> dict[str, Any]:
    values = list(_axes(position, found).values())
    if found.geographic:
        values = values[::-1]
    return {"type": "Point", "coordinates": values}
