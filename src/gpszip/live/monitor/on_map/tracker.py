"""One agent on the map: edges, travel off the map, predictions, and what is unusual."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import TrackError
from gpszip.geo.planes import to_plane
from gpszip.live.events import Event
from gpszip.live.fix import Fix
from gpszip.live.monitor.known import Finding, KnownEvents
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.outlook import Outlook
from gpszip.live.monitor.on_map.passes import Pass, PassReader, Step
from gpszip.live.monitor.on_map.patrol import PatrolTracker
from gpszip.live.monitor.on_map.surprises import Surprises
from gpszip.live.monitor.window import Window
from gpszip.matching.live import FinalisedPosition, LiveMatcher, LivePosition

__all__ = ["MapTracker"]

#: Fixes of the window from which a matcher finds again where the agent is.
_WARM_UP = 40

#: Kinds of events that are not told of an agent that stays: errors of its receiver would tell them
#: again and again.
_ON_THE_WAY = frozenset(
    {
        "off_map.start",
        "off_map.end",
        "wrong_way",
        "unusual.turn",
        "unusual.speed",
        "unusual.stop",
    }
)


class MapTracker:
    """Follows one agent on the map.

    Parameters
    ----------
    agent : str
        Its name.
    known_map : KnownMap
        The map.
    window : Window
        The agent's last fixes.
    known : KnownEvents
        Makes events.
    """

    def __init__(self, agent: str, known_map: KnownMap, window: Window, known: KnownEvents) -> None:
        self._map, self._window, self._known = known_map, window, known
        self._matcher: LiveMatcher | None = None
        self._reader = PassReader(known_map)
        self._outlook = Outlook(agent, known_map)
        self._surprises = Surprises(agent, known_map)
        self._patrol: PatrolTracker | None = None
        if known_map.rounds is not None:
            self._patrol = PatrolTracker(known_map, known_map.rounds)
        self._off_since: float | None = None
        self._is_off_told = False
        self._stays_since: float | None = None
        self._here: LivePosition | None = None
        self._received = 0.0

        #: Passes that are over, for those who watch all agents.
        self.passed: list[Pass] = []
        self.paths: list[tuple[NDArray[np.float64], float]] = []

    @property
    def has_matcher(self) -> bool:
        """Whether the agent has a matcher, which takes memory."""
        return self._matcher is not None

    def take(self, fix: Fix, *, stays_since: float | None = None) -> list[Event]:
        """Return the events after the next fix in time.

        Parameters
        ----------
        fix : Fix
            Later than those before.
        stays_since : float, optional
            Seconds at which the stay began that goes on; None on the way.
        """
        self._received = fix.received
        self._outlook.note_stay(is_staying=stays_since is not None)
        was_staying, self._stays_since = self._stays_since is not None, stays_since
        events = self._match(fix)
        if was_staying and stays_since is None and self._reader.is_off != self._is_off_told:
            # It left the map, or came back, in place.
            kind = "off_map.start" if self._reader.is_off else "off_map.end"
            events += self._tell([self._at(kind, fix.time)])
        here = self._here
        if here is not None and here.time == fix.time and not here.off_map:
            events += self._tell(self._surprises.stand(fix, 2 * here.edge + (not here.forward)))
        return events + self._tell(self._outlook.pass_time(fix.time, fix.position))

    def rest(self, *, is_over: bool) -> list[Event]:
        """Return what follows from the last fixes of an agent that stays or is silent.

        Parameters
        ----------
        is_over : bool
            Whether its trip is over.
        """
        events = [] if self._matcher is None else self._read(self._matcher.finish())
        self._here = None
        if is_over:
            self._outlook.end_trip()
        return events

    def drop_matcher(self) -> list[Event]:
        """Give the memory of the matcher back."""
        events = self.rest(is_over=False)
        self._matcher = None
        return events

    def _match(self, fix: Fix) -> list[Event]:
        position = self._map.project(fix)
        if position is None:
            return []
        if self._matcher is None:
            self._matcher = self._map.matcher()
        try:
            self._here = self._matcher.push(fix.time, position, fix.heading)
        except TrackError:
            return []
        return self._read(self._here.finalised)

    def _read(self, finalised: tuple[FinalisedPosition, ...]) -> list[Event]:
        events = []
        for found in finalised:
            step = self._reader.read(found)
            events += self._tell(self._findings(step))
            if self._reader.current is not None and found.edge >= 0:
                events += self._tell(self._surprises.travel(self._reader.current))
        return events

    def _findings(self, step: Step) -> list[Finding]:
        """What a step on the map tells."""
        # Back on the map.
        findings: list[Finding] = []
        if step.on is not None:
            findings.append(self._at("off_map.end", step.on))
            self._note_path(step.on)

        # Edges that are left; those that were passed as a whole were entered, too.
        for number, passed in enumerate(step.left):
            if number:
                findings += self._enter(passed)
            findings.append(self._leave(passed))
            findings += self._surprises.leave(passed)
            if self._patrol is not None:
                findings += self._patrol.add(passed)
            self.passed.append(passed)

        # The edge that is entered, or the end of the map.
        if step.entered is not None:
            findings += self._enter(step.entered)
        if step.off is not None:
            findings.append(self._at("off_map.start", step.off))
            self._outlook.end_trip()
            self._off_since = step.off
        return findings

    def _note_path(self, until: float) -> None:
        """Note the path off the map, from the last fix on it to the first one on it again."""
        since, self._off_since = self._off_since, None
        if since is None or self._is_in_place(until):
            return
        rows = slice(max(self._window.row_at(since) - 1, 0), self._window.row_at(until) + 1)
        coordinates = self._window.coordinates()[rows, :2]
        if self._map.plane is not None:
            coordinates = to_plane(coordinates[:, 0], coordinates[:, 1], self._map.plane)
        self.paths.append((coordinates, until))

    def _enter(self, passed: Pass) -> list[Finding]:
        place = self._map.place_on(passed.directed, passed.begin)
        offset = self._map.offset(passed.directed, passed.begin)
        entered = Finding("edge.enter", passed.enter, place, "", "", {}, passed.directed, offset)
        predicted = self._outlook.enter(passed.directed, passed.enter, starts=passed.starts)
        turned = self._surprises.enter(self._outlook.route, passed.enter)
        return [entered, *turned, *predicted]

    def _leave(self, passed: Pass) -> Finding:
        place = self._map.place_on(passed.directed, passed.along)
        offset = self._map.offset(passed.directed, passed.along)
        details = {"enter": round(passed.enter, 3), "metres": round(passed.metres, 1)}
        return Finding("edge.leave", passed.leave, place, "", "", details, passed.directed, offset)

    def _at(self, kind: str, time: float) -> Finding:
        """A finding where the agent was at a time."""
        row = min(self._window.row_at(time), len(self._window) - 1)
        return Finding(kind, time, self._window.position(row))

    def _is_in_place(self, time: float) -> bool:
        """Whether the agent was in place at a time, where it stays yet."""
        return self._stays_since is not None and time > self._stays_since

    def _tell(self, findings: list[Finding]) -> list[Event]:
        events = []
        for finding in findings:
            if finding.kind in _ON_THE_WAY and self._is_in_place(finding.time):
                continue
            if finding.kind in {"off_map.start", "off_map.end"}:
                # What began on the way may have ended in place.
                is_off = finding.kind == "off_map.start"
                if is_off == self._is_off_told:
                    continue
                self._is_off_told = is_off
            like = f"{finding.time:.3f} {finding.directed}"
            events.append(self._known.tell(finding, self._received, like=like))
        return events

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON; the matcher is found again from the window."""
        current = self._reader.current
        return {
            "current": None if current is None else asdict(current),
            "off": self._reader.is_off,
            "done": self._reader.done if math.isfinite(self._reader.done) else None,
            "outlook": self._outlook.to_row(),
            "surprises": self._surprises.to_row(),
            "patrol": None if self._patrol is None else self._patrol.to_row(),
            "off_since": self._off_since,
            "off_told": self._is_off_told,
            "stays_since": self._stays_since,
            "matcher": self.has_matcher,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._reader.current = None if row["current"] is None else Pass(**row["current"])
        self._reader.is_off = row["off"]
        self._outlook.restore(row["outlook"])
        self._surprises.restore(row["surprises"])
        if self._patrol is not None and row["patrol"] is not None:
            self._patrol.restore(row["patrol"])
        self._off_since, self._is_off_told = row["off_since"], row["off_told"]
        self._stays_since = row["stays_since"]

        # The matcher takes the last fixes again, whose positions were read.
        self._reader.done = math.inf
        if row["matcher"]:
            coordinates, times = self._window.coordinates(), self._window.times
            for number in range(max(0, len(times) - _WARM_UP), len(times)):
                position = tuple(coordinates[number].tolist())
                time = float(times[number])
                self._match(Fix("", "", time, time, position, self._window.geographic))
            self.passed.clear()
        self._reader.done = -math.inf if row["done"] is None else row["done"]
