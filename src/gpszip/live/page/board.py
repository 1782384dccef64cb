"""The board: the newest state of all agents, the last events, and what changed since when.

A client has a cursor, and asks for what changed since. So a slow one gets the newest state, and
there is no queue for anybody.
"""

from __future__ import annotations

import time
from array import array
from collections import OrderedDict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice, takewhile

from gpszip.live.events import Event
from gpszip.live.fix import Fix, Marks

__all__ = ["TAIL_SECONDS", "AgentState", "Board"]

#: Agents that are known; of more, the one that was heard of least recently is forgotten.
_MAX_AGENTS = 10_000

#: Seconds of an agent's way that are kept.
TAIL_SECONDS = 900.0

#: Seconds in which of many points two are kept.
_SPACING = 12.0

#: Points of a way: 24 bytes each, 24 MB of all agents.
_MAX_TAIL = 100

#: Events that are kept; those that come with all travel on a map are kept apart from others.
_MAX_EVENTS = 500

#: Kinds of events that come with all travel on a map.
_ROUTINE = frozenset({"edge.enter", "edge.leave", "predicted"})

#: Kinds of events after which a prediction no longer holds.
_ENDS = frozenset({"stay.start", "trip.end", "silent", "off_map.start"})

#: Times below are seconds since some other zero than 1970, which may begin anew.
_FIRST_DATE = 1e8

#: Numbers of a point of a tail: time and two coordinates.
_POINT = 3


@dataclass(slots=True)
class AgentState:
    """What is known of an agent.

    Parameters
    ----------
    fix : Fix
        The latest in time.
    heard : float
        When any fix of it was stored last, in seconds since 1970.
    revision : int
        Number of the last change among those of all agents.
    before : int
        Number of the change before that.
    tail : array of float
        Time and two coordinates of each point of its way.
    outlook : Event, optional
        Where it goes, as it was predicted last.
    """

    fix: Fix
    heard: float
    revision: int = 0
    before: int = 0
    tail: array[float] = field(default_factory=lambda: array("d"))
    outlook: Event | None = None

    def take(self, fix: Fix) -> None:
        """Take a fix; an earlier one than the latest changes nothing, unless time began anew."""
        is_new = not self.tail
        if fix.time < self.fix.time and not is_new:
            if fix.time >= _FIRST_DATE:
                return
            del self.tail[:]
        if Marks.BREAK in fix.quality:
            del self.tail[:]
        self.fix = fix
        self._lengthen(fix)

    def _lengthen(self, fix: Fix) -> None:
        """Add a point to the tail; points that are near in time are one."""
        tail = self.tail
        if len(tail) > _POINT and fix.time - tail[-2 * _POINT] < _SPACING:
            del tail[-_POINT:]
        tail.extend((fix.time, fix.position[0], fix.position[1]))

        # What is too long ago, or too much.
        first = fix.time - TAIL_SECONDS
        while tail[0] < first or len(tail) > _POINT * _MAX_TAIL:
            del tail[:_POINT]


class Board:
    """What a page shows, within bounds of memory.

    It is an ``EventSink``, and takes the fixes that a recorder stores.

    Attributes
    ----------
    revision : int
        Number of the last change of an agent.
    number : int
        Number of the last event.

    Examples
    --------
    >>> board = Board()
    >>> board.take([Fix("ann", "gpsd", 7.0, 8.0, (48.1, 11.5))])
    >>> agents, cursor = board.agents_since(0, 100)
    >>> [agent.fix.agent for agent in agents], board.agents_since(cursor, 100)
    (['ann'], ([], 1))
    """

    def __init__(self) -> None:
        # Those that changed last are at the end.
        self._agents: OrderedDict[str, AgentState] = OrderedDict()
        self._events: deque[tuple[int, Event]] = deque(maxlen=_MAX_EVENTS)
        self._routine: deque[tuple[int, Event]] = deque(maxlen=_MAX_EVENTS)
        self.revision = self.number = 0

    def __len__(self) -> int:
        return len(self._agents)

    def take(self, fixes: Sequence[Fix]) -> None:
        """Take fixes that were stored."""
        heard = time.time()
        for fix in fixes:
            self.revision += 1
            agent = self._agents.get(fix.agent)
            if agent is None:
                agent = self._agents[fix.agent] = AgentState(fix, heard)
            agent.take(fix)
            agent.heard, agent.before, agent.revision = heard, agent.revision, self.revision
            self._agents.move_to_end(fix.agent)
        while len(self._agents) > _MAX_AGENTS:
            self._agents.popitem(last=False)

    async def send(self, events: Sequence[Event]) -> None:
        """Take events."""
        for event in events:
            self.number += 1
            kept = self._routine if event.kind in _ROUTINE else self._events
            kept.append((self.number, event))
            agent = self._agents.get(event.agent)
            if agent is not None:
                agent.outlook = _outlook_after(agent.outlook, event)

    def agents_since(self, cursor: int, count: int) -> tuple[list[AgentState], int]:
        """Return agents that changed after a cursor, the first to change first, and a new cursor.

        Parameters
        ----------
        cursor : int
            What the last call returned; 0 for all agents.
        count : int
            Agents at most: others come with the next call.
        """
        newest = reversed(self._agents.values())
        changed = list(takewhile(lambda agent: agent.revision > cursor, newest))
        agents = changed[: -count - 1 : -1]
        return agents, agents[-1].revision if agents else cursor

    def events_since(self, number: int) -> tuple[list[tuple[int, Event]], bool]:
        """Return the events after one, with their numbers, and whether all are there."""
        found = [each for kept in (self._events, self._routine) for each in _after(kept, number)]
        return sorted(found, key=lambda pair: pair[0]), len(found) == self.number - number

    def recent_agents(self, count: int) -> Iterator[AgentState]:
        """Yield the agents that were heard of last."""
        yield from islice(reversed(self._agents.values()), count)


def _after(kept: deque[tuple[int, Event]], number: int) -> Iterator[tuple[int, Event]]:
    return takewhile(lambda pair: pair[0] > number, reversed(kept))


def _outlook_after(known: Event | None, event: Event) -> Event | None:
    """Where an agent goes once something happened to it."""
    if event.kind == "predicted":
        return None if event.withdrawn else event
    is_over = event.kind in _ENDS and not event.withdrawn
    return None if is_over and (known is None or event.time >= known.time) else known
