"""The reorder buffer of an agent: fixes that come a little late take their place in time."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable

from gpszip.live.fix import Fix

__all__ = ["ReorderBuffer"]

#: Fixes that wait, at most; of more, the earliest goes on.
_MAX_WAITING = 4_000


class ReorderBuffer:
    """Holds fixes of one agent back until no earlier one is likely to come.

    A fix goes on when a fix comes whose time is ``delay`` later, or when so many seconds have
    passed since it was received.

    Parameters
    ----------
    delay : float
        Seconds.

    Examples
    --------
    >>> buffer = ReorderBuffer(10.0)
    >>> for time in (5.0, 3.0, 14.0):
    ...     buffer.add(Fix("bus", "gpsd", time, 20.0, (0.0, 0.0)))
    >>> [fix.time for fix in buffer.ready(20.0)], [fix.time for fix in buffer.flush()]
    ([3.0], [5.0, 14.0])
    """

    def __init__(self, delay: float) -> None:
        self._delay = delay
        self._times: list[float] = []
        self._fixes: dict[float, Fix] = {}
        self._newest = -math.inf

        #: Time of the last fix that went on.
        self.released = -math.inf

    def __len__(self) -> int:
        return len(self._times)

    @property
    def due(self) -> float:
        """Seconds of the clock at which a fix goes on, whatever comes; infinite if none waits."""
        received = (fix.received for fix in self._fixes.values())
        return min(received, default=math.inf) + self._delay

    def add(self, fix: Fix) -> None:
        """Take a fix that is later than the last one that went on; of two at one time, the better.

        The better one is more accurate, as the journal has it.
        """
        other = self._fixes.get(fix.time)
        if other is None:
            heapq.heappush(self._times, fix.time)
        elif not is_better(fix.accuracy, other.accuracy):
            return
        self._fixes[fix.time] = fix
        self._newest = max(self._newest, fix.time)

    def ready(self, clock: float) -> list[Fix]:
        """Return the fixes that go on, in the order of time.

        Parameters
        ----------
        clock : float
            Seconds: now, as times of receipt are counted.
        """
        # Of those received long ago, the latest takes all earlier ones along.
        limit = self._newest - self._delay
        for fix in self._fixes.values():
            if fix.received + self._delay <= clock:
                limit = max(limit, fix.time)
        found = []
        while self._times and (self._times[0] <= limit or len(self._times) > _MAX_WAITING):
            self.released = heapq.heappop(self._times)
            found.append(self._fixes.pop(self.released))
        return found

    def flush(self) -> list[Fix]:
        """Return all fixes that wait, in the order of time."""
        return self.ready(math.inf)

    def waiting(self) -> Iterable[Fix]:
        """The fixes that wait."""
        return self._fixes.values()


def is_better(accuracy: float | None, other: float | None) -> bool:
    """Whether an accuracy in metres is better than another one; known ones are."""
    return accuracy is not None and (other is None or accuracy < other)
