"""Events of one agent on the map, which late fixes and stays revise.

The state of the reader is kept now and then. Where a fix comes late, or fixes turn out to be of a
stay, the reader goes back to the last state before, and reads again what follows. What it finds
then replaces what was told.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.history.trips import MIN_STOP
from gpszip.live.events import Event
from gpszip.live.fix import Fix
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.passes import Pass
from gpszip.live.monitor.on_map.told import ToldFindings
from gpszip.live.monitor.on_map.travel import TravelReader
from gpszip.live.monitor.on_map.travelled import Travelled
from gpszip.live.monitor.stay_times import StayTimes
from gpszip.live.monitor.window import Window

__all__ = ["MapTracker"]

Floats = NDArray[np.float64]

#: Seconds of fixes before the newest in which late ones revise what was told of edges.
_HORIZON = 21_600.0

#: Seconds of fixes between two states that are kept, at least. One takes 2 kB.
_SPACING = 120.0

#: Share of a state's age by which those beside it may be apart: older ones are kept less densely,
#: so that there are about twenty in all.
_MAX_APART = 0.5

#: Events that may be revised: this share of the fixes that an agent may have.
_TOLD_SHARE = 0.1


@dataclass
class _Kept:
    """The state of the reader after a fix."""

    time: float
    told: int
    state: bytes


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
    stays : StayTimes
        When it stays.
    longest : float
        Seconds; a longer gap ends a trip.
    """

    def __init__(
        self,
        agent: str,
        known_map: KnownMap,
        window: Window,
        stays: StayTimes,
        longest: float,
    ) -> None:
        self._agent, self._window, self._stays = agent, window, stays
        self._reader = TravelReader(agent, known_map, window, longest)
        self._told = ToldFindings(agent, geographic=window.geographic)
        self._kept: list[_Kept] = []
        self._time = -math.inf

        # Whether more was told than the fixes so far say, as if none followed.
        self._is_finished = False

        #: Fixes that were read again last.
        self.read_again = 0

    @property
    def passes(self) -> Travelled[Pass]:
        """Passes that are over, for those who watch all agents."""
        return self._reader.passes

    @property
    def paths(self) -> Travelled[tuple[Floats, float]]:
        """Paths off the map, and when each ended."""
        return self._reader.paths

    @property
    def oldest(self) -> float:
        """Seconds; late fixes from before are too old to revise what was told."""
        return self._kept[0].time if self._kept else math.inf

    @property
    def has_matcher(self) -> bool:
        """Whether the agent has a matcher, which takes memory."""
        return self._reader.matcher is not None

    def take(self, received: float, capacity: int) -> list[Event]:
        """Return the events after the next fix in time, the newest of the window.

        Parameters
        ----------
        received : float
            When it was received.
        capacity : int
            Fixes that the window may hold.
        """
        # The state before the first fix.
        if not self._kept:
            self._keep(self._told.count)

        # What was told as if no fix followed, or as of other stays, is revised.
        since = self._stays.take_changed()
        if self._is_finished or math.isfinite(since):
            events = self._read_again(since, received)
        else:
            fix = self._window.fix(len(self._window) - 1, self._agent)
            events = self._told.tell(self._read(fix), received)
            self._keep_some(self._told.count)
        self._forget(capacity)
        return events

    def revise(self, late: float, received: float) -> list[Event]:
        """Return what is new or different by fixes that came late, or by stays that were found.

        Parameters
        ----------
        late : float
            Seconds of the first fix that came late, of those after the oldest state; infinite if
            none did.
        received : float
            When the last fix was received, or now.
        """
        since = min(self._stays.take_changed(), late)
        return self._read_again(since, received) if math.isfinite(since) else []

    def rest(self, received: float, *, is_over: bool) -> list[Event]:
        """Return what the last fixes of an agent tell, as if none followed.

        Parameters
        ----------
        received : float
            Now, in seconds.
        is_over : bool
            Whether its trip is over.
        """
        if self._is_finished or not self._kept:
            return []
        if self._kept[-1].time < self._time:
            self._keep(self._told.count)
        self._is_finished = True
        return self._told.tell(self._reader.finish(is_over=is_over), received)

    def cut(self, received: float) -> list[Event]:
        """End the log, as where an agent goes on far away; what was told stays."""
        events = self.rest(received, is_over=True)
        self._stays.take_changed()
        self._begin_anew()
        return events

    def drop_matcher(self, received: float) -> list[Event]:
        """Give the memory of the matcher back; what was told stays."""
        events = self.rest(received, is_over=False)
        self._reader.matcher = None
        self._begin_anew()
        return events

    def _begin_anew(self) -> None:
        """Let stand what was told, and go on from the last fix."""
        self._is_finished = False
        self._kept.clear()
        self._keep(self._told.count)

    def _read(self, fix: Fix) -> list[Finding]:
        """Read the next fix."""
        self._time = fix.time
        return self._reader.read(fix, self._stays.latest_before(fix.time))

    def _read_again(self, since: float, received: float) -> list[Event]:
        """Read the fixes from a time on again; return what is new or different."""
        # Back to the state before; without one that is so old, to the oldest one.
        self._leave_lost()
        if not self._kept or not len(self._window):
            return []
        while len(self._kept) > 1 and self._kept[-1].time >= since:
            self._kept.pop()
        kept = self._kept[-1]
        self._reader.restore(json.loads(zlib.decompress(kept.state)))
        self._time, self._is_finished = kept.time, False

        # From there on.
        findings: list[Finding] = []
        self.read_again = 0
        for fix in self._fixes_after(kept.time):
            self.read_again += 1
            findings += self._read(fix)
            self._keep_some(kept.told + len(findings))
        return self._told.replace(kept.told, findings, received)

    def _fixes_after(self, time: float) -> Iterator[Fix]:
        """The fixes after a time, but for those of stays that tell nothing."""
        row, window = self._window.row_at(math.nextafter(time, math.inf)), self._window
        while row < len(window):
            at = window.time(row)
            stay = self._stays.latest_before(at)
            if stay is not None and stay.start + MIN_STOP < at < stay.end:
                row = max(window.row_at(min(stay.end, window.last)), row)
            yield window.fix(row, self._agent)
            row += 1

    def _keep_some(self, told: int) -> None:
        """Keep the state where a stay begins, and from time to time on the way."""
        if not self._kept:
            self._keep(told)
            return
        since = self._time - self._kept[-1].time
        stay = self._stays.latest_before(self._time)
        if stay is not None and self._time < stay.end:
            # While the agent stays, it is always the same.
            if self._kept[-1].time > stay.start or since <= 0:
                return
        elif since < _SPACING:
            return
        self._keep(told)

    def _keep(self, told: int) -> None:
        """Keep the state after the last fix, and leave out some of the earlier ones."""
        state = json.dumps(self._reader.to_row(), separators=(",", ":")).encode()
        kept = self._kept
        kept.append(_Kept(self._time, told, zlib.compress(state, 1)))
        for number in range(len(kept) - 2, 0, -1):
            age = self._time - kept[number + 1].time
            if kept[number + 1].time - kept[number - 1].time <= _MAX_APART * age:
                del kept[number]

    def _forget(self, capacity: int) -> None:
        """Forget states that are old, or of too many events ago, and what was told before."""
        kept = self._kept
        most = _TOLD_SHARE * capacity
        while len(kept) > 1 and (
            kept[1].time <= self._time - _HORIZON or self._told.count - kept[0].told > most
        ):
            del kept[0]
        self._leave_lost()
        self._told.forget(kept[0].told)

    def _leave_lost(self) -> None:
        """Leave out states after which fixes are lost that would have to be read again."""
        # All but the last one before what is lost.
        kept, lost = self._kept, self._window.complete_after
        while len(kept) > 1 and kept[1].time <= lost:
            del kept[0]
        if not kept or kept[0].time >= lost:
            return

        # In a stay, the state remains the same: it is that after the lost fixes, too.
        stay = self._stays.latest_before(lost)
        if stay is not None and stay.start < kept[0].time and lost < stay.end:
            kept[0].time = lost
            return
        del kept[0]
        if not kept:
            self._keep(self._told.count)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "reader": self._reader.to_row(),
            "told": self._told.to_row(),
            "time": time_to_json(self._time),
            "finished": self._is_finished,
            "read_again": self.read_again,
            "kept": [
                [time_to_json(kept.time), kept.told, base64.b64encode(kept.state).decode("ascii")]
                for kept in self._kept
            ],
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._reader.restore(row["reader"])
        self._told.restore(row["told"])
        self._time = time_from_json(row["time"])
        self._is_finished, self.read_again = row["finished"], row["read_again"]
        self._kept = [
            _Kept(time_from_json(time), told, base64.b64decode(state))
            for time, told, state in row["kept"]
        ]
