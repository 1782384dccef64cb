"""Which of several sources of one agent counts: the best one, until it falls silent."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

__all__ = ["Choice"]

#: Seconds after its last position for which a source is held: several alternate otherwise.
_HOLD = 10.0

#: Agents that are kept in memory; of more, the one unused for longest goes.
_MAX_AGENTS = 20_000


@dataclass(slots=True)
class _Held:
    source: str
    rank: int
    time: float
    received: float


class Choice:
    """Chooses one source of each agent, as positions of several are metres apart.

    A source is held until nothing has come from it for 10 s, or until a better one comes. For one
    that is as good, the times of positions count, too: a log may be played faster than it was.

    Examples
    --------
    >>> choice = Choice()
    >>> choice.takes("boat", "gps", 1, 0.0, 0.0), choice.takes("boat", "ais", 1, 1.0, 1.0)
    (True, False)
    >>> choice.takes("boat", "rtk", 0, 2.0, 2.0), choice.takes("boat", "gps", 1, 3.0, 3.0)
    (True, False)
    >>> choice.takes("boat", "gps", 1, 20.0, 20.0)
    True
    """

    def __init__(self) -> None:
        self._held: OrderedDict[str, _Held] = OrderedDict()

    def takes(self, agent: str, source: str, rank: int, time: float, received: float) -> bool:
        """Say whether a position of a source counts; the lower its rank, the better it is."""
        held = self._held.get(agent)
        if held is not None and rank >= held.rank and source != held.source:
            # Clocks of sources differ, so that a better and a worse one would take turns.
            gap = time - held.time if rank == held.rank else 0.0
            if max(gap, received - held.received) <= _HOLD:
                return False
        self._held[agent] = _Held(source, rank, time, received)
        self._held.move_to_end(agent)
        if len(self._held) > _MAX_AGENTS:
            self._held.popitem(last=False)
        return True
