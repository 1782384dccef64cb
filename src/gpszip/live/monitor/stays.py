"""Stays and trips of an agent while it is on its way, by the rules of ``gpszip trips``.

The last fixes are read as a log again, whenever the newest ones may have changed what it says; what
is new or different becomes events. So the events of a log are, in the end, the stays and trips that
the log has. Fixes from before the last but one long stay are settled: they are not read again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import PLANE_RADIUS, choose_plane, to_plane
from gpszip.history.stays.collect import TrackSamples, track_timeline
from gpszip.history.stays.measure import measure_travel
from gpszip.history.stays.values import Move, Settings, Stop, Timeline
from gpszip.live.events import Event
from gpszip.live.fix import Fix, distance
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.known import Finding, KnownEvents
from gpszip.live.monitor.places import VisitedPlaces
from gpszip.live.monitor.stay_times import StayTimes
from gpszip.live.monitor.text import duration_text
from gpszip.live.monitor.window import Window
from gpszip.model.grid import Plane
from gpszip.model.projection import map_coordinates

__all__ = ["STAY_KINDS", "StayTracker"]

#: Kinds of events that are found here.
STAY_KINDS = frozenset({"trip.start", "trip.end", "stay.start", "stay.end"})

#: Seconds between two readings of an agent that is moving, or leaving a place.
_MOVING_PERIOD = 300.0
_CHANGE_PERIOD = 60.0

#: The first of them as a share of what is read.
_MOVING_SHARE = 0.1

#: Seconds of fixes before the newest that stay, so that late ones can correct them.
_KEPT = 86_400.0

#: Least number of fixes outside of a place until its being left is looked into: one may be an
#: error.
_MIN_OUTSIDE = 2

#: Multiples of the radius of places within which an agent may be about to stay.
_SLOW_REACH = 2.0

#: Error of a fix that states none, in metres.
_NOISE = 15.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Place:
    """Where an agent stays."""

    position: tuple[float, ...]
    since: float


class StayTracker:
    """Finds the stays and trips of one agent.

    Parameters
    ----------
    window : Window
        Its last fixes; this tracker alone removes some.
    known : KnownEvents
        What was told.
    settings : Settings
        What counts as a stay and as a trip.
    standing : float, default infinite
        Metres of spread up to which an agent that stays stands; else it moves within its place.
    """

    def __init__(
        self,
        window: Window,
        known: KnownEvents,
        settings: Settings,
        standing: float = math.inf,
    ) -> None:
        self._window, self._known, self._settings = window, known, settings
        self._standing = standing
        self._place: _Place | None = None
        self._last_reading = -math.inf
        self._outside = 0
        self._places = VisitedPlaces(settings.radius, geographic=window.geographic)

        # Places tell more once the log has fixes between gaps, as for gpszip trips.
        self._is_open = False

        # Long stays from which the window may be read: from the last one unless a fix is late.
        self._anchor = -math.inf
        self._anchors: list[float] = []

        #: Events up to this time stay as they were told.
        self.settled = -math.inf

        #: When the agent stands in place, for those who follow it on a map.
        self.times = StayTimes(window)

    @property
    def is_staying(self) -> bool:
        """Whether the agent stays in place, as far as was read."""
        return self._place is not None

    def take(self, fix: Fix, capacity: int) -> list[Event]:
        """Return the events after a fix, the newest of the window.

        Parameters
        ----------
        fix : Fix
            Is in the window already.
        capacity : int
            Fixes that the window may hold.
        """
        events = self.read(fix.received) if self._is_due(fix) else []
        if len(self._window) > capacity:
            if self._last_reading < fix.time:
                events += self.read(fix.received)
            self._shrink(capacity)
        self.times.leave(self._leaving())
        return events

    def take_late(self, time: float) -> None:
        """Note that a fix before the newest one was put into the window."""
        if time < self._anchor:
            self._anchor = self.settled

    def read(self, received: float, *, goes_on: bool = True) -> list[Event]:
        """Read the window as a log; return what is new or different.

        Parameters
        ----------
        received : float
            When the last fix was received, or now.
        goes_on : bool, default True
            Whether fixes follow. Then the newest one ends no trip: by where it is, a short stop on
            the way would be a turn at one reading, and none at the next.
        """
        if not len(self._window):
            return []
        self._last_reading, self._outside = self._window.last, 0
        line, plane = self._timeline(goes_on=goes_on)
        self._place = _current_place(line, plane)
        self.times.leave(self._leaving())

        # What it says, and what of it is settled now.
        findings = _findings(line, plane)
        events = self._known.update(findings, received, after=self._anchor, kinds=STAY_KINDS)
        self.times.update(_times_of(line, self._standing), self._anchor)
        self._settle(line)
        self._visit(line, plane)
        return events

    def cut(self, received: float) -> list[Event]:
        """End the log, as where an agent goes on far away: what is open ends there."""
        line, plane = self._timeline(goes_on=False)
        findings = _findings(line, plane, is_whole=True)
        events = self._known.update(findings, received, after=self._anchor, kinds=STAY_KINDS)

        # The next fix begins another log.
        self.times.end(self._window.last)
        self._settle_at(self._window.last)
        self._window.drop(len(self._window))
        self._place, self._last_reading = None, -math.inf
        return events

    def is_far(self, fix: Fix) -> bool:
        """Whether a fix is too far away for the plane of the window."""
        window = self._window
        if not len(window) or not window.geographic:
            return False
        return distance(Fix("", "", 0.0, 0.0, window.position(0)), fix) > PLANE_RADIUS / 2

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        place = self._place
        return {
            "place": None if place is None else [place.position, place.since],
            "last_reading": time_to_json(self._last_reading),
            "outside": self._outside,
            "settled": time_to_json(self.settled),
            "anchor": time_to_json(self._anchor),
            "anchors": self._anchors,
            "places": self._places.to_row(),
            "open": self._is_open,
            "times": self.times.to_row(),
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        if row["place"] is not None:
            position, since = row["place"]
            self._place = _Place(tuple(position), since)
        self._last_reading = time_from_json(row["last_reading"])
        self._outside = row["outside"]
        self.settled = time_from_json(row["settled"])
        self._anchor, self._anchors = time_from_json(row["anchor"]), list(row["anchors"])
        self._places.restore(row["places"])
        self._is_open = row["open"]
        self.times.restore(row["times"])

    def _is_due(self, fix: Fix) -> bool:
        """Whether the newest fix may change what the log says."""
        # Soon after it was read, nothing is decided.
        since = fix.time - self._last_reading
        window = self._window
        if since < _CHANGE_PERIOD or len(window) < 2:
            return since == math.inf and len(window) > 1
        if fix.time - window.time(len(window) - 2) >= self._settings.min_stay:
            return True

        # At a place, only fixes outside tell something.
        if self._place is not None:
            if self._is_in_place(fix):
                self._outside = 0
                return False
            self._outside += 1
            return self._outside >= _MIN_OUTSIDE

        # On the way, whoever has hardly moved for so long may stay. Long trips are read seldom.
        begin = max(self._anchor, window.first)
        if since >= max(_MOVING_PERIOD, _MOVING_SHARE * (fix.time - begin)):
            return True
        row = window.row_at(fix.time - self._settings.min_stay)
        before = Fix("", "", 0.0, 0.0, window.position(row), window.geographic)
        noise = _NOISE if fix.accuracy is None else fix.accuracy
        return distance(before, fix) <= _SLOW_REACH * self._settings.radius + noise

    def _leaving(self) -> float:
        """Seconds from which all fixes are outside of the place; infinite if they are not."""
        if self._place is None:
            return math.inf
        window, row = self._window, len(self._window)
        while row and not self._is_in_place(window.fix(row - 1, "")):
            row -= 1
        return window.time(row) if len(window) - row >= _MIN_OUTSIDE else math.inf

    def _is_in_place(self, fix: Fix) -> bool:
        """Whether a fix is within the place where the agent stays."""
        assert self._place is not None
        noise = _NOISE if fix.accuracy is None else fix.accuracy
        here = Fix("", "", 0.0, 0.0, self._place.position, self._window.geographic)
        return distance(here, fix) <= self._settings.radius + noise

    def _timeline(self, *, goes_on: bool = True) -> tuple[Timeline, Plane | None]:
        """Read the fixes from the anchor on."""
        row = self._window.row_at(self._anchor)
        coordinates, plane = self._window.coordinates()[row:], None
        if self._window.geographic:
            plane = choose_plane(coordinates[:1, 0], coordinates[:1, 1])
            coordinates = to_plane(coordinates[:, 0], coordinates[:, 1], plane)
        times, accuracy = self._window.times[row:], self._window.accuracy()[row:]
        track = TrackSamples("", times, coordinates, accuracy)
        if not self._is_open:
            line = track_timeline(track, self._settings, goes_on=goes_on)
            self._is_open = line.open
        if self._is_open:
            places = self._known_places(plane, coordinates.shape[1])
            line = track_timeline(track, self._settings, places, goes_on=goes_on)
        return line, plane

    def _known_places(self, plane: Plane | None, dimension: int) -> Floats | None:
        """Places where the agent stayed before, in metres."""
        centres = self._places.coordinates()
        if not len(centres) or centres.shape[1] != dimension:
            return None
        if plane is not None:
            return to_plane(centres[:, 0], centres[:, 1], plane)
        return centres

    def _visit(self, line: Timeline, plane: Plane | None) -> None:
        """Remember the places of stays that are over and were seen."""
        for stop in line.stops[:-1]:
            is_seen = stop.last_seen - stop.first_seen >= self._settings.min_stay
            if is_seen and stop.first_seen > self._places.until:
                is_new = self._places.add(_coordinates(stop.halt.centre, plane), stop.first_seen)
                if is_new and self._is_open:
                    # Single fixes there, of the last day, were stays.
                    self._anchor = self.settled

    def _long_stays(self, line: Timeline) -> list[float]:
        """First fixes of stays that can't become pauses, nor parts of those before the anchor."""
        return [
            stop.first_seen
            for stop in line.stops
            if not stop.pause
            and stop.last_seen - stop.first_seen >= self._settings.max_pause
            and stop.first_seen > self._anchor
        ]

    def _settle(self, line: Timeline) -> None:
        """Move the anchor, and drop fixes that no late one is likely to correct."""
        # The last but one long stay; the trip after it may change yet.
        long = self._long_stays(line)
        if len(long) > 1:
            self._anchors = [anchor for anchor in self._anchors if anchor < long[-2]]
            self._anchors.append(long[-2])
            self._anchor = long[-2]

        # The last anchor that is a day old.
        limit = self._window.last - _KEPT
        while len(self._anchors) > 1 and self._anchors[1] <= limit:
            self._settle_at(self._anchors[1])

    def _settle_at(self, time: float) -> None:
        """Let stand what happened up to a time, and drop the fixes before it."""
        self._window.drop(self._window.row_at(time))
        self._known.forget(time)
        self.times.forget(time)
        self.settled, self._anchor = time, max(self._anchor, time)
        self._anchors = [anchor for anchor in self._anchors if anchor >= time]

    def _shrink(self, capacity: int) -> None:
        """Keep the window within its capacity."""
        # Settle earlier than after a day.
        while len(self._window) > capacity * 3 // 4 and self._anchors:
            anchor = self._anchors.pop(0)
            self._settle_at(anchor)

        # Leave out fixes that are near others in time.
        if len(self._window) > capacity * 3 // 4:
            line, _ = self._timeline()
            ends = [time for stop in line.stops for time in (stop.first_seen, stop.last_seen)]
            self._window.thin(ends)

        # Fixes that are minutes apart: what happened half a window ago is settled.
        if len(self._window) > capacity:
            self._settle_at(self._window.time(len(self._window) - capacity // 2))


def _current_place(line: Timeline, plane: Plane | None) -> _Place | None:
    """The place where the log ends, if it ends at one."""
    if not line.stops:
        return None
    stop = line.stops[-1]
    is_left = any(move.origin == len(line.stops) - 1 for move in line.moves)
    return None if is_left else _Place(_coordinates(stop.halt.centre, plane), stop.start)


def _times_of(line: Timeline, standing: float) -> list[tuple[float, float]]:
    """Start and end of each stop with at most such a spread; infinite for what goes on."""
    left = {move.origin for move in line.moves}
    last = len(line.stops) - 1
    return [
        (stop.start, stop.end if number < last or number in left else math.inf)
        for number, stop in enumerate(line.stops)
        if stop.halt.spread <= standing
    ]


def _findings(line: Timeline, plane: Plane | None, *, is_whole: bool = False) -> list[Finding]:
    """Return what a log says; ends of what goes on are left out, unless it is whole."""
    findings = []
    left = {move.origin for move in line.moves}
    for number, stop in enumerate(line.stops):
        place = _coordinates(stop.halt.centre, plane)
        findings.append(_stay_start(stop, place))
        if number + 1 < len(line.stops) or number in left or is_whole:
            findings.append(_stay_end(stop, place))
    for move in line.moves:
        begin, finish = (_coordinates(each, plane) for each in (move.begin, move.finish))
        findings.append(Finding("trip.start", move.start, begin, why="it leads away"))
        if move.goal is not None or is_whole:
            findings.append(_trip_end(line, move, finish))
    return findings


def _stay_start(stop: Stop, place: tuple[float, ...]) -> Finding:
    pause = {"pause": True} if stop.pause else {}
    seen = duration_text(stop.last_seen - stop.first_seen)
    why = f"in place for {seen}" + (", and then the trip goes on" if stop.pause else "")
    details = {**pause, "spread": round(stop.halt.spread, 1)}
    return Finding("stay.start", stop.start, place, "pause" if stop.pause else "", why, details)


def _stay_end(stop: Stop, place: tuple[float, ...]) -> Finding:
    pause = {"pause": True} if stop.pause else {}
    details = {**pause, "start": round(stop.start, 3)}
    why = f"after {duration_text(stop.duration)}"
    return Finding("stay.end", stop.end, place, "pause" if stop.pause else "", why, details)


def _trip_end(line: Timeline, move: Move, finish: tuple[float, ...]) -> Finding:
    travel = measure_travel(line.fixes, move.start, move.end, move.begin, move.finish)
    details = {"start": round(move.start, 3), "length": round(travel.length, 1)}
    why = f"after {duration_text(move.end - move.start)} and {travel.length / 1000:.1f} km"
    return Finding("trip.end", move.end, finish, why=why, details=details)


def _coordinates(position: Floats, plane: Plane | None) -> tuple[float, ...]:
    row: Sequence[float] = map_coordinates(position[None], plane)[0].tolist()
    return tuple(row)
