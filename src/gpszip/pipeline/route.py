"""Routes over the map of an archive, from places and a departure as users give them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.geo.planes import to_plane
from gpszip.history.calendar import Calendar, choose_calendar
from gpszip.history.routes import PlannedRoute, find_position, find_routes
from gpszip.history.travel_time import learn_travel_times
from gpszip.history.traversals import read_history
from gpszip.model import Network
from gpszip.model.timestamps import Times, counts_from_1970, to_seconds

__all__ = ["Plan", "plan_route"]

#: Parts of a time of day: hours, and minutes at most 59.
_CLOCK_PARTS = 2
_MINUTES = 60

#: Seconds between a departure and the last time of the log at most: a hundred years.
_MAX_APART = 100 * 365.25 * 86_400.0


class Plan(NamedTuple):
    """Routes, and what their times mean.

    Parameters
    ----------
    routes : tuple of PlannedRoute
        The best one first.
    network : Network
        The map.
    calendar : Calendar
        Time zone of the departure.
    depart : float or None
        Departure in seconds, in the log's zero.
    """

    routes: tuple[PlannedRoute, ...]
    network: Network
    calendar: Calendar
    depart: float | None


def plan_route(
    archive: Archive,
    places: Sequence[Sequence[float]],
    *,
    by: str,
    depart: str | Times | None,
    alternatives: int,
    timezone: str | None,
) -> Plan:
    """Plan a route over the map of an archive; see :func:`gpszip.route`."""
    # Places on the map.
    if len(places) < 2:
        raise OptionError("a route needs two places or more")
    history = read_history(archive)
    network, rows = history.network, history.traversals
    is_open = np.bincount(rows.edge[~rows.jumps], minlength=len(network)) > 0
    stops = [
        find_position(network, _to_metres(place, network), f"stop {number}", is_open)
        for number, place in enumerate(places, 1)
    ]

    # Travel times, if the log has times.
    calendar = choose_calendar(network, rows.enter, timezone)
    times = learn_travel_times(history, calendar) if np.isfinite(rows.enter).any() else None
    seconds = None
    if depart is not None:
        if times is None:
            raise OptionError("no track has times, so that a departure tells nothing")
        seconds = _departure(depart, calendar, float(np.nanmax(rows.leave)))
    routes = find_routes(
        history, stops, by=by, times=times, depart=seconds, alternatives=alternatives
    )
    return Plan(routes, network, calendar, seconds)


def _to_metres(place: Sequence[float], network: Network) -> Sequence[float]:
    """A place in the coordinates of the log as metres on its plane."""
    first, second = place[0], place[1]
    if network.plane is None:
        if not (np.isfinite(first) and np.isfinite(second)):
            raise OptionError(f"{first:g},{second:g} is no position", remedy="give x,y in metres")
        return (first, second)
    if not (abs(first) <= 90 and abs(second) <= 360):
        raise OptionError(
            f"{first:g},{second:g} is no latitude and longitude",
            remedy="latitude comes first, in degrees",
        )
    metres = to_plane(np.array([first]), np.array([second]), network.plane)[0]
    return (float(metres[0]), float(metres[1]))


def _departure(depart: str | Times, calendar: Calendar, last: float) -> float:
    """Seconds of a departure: a time of day on the last day of the log, or a time."""
    # A time, near enough to the log for dates and hours that are those of the log.
    if not isinstance(depart, str) or "-" in depart:
        seconds = float(to_seconds(depart, name="depart"))
        if not calendar.name and counts_from_1970(seconds):
            raise OptionError(
                f"departure {depart} is a date, and the times of the log are none",
                remedy="give hours from the log's zero, such as 00:30",
            )
        if not abs(seconds - last) <= _MAX_APART:
            raise OptionError(
                f"departure {depart} is more than a hundred years from the log",
                remedy="give a time nearer to it, or a time of day such as 08:00",
            )
        return seconds

    # A time of day.
    parts = depart.split(":")
    if len(parts) > _CLOCK_PARTS or not all(part.isdecimal() for part in parts):
        raise OptionError(f"{depart!r} is no departure", remedy="write one such as 08:00")
    hour, minute = int(parts[0]), int(parts[1]) if len(parts) > 1 else 0
    if hour >= 24 or minute >= _MINUTES:
        raise OptionError(f"{depart!r} is no time of day", remedy="write one such as 08:00")
    return calendar.at(hour + minute / _MINUTES, last)
