"""What a monitor knows of one agent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from gpszip.history.stays.values import Settings
from gpszip.live.events import Event
from gpszip.live.fix import Fix
from gpszip.live.monitor.gaps import GapTracker
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.known import KnownEvents
from gpszip.live.monitor.reorder import ReorderBuffer
from gpszip.live.monitor.sources import SourceTracker
from gpszip.live.monitor.stays import StayTracker
from gpszip.live.monitor.window import Window

if TYPE_CHECKING:
    from gpszip.live.monitor.on_map.known_map import KnownMap
    from gpszip.live.monitor.on_map.tracker import MapTracker

__all__ = ["AgentMonitor"]

#: Seconds for which a source of an agent is preferred to its other sources.
_HOLD = 30.0

#: A source whose accuracy is this share of the other's is preferred at once.
_BETTER = 0.5

#: Seconds between two fixes of a receiver that reports each twice.
_SAME_EPOCH = 0.05

#: Seconds by which a late fix may be before all others, 32 years; earlier times have another zero.
_MAX_BEFORE = 1e9

#: Seconds for which late fixes wait for others, and for each fix that was read again last: that
#: takes 1 ms.
_LATE_SECONDS, _SECONDS_PER_FIX = 1.0, 0.01


class AgentMonitor:
    """Finds the events of one agent.

    Parameters
    ----------
    agent : str
        Its name.
    geographic : bool
        Whether its positions are in degrees.
    delay : float
        Seconds for which fixes wait for earlier ones.
    silent_after : float
        Seconds without a fix after which it is silent.
    settings : Settings
        What counts as a stay and as a trip.
    known_map : KnownMap, optional
        The map on which it is followed.
    """

    def __init__(
        self,
        agent: str,
        *,
        geographic: bool,
        delay: float,
        silent_after: float,
        settings: Settings,
        known_map: KnownMap | None = None,
    ) -> None:
        self.agent, self.geographic = agent, geographic
        self.buffer = ReorderBuffer(delay)
        self.received = 0.0
        self._window = Window(geographic=geographic)
        self._known = KnownEvents(agent, geographic=geographic)
        standing = math.inf if known_map is None else known_map.standing
        self._stays = StayTracker(self._window, self._known, settings, standing)
        self._gaps = GapTracker(self._window, self._known, silent_after)
        self._sources = SourceTracker(self._known)
        self._used: Fix | None = None

        #: What follows it on the map.
        self.on_map: MapTracker | None = None
        if known_map is not None:
            # Without a map, no kernels are loaded.
            from gpszip.live.monitor.on_map.tracker import MapTracker

            self.on_map = MapTracker(
                agent, known_map, self._window, self._stays.times, silent_after
            )

        #: When fixes that came late are read, in seconds of the clock; infinite if there are none.
        self.reading_due = math.inf

        # Seconds of the first one of them that revises what was told on the map.
        self._first_late = math.inf

    @property
    def is_silent(self) -> bool:
        """Whether it was told to be silent."""
        return self._gaps.is_silent

    def is_usable(self, fix: Fix) -> bool:
        """Whether a fix is to be used, the next in time: not the second report of one moment."""
        used = self._used
        if used is not None and fix.time > used.time:
            if fix.time - used.time < _SAME_EPOCH and fix.position != used.position:
                return not self.geographic
            if fix.source != used.source and fix.time - used.time <= _HOLD:
                if fix.accuracy is None or used.accuracy is None:
                    return False
                if fix.accuracy > _BETTER * used.accuracy:
                    return False
        self._used = fix
        return True

    def take(self, fix: Fix, capacity: int) -> list[Event]:
        """Return the events after the next fix in time.

        Parameters
        ----------
        fix : Fix
            Later than those before.
        capacity : int
            Fixes that may be kept.
        """
        # Far away, another log begins: travel ends while the window has its fixes.
        events = self._sources.take(fix)
        if self._stays.is_far(fix):
            if self.on_map is not None:
                events += self.on_map.cut(fix.received)
            events += self._stays.cut(fix.received)

        # What the fix tells: stays before travel, which depends on them.
        self._window.add(fix)
        events += self._gaps.take(fix.received, self._stays.settled)
        events += self._stays.take(fix, capacity)
        if self.on_map is not None:
            events += self.on_map.take(fix.received, capacity)
        return events

    def take_late(self, fix: Fix) -> bool:
        """Take a fix before others that were used; return whether it is not too late for that."""
        window = self._window
        if not len(window) or fix.time <= max(self._stays.settled, window.first - _MAX_BEFORE):
            return False
        if self._stays.is_far(fix):
            return False
        if window.add(fix):
            self._stays.take_late(fix.time)
            if self.is_in_time_for_map(fix):
                self._first_late = min(self._first_late, fix.time)
            if math.isinf(self.reading_due):
                # What follows it is read again, so that others wait with it.
                again = 0 if self.on_map is None else self.on_map.read_again
                self.reading_due = self.received + _LATE_SECONDS + _SECONDS_PER_FIX * again
        return True

    def is_in_time_for_map(self, fix: Fix) -> bool:
        """Whether a late fix still revises what was told on a map, if there is one."""
        return self.on_map is None or fix.time > self.on_map.oldest

    def read(self, received: float, *, goes_on: bool = True) -> list[Event]:
        """Return what follows from all fixes up to now, late ones too.

        Parameters
        ----------
        received : float
            Now, in seconds.
        goes_on : bool, default True
            Whether fixes follow.
        """
        late, self._first_late, self.reading_due = self._first_late, math.inf, math.inf
        events = self._gaps.read(received, self._stays.settled, is_silent=self._gaps.is_silent)
        events += self._stays.read(received, goes_on=goes_on)
        if self.on_map is not None:
            events += self.on_map.revise(late, received)
        return events

    def fall_silent(self, now: float) -> list[Event]:
        """Return the events of an agent that was not heard of for too long."""
        events = self._gaps.read(now, self._stays.settled, is_silent=True)
        if self.on_map is not None:
            events += self.on_map.rest(now, is_over=True)
        return events

    def refuse(self, time: float, received: float) -> list[Event]:
        """Return the events after a fix that was refused for its time."""
        return self._sources.refuse(time, received)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "agent": self.agent,
            "geographic": self.geographic,
            "received": self.received,
            "released": None if self._used is None else self.buffer.released,
            "waiting": [fix.to_row() for fix in self.buffer.waiting()],
            "window": self._window.to_rows(),
            "known": self._known.to_rows(),
            "stays": self._stays.to_row(),
            "silent": self._gaps.is_silent,
            "sources": self._sources.to_row(),
            "used": None if self._used is None else self._used.to_row(),
            "late": [time_to_json(self._first_late), time_to_json(self.reading_due)],
            "on_map": None if self.on_map is None else self.on_map.to_row(),
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self.received = row["received"]
        for fix in row["waiting"]:
            self.buffer.add(Fix.from_row(fix))
        if row["released"] is not None:
            self.buffer.released = row["released"]
        self._window.restore(row["window"])
        self._known.restore(row["known"])
        self._stays.restore(row["stays"])
        self._gaps.is_silent = row["silent"]
        self._sources.restore(row["sources"])
        self._used = None if row["used"] is None else Fix.from_row(row["used"])
        self._first_late, self.reading_due = (
            time_from_json(each, math.inf) for each in row["late"]
        )
        if self.on_map is not None and row["on_map"] is not None:
            self.on_map.restore(row["on_map"])
