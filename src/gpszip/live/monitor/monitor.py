"""Monitor: takes fixes of any number of agents as they come, and returns events."""

from __future__ import annotations

import heapq
import math
import os
from collections import Counter, OrderedDict
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gpszip.errors import OptionError
from gpszip.history.stays.values import Settings
from gpszip.live.events import Event
from gpszip.live.fix import Fix
from gpszip.live.monitor.agent import AgentMonitor
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.sources import MAX_AHEAD

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.live.monitor.on_map.known_map import KnownMap
    from gpszip.live.monitor.on_map.watch import MapWatch
    from gpszip.model.match import Scales

__all__ = ["Monitor"]

#: Fixes kept for one agent, at most and at least, and those of all agents.
_MAX_FIXES = 10_000
_MIN_FIXES = 250
_MAX_ALL_FIXES = 4_000_000

#: Agents that are followed on the map at once, with 60 kB each; others begin anew there.
_MAX_MATCHERS = 4_000


class Monitor:
    """Finds events in the fixes of many agents while they come.

    Fixes wait for a moment, so that those which come a little late take their place in time. Fixes
    that come later still correct what was told: then an event revises or withdraws another one.
    Events depend on the fixes and on when they were received, and not on how often time is told.
    Memory is bounded: an agent has at most 10,000 fixes, thinned where they are near in time, and
    of too many agents the one that was heard of least recently is forgotten.

    Parameters
    ----------
    archive : Archive or path, optional
        What is known of the map: then agents are followed on its edges.
    scales : Scales, optional
        Error and speeds of the fixes on that map; by default what the archive suggests.
    delay : float, default 10.0
        Seconds for which a fix waits for earlier ones.
    silent_after : float, default 3600.0
        Seconds without a fix after which an agent is silent.
    min_stay : float, default 300.0
        Seconds; shorter stops are no stays, as in :func:`gpszip.trips`.
    max_pause : float, default 900.0
        Seconds; shorter stays on the way of a trip don't end it.
    radius : float, default 100.0
        Metres around the centre of a place that belong to it.
    max_agents : int, default 10000
        Agents that are known at once.

    Raises
    ------
    OptionError
        If a number can't be used.

    Examples
    --------
    >>> from gpszip import Fix
    >>> monitor = Monitor()
    >>> events = []
    >>> for t in range(0, 1500, 10):
    ...     place = (48.0, 11.5 + max(t - 900, 0) * 1e-4)
    ...     events += monitor.push(Fix("ann", "gpsd", 1.8e9 + t, 1.8e9 + t, place))
    >>> events += monitor.close()
    >>> [(event.kind, round(event.time - 1.8e9)) for event in events if event.revises is None]
    [('stay.start', 0), ('stay.end', 900), ('trip.start', 900)]
    """

    def __init__(
        self,
        archive: Archive | str | os.PathLike[str] | None = None,
        *,
        scales: Scales | None = None,
        delay: float = 10.0,
        silent_after: float = 3600.0,
        min_stay: float = 300.0,
        max_pause: float = 900.0,
        radius: float = 100.0,
        max_agents: int = 10_000,
    ) -> None:
        # Numbers that make sense.
        numbers = {"silent_after": silent_after, "min_stay": min_stay, "max_pause": max_pause}
        for name, number in {**numbers, "radius": radius, "max_agents": max_agents}.items():
            if not 0 < number < math.inf:
                raise OptionError(f"{name} is {number:g}", remedy="it must be a positive number")
        if not 0 <= delay < math.inf:
            raise OptionError(f"delay is {delay:g}", remedy="it must be a number from 0 on")
        self._delay, self._silent_after, self._max_agents = delay, silent_after, max_agents
        self._settings = Settings(min_stay, max_pause, radius)
        self._map: KnownMap | None = None
        self._watch: MapWatch | None = None
        if archive is not None:
            self._map, self._watch = _read_map(archive, scales)

        # Agents, the least recently heard of first; those that are not silent; those on the map.
        self._agents: OrderedDict[str, AgentMonitor] = OrderedDict()
        self._heard: OrderedDict[str, None] = OrderedDict()
        self._followed: OrderedDict[str, None] = OrderedDict()

        # Those whose fixes wait, by when something is to be done, and when that is.
        self._queue: list[tuple[float, str]] = []
        self._due: dict[str, float] = {}
        self._clock = -math.inf

        #: Number of the last event.
        self.seq = 0
        #: What was left out, and how often.
        self.counts: Counter[str] = Counter()

    def push(self, fix: Fix) -> list[Event]:
        """Take a fix; return the events that follow from it.

        A fix that can't be used, such as one from the future, is left out and counted.
        """
        events = list(self._advance(fix.received))
        agent = self._agent(fix)
        if agent is None:
            return self._numbered(events)
        if fix.time - fix.received > MAX_AHEAD:
            self.counts["times more than a day in the future left out"] += 1
            return self._numbered([*events, *agent.refuse(fix.time, fix.received)])

        # In time, or late.
        if fix.time <= agent.buffer.released:
            self._take_late(agent, fix)
        else:
            agent.buffer.add(fix)
            events += self._release(agent)
        return self._numbered(events)

    def late(self, fix: Fix) -> list[Event]:
        """Take a fix that is known to be late, such as one of a log that is found afterwards.

        It corrects what was told of the past, but does not say that the agent was heard of.
        """
        agent = self._agents.get(fix.agent)
        if agent is None or fix.time > agent.buffer.released or not self._is_usable(fix):
            return self.push(fix)
        self._take_late(agent, fix)
        return []

    def tick(self, now: float) -> list[Event]:
        """Return the events that follow from the time that passed.

        Parameters
        ----------
        now : float
            Seconds, as times of receipt are counted.
        """
        return self._numbered(self._advance(now))

    def resume(self, now: float) -> None:
        """Note that nobody listened since the state was saved: no agent was silent by that.

        Parameters
        ----------
        now : float
            Seconds, as times of receipt are counted.
        """
        missed = max(now - self._clock, 0.0)
        if math.isfinite(missed):
            for name in self._heard:
                self._agents[name].received += missed

    def refuse(self, agent: str, time: float, received: float) -> list[Event]:
        """Note that a fix of a known agent was refused for its time; return the events."""
        known = self._agents.get(agent)
        return [] if known is None else self._numbered(known.refuse(time, received))

    def close(self) -> list[Event]:
        """Return what follows from all fixes so far. What goes on is not ended by that."""
        events: list[Event] = []
        for agent in self._agents.values():
            for fix in agent.buffer.flush():
                events += self._use(agent, fix)
            events += agent.read(self._clock, goes_on=False)
            if agent.on_map is not None:
                events += agent.on_map.rest(self._clock, is_over=False)
            events += self._watch_travel(agent)
        if self._watch is not None:
            events += self._watch.closures.look(self._clock)
        self._queue.clear()
        self._due.clear()
        return self._numbered(events)

    async def follow(self, fixes: AsyncIterable[Fix]) -> AsyncIterator[Event]:
        """Yield the events of fixes as they come, and then those of :meth:`close`."""
        async for fix in fixes:
            for event in self.push(fix):
                yield event
        for event in self.close():
            yield event

    def states(self) -> Iterator[dict[str, Any]]:
        """Yield the state as values of JSON: first of the monitor, then of each agent."""
        watch = None if self._watch is None else self._watch.to_row()
        head = {"clock": time_to_json(self._clock), "seq": self.seq, "watch": watch}
        yield head | {"map": None if self._map is None else self._map.fingerprint}
        for agent in self._agents.values():
            yield agent.to_row() | {"heard": agent.agent in self._heard}

    def restore(self, states: Iterable[dict[str, Any]]) -> None:
        """Take over what :meth:`states` yielded; on another map, agents begin anew there."""
        # The monitor.
        rows = iter(states)
        head = next(rows)
        is_same_map = self._map is not None and head["map"] == self._map.fingerprint
        self._clock = time_from_json(head["clock"])
        self.seq = head["seq"]
        if self._watch is not None and is_same_map:
            self._watch.restore(head["watch"])

        # Each agent, and what is to be done for it.
        for row in rows:
            agent = self._new_agent(row["agent"], geographic=row["geographic"])
            agent.restore(row if is_same_map else row | {"on_map": None})
            name = agent.agent
            if row["heard"]:
                self._heard[name] = None
            if agent.on_map is not None and agent.on_map.has_matcher:
                self._followed[name] = None
            self._wait(agent)

    def _agent(self, fix: Fix) -> AgentMonitor | None:
        """The agent of a fix, which was heard of now; None if the fix can't be used."""
        if not self._is_usable(fix):
            self.counts["fixes that are no positions left out"] += 1
            return None
        agent = self._agents.get(fix.agent)
        if agent is None:
            agent = self._new_agent(fix.agent, geographic=fix.geographic)
        elif agent.geographic != fix.geographic:
            self.counts["positions that are not like the agent's others left out"] += 1
            return None

        # Of too many, the one that was heard of least recently is forgotten.
        self._agents.move_to_end(fix.agent)
        self._heard[fix.agent] = None
        self._heard.move_to_end(fix.agent)
        agent.received = self._clock
        if len(self._agents) > self._max_agents:
            name, _ = self._agents.popitem(last=False)
            for group in (self._heard, self._due, self._followed):
                group.pop(name, None)
            if self._watch is not None:
                self._watch.forget(name)
            self.counts["agents forgotten"] += 1
        return agent

    def _is_usable(self, fix: Fix) -> bool:
        numbers = (fix.time, fix.received, *fix.position)
        if not all(map(math.isfinite, numbers)) or len(fix.position) < 2:
            return False
        return not fix.geographic or (abs(fix.position[0]) <= 90 and abs(fix.position[1]) <= 180)

    def _new_agent(self, name: str, *, geographic: bool) -> AgentMonitor:
        agent = self._agents[name] = AgentMonitor(
            name,
            geographic=geographic,
            delay=self._delay,
            silent_after=self._silent_after,
            settings=self._settings,
            known_map=self._map,
        )
        return agent

    def _take_late(self, agent: AgentMonitor, fix: Fix) -> None:
        if agent.take_late(fix):
            self._wait(agent)
            self.counts["late fixes put into their place"] += 1
            if not agent.is_in_time_for_map(fix):
                self.counts["late fixes too old to correct events on the map"] += 1
        else:
            self.counts["fixes too late to correct events"] += 1

    def _release(self, agent: AgentMonitor) -> Iterator[Event]:
        """Use the fixes of an agent that have waited long enough."""
        for fix in agent.buffer.ready(self._clock):
            yield from self._use(agent, fix)
        self._wait(agent)

    def _wait(self, agent: AgentMonitor) -> None:
        """Note when something is to be done for an agent next."""
        name, due = agent.agent, min(agent.buffer.due, agent.reading_due)
        if due < self._due.get(name, math.inf):
            self._due[name] = due
            heapq.heappush(self._queue, (due, name))

    def _use(self, agent: AgentMonitor, fix: Fix) -> Iterator[Event]:
        if not agent.is_usable(fix):
            self.counts["fixes of another source or epoch left out"] += 1
            return
        capacity = _MAX_ALL_FIXES // max(len(self._agents), 1)
        yield from agent.take(fix, min(max(capacity, _MIN_FIXES), _MAX_FIXES))
        if agent.on_map is not None:
            yield from self._watch_travel(agent)
            if agent.on_map.has_matcher:
                yield from self._follow_on_map(agent.agent)

    def _watch_travel(self, agent: AgentMonitor) -> Iterator[Event]:
        """Compare what an agent has travelled with what others have."""
        if agent.on_map is not None and self._watch is not None:
            yield from self._watch.take(agent.agent, agent.on_map, self._clock)

    def _follow_on_map(self, name: str) -> Iterator[Event]:
        """Note that an agent is followed; of too many, the first one's matcher is dropped."""
        self._followed[name] = None
        self._followed.move_to_end(name)
        if len(self._followed) > _MAX_MATCHERS:
            other, _ = self._followed.popitem(last=False)
            on_map = self._agents[other].on_map
            if on_map is not None:
                yield from on_map.drop_matcher(self._clock)

    def _advance(self, now: float) -> Iterator[Event]:
        """Let time pass up to now, and do what is due in the order of time."""
        while True:
            # The agent for which something is due first, and the first that falls silent.
            due, name = self._queue[0] if self._queue else (math.inf, "")
            silent = next(iter(self._heard), "")
            silent_due = math.inf
            if silent:
                silent_due = self._agents[silent].received + self._silent_after
            if min(due, silent_due) > now or silent_due == now < due:
                break
            self._clock = max(self._clock, min(due, silent_due))

            # Fixes have waited long enough, or late ones are read; else one is silent.
            if due <= silent_due:
                heapq.heappop(self._queue)
                if self._due.get(name) == due:
                    yield from self._attend(self._agents[name])
                continue
            del self._heard[silent]
            yield from self._agents[silent].fall_silent(self._clock)
            yield from self._watch_travel(self._agents[silent])
        self._clock = max(self._clock, now)

    def _attend(self, agent: AgentMonitor) -> Iterator[Event]:
        """Do what is due for an agent."""
        del self._due[agent.agent]
        yield from self._release(agent)
        if agent.reading_due <= self._clock:
            yield from agent.read(self._clock)
            yield from self._watch_travel(agent)
            self._wait(agent)

    def _numbered(self, events: Iterable[Event]) -> list[Event]:
        found = []
        for event in events:
            self.seq += 1
            found.append(replace(event, seq=self.seq))
        return found


def _read_map(
    archive: Archive | str | os.PathLike[str], scales: Scales | None
) -> tuple[KnownMap, MapWatch]:
    """Read what is known of a map; without one, none of the kernels that it needs are loaded."""
    from gpszip.archive import Archive, open_archive
    from gpszip.live.monitor.on_map.known_map import KnownMap
    from gpszip.live.monitor.on_map.watch import MapWatch

    known = archive if isinstance(archive, Archive) else open_archive(archive)
    known_map = KnownMap(known, scales)
    return known_map, MapWatch(known_map)
