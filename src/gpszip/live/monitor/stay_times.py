"""When an agent stays: which of its fixes are of stays, and which of travel."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple

from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.window import Window

__all__ = ["StayTime", "StayTimes"]


class StayTime(NamedTuple):
    """A stay, by the fixes around it.

    Parameters
    ----------
    start : float
        Seconds of the last fix before it, or of its first one.
    end : float
        Seconds of the first fix after it; infinite while it goes on.
    """

    start: float
    end: float


class StayTimes:
    """The stays of one agent, from one reading of its fixes to the next.

    Fixes between start and end are of the stay. So stays differ only if a fix is of another one.

    Parameters
    ----------
    window : Window
        The agent's last fixes.

    Examples
    --------
    >>> from gpszip import Fix
    >>> window = Window(geographic=True)
    >>> for time in (0.0, 10.0, 20.0, 30.0):
    ...     added = window.add(Fix("bus", "gpsd", time, 40.0, (48.0, 11.5)))
    >>> times = StayTimes(window)
    >>> times.update([(8.0, 22.0)], float("-inf"))
    >>> times.latest_before(10.0), times.take_changed()
    (StayTime(start=0.0, end=30.0), 0.0)
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        self._stays: list[StayTime] = []
        self._changed = math.inf
        # Whether the last one goes on, as far as is known, and when the agent seems to leave.
        self._goes_on = False
        self._leaving = math.inf

    def update(self, found: Sequence[tuple[float, float]], after: float) -> None:
        """Take the stays of the last reading.

        Parameters
        ----------
        found : sequence of tuple of float
            Start and end of each in seconds; infinite for the end of one that goes on.
        after : float
            Seconds: stays that began up to then are those of earlier readings; only the end of the
            last one of them may have changed.
        """
        # The last one may go on, though the agent seems to have left by now.
        self._goes_on = bool(found) and math.isinf(found[-1][1])

        # Those of earlier readings.
        stays = [stay for stay in self._stays if stay.start < after]
        new = [self._between_fixes(start, end) for start, end in found]
        if stays and stays[-1].end > after:
            last = stays.pop()
            if new and new[0].start <= after:
                stays.append(StayTime(last.start, new.pop(0).end))
        self._set(stays + new)

    def leave(self, time: float) -> None:
        """Note from when on the agent seems to be elsewhere; infinite if it is in place."""
        self._leaving = time
        if self._goes_on and self._stays[-1].end != time:
            self._set([*self._stays[:-1], StayTime(self._stays[-1].start, time)])

    def _set(self, stays: list[StayTime]) -> None:
        """Take other stays; note the first fix that is of another one now, or of none."""
        never = StayTime(math.inf, math.inf)
        for old, now in zip_longest(self._stays, stays, fillvalue=never):
            if old != now:
                same_start = old.start == now.start
                first = min(old.end, now.end) if same_start else min(old.start, now.start)
                self._changed = min(self._changed, first)
                break
        self._stays = stays

    def end(self, time: float) -> None:
        """End a stay that goes on, where the log is cut."""
        if self._goes_on:
            self._stays[-1] = StayTime(self._stays[-1].start, time)
        self._goes_on, self._leaving = False, math.inf

    def latest_before(self, time: float) -> StayTime | None:
        """The last stay that began before a time, whether it is over then or not."""
        number = bisect_left(self._stays, time, key=lambda stay: stay.start)
        return self._stays[number - 1] if number else None

    def take_changed(self) -> float:
        """Seconds after which fixes are of other stays than at the last call; infinite if none."""
        changed, self._changed = self._changed, math.inf
        return changed

    def forget(self, until: float) -> None:
        """Forget stays that were over before a time, but for the last one."""
        count = bisect_right(self._stays, until, key=lambda stay: stay.end)
        del self._stays[: max(min(count, len(self._stays)) - 1, 0)]

    def _between_fixes(self, start: float, end: float) -> StayTime:
        """The stay from one fix to another one."""
        window = self._window
        end = self._leaving if math.isinf(end) else end
        row = window.row_at(math.nextafter(start, math.inf))
        if row:
            start = window.time(row - 1)
        after = window.row_at(end)
        return StayTime(start, window.time(after) if after < len(window) else end)

    def to_row(self) -> dict[str, Any]:
        """Return the stays as a value of JSON."""
        return {
            "stays": [[start, time_to_json(end)] for start, end in self._stays],
            "goes_on": self._goes_on,
            "leaving": time_to_json(self._leaving),
        }

    def restore(self, row: Mapping[str, Any]) -> None:
        """Know what :meth:`to_row` returned."""
        self._stays = [
            StayTime(start, time_from_json(end, math.inf)) for start, end in row["stays"]
        ]
        self._goes_on = row["goes_on"]
        self._leaving = time_from_json(row["leaving"], math.inf)
