"""One agent's travel on the map: edges, travel off the map, predictions, and what is unusual.

What is found depends on the fixes in the order of their times and on when the agent stays, and on
nothing else: neither on when the fixes came, nor on what was found before later ones came.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import TrackError
from gpszip.geo.planes import to_plane
from gpszip.history.trips import MIN_STOP
from gpszip.live.fix import Fix
from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.outlook import Outlook
from gpszip.live.monitor.on_map.passes import Pass, PassReader, Step
from gpszip.live.monitor.on_map.patrol import PatrolTracker
from gpszip.live.monitor.on_map.surprises import Surprises
from gpszip.live.monitor.on_map.travelled import Travelled
from gpszip.live.monitor.stay_times import StayTime
from gpszip.live.monitor.window import Window
from gpszip.matching.live import FinalisedPosition, LiveMatcher

__all__ = ["TravelReader"]


class TravelReader:
    """Reads the fixes of one agent in the order of time.

    Parameters
    ----------
    agent : str
        Its name.
    known_map : KnownMap
        The map.
    window : Window
        The agent's last fixes.
    longest : float
        Seconds; a longer gap ends a trip.
    """

    def __init__(self, agent: str, known_map: KnownMap, window: Window, longest: float) -> None:
        self._map, self._window, self._longest = known_map, window, longest
        self._pass_reader = PassReader(known_map)
        self._outlook = Outlook(agent, known_map)
        self._surprises = Surprises(agent, known_map)
        self._patrol: PatrolTracker | None = None
        if known_map.rounds is not None:
            self._patrol = PatrolTracker(known_map, known_map.rounds)

        # The last fix, the start of the last stay before it, and the edge that it was on.
        self._time: float | None = None
        self._stay: float | None = None
        self._here: int | None = None
        self._off_since: float | None = None

        #: Takes memory while the agent travels.
        self.matcher: LiveMatcher | None = None

        #: Passes that are over.
        self.passes: Travelled[Pass] = Travelled()

        #: Paths off the map in metres, shape (n, 2), and when each ended in seconds.
        self.paths: Travelled[tuple[NDArray[np.float64], float]] = Travelled()

    def read(self, fix: Fix, stay: StayTime | None) -> list[Finding]:
        """Return what the next fix in time tells.

        Parameters
        ----------
        fix : Fix
            Later than those before.
        stay : StayTime, optional
            The last stay that began before it.
        """
        # A trip is over where a gap is long, and where a stay begins.
        findings: list[Finding] = []
        if self._time is not None and fix.time - self._time > self._longest:
            findings += self.finish(is_over=True)
        if stay is not None and stay.start != self._stay:
            findings += self.finish(is_over=True)
            self._stay = stay.start
        self._time = fix.time

        # In place, errors of the receiver would tell travel. A short stop may be unusual.
        if stay is not None and fix.time < stay.end:
            if self._here is not None and fix.time <= stay.start + MIN_STOP:
                findings += self._surprises.stand(fix, self._here)
            return findings

        # On the way.
        findings += self._match(fix)
        if self._here is not None:
            findings += self._surprises.stand(fix, self._here)
        return findings + self._outlook.pass_time(fix.time, fix.position)

    def finish(self, *, is_over: bool) -> list[Finding]:
        """Return what the last fixes tell; those that follow are matched anew.

        Parameters
        ----------
        is_over : bool
            Whether the trip is over.
        """
        findings = [] if self.matcher is None else self._read(self.matcher.finish())
        if is_over:
            self._outlook.end_trip()
        return findings

    def _match(self, fix: Fix) -> list[Finding]:
        self._here = None
        position = self._map.project(fix)
        if position is None:
            return []
        if self.matcher is None:
            self.matcher = self._map.matcher()
        try:
            here = self.matcher.push(fix.time, position, fix.heading)
        except TrackError:
            return []
        if not here.off_map:
            self._here = 2 * here.edge + (not here.forward)
        return self._read(here.finalised)

    def _read(self, finalised: tuple[FinalisedPosition, ...]) -> list[Finding]:
        findings = []
        for found in finalised:
            findings += self._findings(self._pass_reader.read(found))
            if self._pass_reader.current is not None and found.edge >= 0:
                findings += self._surprises.travel(self._pass_reader.current)
        return findings

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
            self.passes.add(passed)

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
        if since is None:
            return
        rows = slice(max(self._window.row_at(since) - 1, 0), self._window.row_at(until) + 1)
        coordinates = self._window.coordinates()[rows, :2]
        if self._map.plane is not None:
            coordinates = to_plane(coordinates[:, 0], coordinates[:, 1], self._map.plane)
        self.paths.add((coordinates, until))

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

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "matcher": None if self.matcher is None else self.matcher.state(),
            "passes": self._pass_reader.to_row(),
            "outlook": self._outlook.to_row(),
            "surprises": self._surprises.to_row(),
            "patrol": None if self._patrol is None else self._patrol.to_row(),
            "here": [self._time, self._stay, self._here, self._off_since],
            "counts": [self.passes.count, self.paths.count],
        }

    def restore(self, row: Mapping[str, Any]) -> None:
        """Take over what :meth:`to_row` returned; what was travelled since did not happen."""
        # Without a matcher there, an empty one goes on.
        if row["matcher"] is not None:
            self.matcher = self.matcher or self._map.matcher()
            self.matcher.restore(row["matcher"])
        elif self.matcher is not None:
            self.matcher.finish()

        # All others.
        self._pass_reader.restore(row["passes"])
        self._outlook.restore(row["outlook"])
        self._surprises.restore(row["surprises"])
        if self._patrol is not None and row["patrol"] is not None:
            self._patrol.restore(row["patrol"])
        self._time, self._stay, self._here, self._off_since = row["here"]
        passes, paths = row["counts"]
        self.passes.go_back(passes)
        self.paths.go_back(paths)
