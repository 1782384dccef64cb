"""Positions in the entries of location histories.

Google has exported histories in five forms. Each is a list, or a member of an object that is one:

- ``locations``: what each device measured (``Records.json``).
- ``rawSignals``: the same, of the last weeks, as Android exports it (``Timeline.json``).
- ``timelineEdits``: the same, of several devices.
- ``semanticSegments``, and a list outside of any object: paths between places, as Android and iOS
  export them. Times on iOS are minutes from the start of a segment.
- ``timelineObjects``: activities with paths, by month (Semantic Location History).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

__all__ = ["DEVICE_LISTS", "LISTS", "RAW_LISTS", "Position", "positions_in"]

#: Lists of what devices measured; the others hold paths, which Google made of it.
RAW_LISTS = frozenset({"locations", "rawSignals", "timelineEdits"})

#: Lists whose entries may name the device.
DEVICE_LISTS = frozenset({"locations", "timelineEdits"})

#: Seconds in a minute.
_MINUTE = 60.0

#: Milliseconds in a second, and millimetres in a metre.
_THOUSAND = 1000.0

_NAN = float("nan")


class Position(NamedTuple):
    """A position as the file has it.

    Parameters
    ----------
    point : str, optional
        Latitude and longitude as text: ``50.05°, 14.34°`` or ``geo:50.05,14.34``.
    lat_e7, lon_e7 : float
        Or as numbers, in 1e-7 degrees.
    time : str, optional
        When, or from when the seconds count; None for 1970.
    seconds : float
        Seconds after that; NaN if there is no time.
    device : str
        The device; empty if that isn't said.
    accuracy, alt, speed, heading : float
        Metres, metres, m/s and degrees; NaN if unknown.
    """

    point: str | None
    lat_e7: float
    lon_e7: float
    time: str | None
    seconds: float
    device: str = ""
    accuracy: float = _NAN
    alt: float = _NAN
    speed: float = _NAN
    heading: float = _NAN


def positions_in(member: str, entry: Any, others: Counter[str]) -> Iterator[Position]:
    """Yield the positions of an entry.

    Parameters
    ----------
    member : str
        Name of its list; empty for a list outside of any object.
    entry : object
        The entry.
    others : Counter of str
        Counts what has no position, by kind.
    """
    if isinstance(entry, dict):
        yield from LISTS[member](entry, others)
    else:
        others["entry that is no object"] += 1


def _from_location(entry: dict[str, Any], others: Counter[str]) -> Iterator[Position]:
    # Locations of which only the cells or networks nearby are known have no coordinates.
    if "latitudeE7" not in entry and "longitudeE7" not in entry:
        others["location without coordinates"] += 1
        return
    yield Position(
        None,
        _number(entry.get("latitudeE7")),
        _number(entry.get("longitudeE7")),
        *_time(entry, "timestamp"),
        _name(entry.get("deviceTag")),
        _number(entry.get("accuracy")),
        _number(entry.get("altitude")),
        _number(entry.get("velocity")),
        _number(entry.get("heading")),
    )


def _from_signal(
    entry: dict[str, Any], others: Counter[str], device: str = ""
) -> Iterator[Position]:
    # Scans of networks and guesses of activities are signals, too.
    position = entry.get("position")
    if not isinstance(position, dict):
        others.update(entry.keys())
        return
    accuracy = _number(position.get("accuracyMeters"))
    if "accuracyMm" in position:
        accuracy = _number(position["accuracyMm"]) / _THOUSAND
    yield Position(
        *_point(position.get("LatLng", position.get("point"))),
        *_time(position, "timestamp"),
        device,
        accuracy,
        _number(position.get("altitudeMeters")),
        _number(position.get("speedMetersPerSecond")),
    )


def _from_edit(entry: dict[str, Any], others: Counter[str]) -> Iterator[Position]:
    signal = _object(_object(entry.get("rawSignal")).get("signal"))
    device = _name(entry.get("deviceId"))
    if signal:
        yield from _from_signal(signal, others, device)
    else:
        others.update(name for name in entry if name != "deviceId")


def _from_segment(entry: dict[str, Any], others: Counter[str]) -> Iterator[Position]:
    # Visits and activities repeat where a path goes on.
    path = entry.get("timelinePath")
    if not isinstance(path, list):
        others.update(name for name in entry if not name.startswith(("start", "end")))
        return
    for step in map(_object, path):
        offset = step.get("durationMinutesOffsetFromStartTime")
        if "time" in step or offset is None:
            time = _time(step, "time")
        else:
            start, seconds = _time(entry, "startTime")
            time = start, seconds + _number(offset) * _MINUTE
        yield Position(*_point(step.get("point")), *time)


def _from_object(entry: dict[str, Any], others: Counter[str]) -> Iterator[Position]:
    # A visit is at a place that Google guessed, but what was measured there comes with it.
    activity = _object(entry.get("activitySegment"))
    item = activity or _object(entry.get("placeVisit"))
    steps = list(_objects(_object(item.get("simplifiedRawPath")).get("points")))
    ends = activity.get("startLocation"), activity.get("endLocation")
    duration = _object(activity.get("duration"))
    if not steps and not any(ends):
        others.update(entry.keys())
        return

    # The ends of an activity have the times of the activity. Points between without times are on
    # the roads that Google guessed.
    waypoints = list(_objects(_object(activity.get("waypointPath")).get("waypoints")))
    if waypoints:
        others["waypoint"] += len(waypoints)
    if isinstance(ends[0], dict):
        yield Position(*_point(ends[0]), *_time(duration, "startTimestamp"))
    for step in steps:
        accuracy = _number(step.get("accuracyMeters"))
        yield Position(*_point(step), *_time(step, "timestamp"), accuracy=accuracy)
    if isinstance(ends[1], dict):
        yield Position(*_point(ends[1]), *_time(duration, "endTimestamp"))


#: What reads the entries of each list.
LISTS: dict[str, Callable[[dict[str, Any], Counter[str]], Iterator[Position]]] = {
    "locations": _from_location,
    "rawSignals": _from_signal,
    "timelineEdits": _from_edit,
    "semanticSegments": _from_segment,
    "timelineObjects": _from_object,
    "": _from_segment,
}


# Values


def _point(value: Any) -> tuple[str | None, float, float]:
    """Return a point as text, or its latitude and longitude in 1e-7 degrees."""
    if isinstance(value, str):
        return value, _NAN, _NAN
    point = _object(value)
    lat = point.get("latE7", point.get("latitudeE7"))
    lon = point.get("lngE7", point.get("longitudeE7"))
    return None, _number(lat), _number(lon)


def _time(entry: dict[str, Any], name: str) -> tuple[str | None, float]:
    """Return a time as text and seconds after it; older exports have milliseconds since 1970."""
    text = entry.get(name)
    if isinstance(text, str):
        return text, 0.0
    return None, _number(entry.get(f"{name}Ms")) / _THOUSAND


def _number(value: Any) -> float:
    # Numbers may be written as texts, and integers may be too long for floats. Most values that
    # are asked for are missing.
    if value is None or isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return _NAN
    try:
        return float(value)
    except (ValueError, OverflowError):
        return _NAN


def _name(value: Any) -> str:
    return str(value) if isinstance(value, (int, str)) and not isinstance(value, bool) else ""


def _object(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _objects(values: Any) -> Iterable[dict[str, Any]]:
    return (
        (value for value in values if isinstance(value, dict)) if isinstance(values, list) else ()
    )
