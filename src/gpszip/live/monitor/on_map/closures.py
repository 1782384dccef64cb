"""Edges that seem to be closed, by what all agents don't do: as ``gpszip changes`` finds them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from gpszip.history.changes.closures import Closures, choose_threshold, find_closures
from gpszip.history.traversals import Traversals
from gpszip.live.events import Event
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.known import Finding, KnownEvents
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.passes import Pass

__all__ = ["ClosureWatch"]

#: False alarms a day for which the threshold is chosen, as for ``gpszip changes``.
_FALSE_ALARMS = 0.1

#: Share of the threshold from which an edge is suspected to be closed.
_SUSPECTED = 0.6

#: Seconds of the fixes between two looks, at least and at most: one takes 30 ms for a history of
#: 14,000 traversals.
_PERIODS = (60.0, 600.0)

#: Passes after which it is looked again earlier than at most: so many, or this share of the
#: history, so that looking takes a small part of the time.
_MIN_PASSES, _PASSES_SHARE = 20, 0.005

#: Passes of all agents that are kept; of more, the earliest half is forgotten.
_MAX_PASSES = 20_000

#: Numbers of a pass: edge and direction, enter, leave, begin, end, standing, whether it starts.
Row = tuple[int, float, float, float, float, float, bool]


class ClosureWatch:
    """Watches the passes of all agents for edges that they avoid.

    Parameters
    ----------
    known_map : KnownMap
        The map, and what was usual on it.
    """

    def __init__(self, known_map: KnownMap) -> None:
        self._map = known_map
        self._known = KnownEvents("", geographic=known_map.plane is not None)
        self._history = known_map.rows.take(np.isfinite(known_map.rows.enter))
        self._passes: dict[str, list[Row]] = {}
        # Number that the first pass of an agent has among all that it travelled; negative for those
        # from before it was forgotten.
        self._first: dict[str, int] = {}
        self._count = 0
        self._new = 0
        self._last_look = -math.inf

        # Without times, nothing is before or after.
        self._threshold = math.inf
        if len(self._history):
            before = np.ones(len(self._history), np.bool_)
            self._threshold = choose_threshold(
                known_map.network, self._history, before, _FALSE_ALARMS
            )

    def take(self, agent: str, count: int, passes: Sequence[Pass], received: float) -> list[Event]:
        """Take passes of an agent that are over; return the events that follow.

        Parameters
        ----------
        agent : str
            Its name.
        count : int
            Passes before these: others did not happen.
        passes : sequence of Pass
            In the order of travel.
        received : float
            When the last fix was received.
        """
        # What did not happen, as later fixes tell.
        kept = self._passes.get(agent, [])
        number = max(count - self._first.get(agent, 0), 0)
        self._count -= len(kept[number:])
        del kept[number:]

        # What did.
        events: list[Event] = []
        for passed in passes:
            self._passes.setdefault(agent, []).append(self._row(passed))
            self._count += 1
            self._new += 1
            events += self._look_sometimes(passed.leave, received)
        return events

    def forget(self, agent: str) -> None:
        """Note that an agent begins anew; its passes stay."""
        self._first[agent] = -len(self._passes.get(agent, []))
        if not self._first[agent]:
            del self._first[agent]

    def _row(self, passed: Pass) -> Row:
        return (
            passed.directed,
            passed.enter,
            passed.leave,
            self._map.offset(passed.directed, passed.begin),
            self._map.offset(passed.directed, passed.along),
            passed.standing,
            passed.starts,
        )

    def _look_sometimes(self, time: float, received: float) -> list[Event]:
        """Look again after many passes, or much time."""
        since = time - self._last_look
        many = max(_MIN_PASSES, _PASSES_SHARE * len(self._history))
        is_soon = since < _PERIODS[0] or (since < _PERIODS[1] and self._new < many)
        # A clock that is ahead puts looks off, but not the limit of what is kept.
        if is_soon and self._count <= _MAX_PASSES:
            return []
        self._last_look, self._new = time, 0
        return self.look(received)

    def look(self, received: float) -> list[Event]:
        """Compare what is known of all edges with what was told."""
        after = self._forget() if self._count > _MAX_PASSES else -math.inf
        if not self._count or math.isinf(self._threshold):
            return []

        # Suspected edges first: without evidence for one of them, none is closed.
        rows, is_live = self._rows()
        network = self._map.network
        suspected = find_closures(network, rows, is_live, _SUSPECTED * self._threshold)
        closed: Closures | None = None
        if (suspected.evidence >= self._threshold).any():
            closed = find_closures(network, rows, is_live, self._threshold)

        # What differs from what was told.
        events = self._known.update(self._findings(suspected, closed), received, after=after)
        if math.isfinite(after):
            self._known.forget(after)
        return events

    def _findings(self, suspected: Closures, closed: Closures | None) -> list[Finding]:
        # What was passed again before it was sure was never closed.
        alarms = [] if closed is None else _alarms(closed)
        sure = {(row["directed"], row["since"]) for row in alarms}
        findings = [
            self._finding("closed.suspected", row["detected"], row)
            for row in _alarms(suspected)
            if math.isnan(row["reopened"]) or (row["directed"], row["since"]) in sure
        ]

        # Those that are sure, and which of them are open again.
        for row in alarms:
            findings.append(self._finding("closed", row["detected"], row))
            if not math.isnan(row["reopened"]):
                findings.append(self._finding("reopened", row["reopened"], row))
        return findings

    def _finding(self, kind: str, time: float, row: dict[str, Any]) -> Finding:
        # An edge that was passed again is open, without a doubt.
        directed = row["directed"]
        place = self._map.place_on(directed, 0.5 * float(self._map.lengths[directed >> 1]))
        if kind == "reopened":
            details = {"since": round(row["since"], 3)}
            why = "an agent travelled it again"
            return Finding(kind, time, place, str(directed), why, details, directed)

        # Evidence of e nats is chance with a probability of exp(-e).
        why = f"{row['missed']:,} times in a row, agents went another way"
        details = {"since": round(row["since"], 3), "missed": row["missed"]}
        nats = self._threshold * (_SUSPECTED if kind == "closed.suspected" else 1.0)
        return Finding(
            kind, time, place, str(directed), why, details, directed, confidence=1 - math.exp(-nats)
        )

    def _rows(self) -> tuple[Traversals, np.ndarray[Any, np.dtype[np.bool_]]]:
        """The history, and after it the passes of each agent; and which rows are passes."""
        # Each agent is a track after those of the history.
        history, first = self._history, len(self._history.ids)
        table = [row for passes in self._passes.values() for row in passes]
        track = np.repeat(
            np.arange(first, first + len(self._passes)),
            [len(passes) for passes in self._passes.values()],
        )

        # Columns of the passes, behind those of the history.
        directed, enter, leave, begin, end, standing, starts = (
            np.array(column) for column in zip(*table, strict=True)
        )
        rows = Traversals(
            ids=(*history.ids, *self._passes),
            track=np.append(history.track, track.astype(np.int32)),
            edge=np.append(history.edge, directed >> 1),
            forward=np.append(history.forward, directed & 1 == 0),
            enter=np.append(history.enter, enter),
            leave=np.append(history.leave, leave),
            begin=np.append(history.begin, begin),
            end=np.append(history.end, end),
            standing=np.append(history.standing, standing),
            starts=np.append(history.starts, starts),
        )
        return rows, np.arange(len(rows)) >= len(history)

    def _forget(self) -> float:
        """Forget the earliest half of all passes; return the time up to which that is."""
        # What is later is kept.
        times = [row[1] for passes in self._passes.values() for row in passes]
        limit = float(np.median(times))
        for agent, passes in list(self._passes.items()):
            kept = [row for row in passes if row[1] > limit]
            self._first[agent] = self._first.get(agent, 0) + len(passes) - len(kept)
            if kept:
                # The first one does not go on from any that is left.
                self._passes[agent] = [(*kept[0][:-1], True), *kept[1:]]
            else:
                del self._passes[agent]
        self._count = sum(map(len, self._passes.values()))

        # Agents that are forgotten and of which no pass is left count from 0 again.
        self._first = {agent: first for agent, first in self._first.items() if first}
        return limit

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "passes": self._passes,
            "first": self._first,
            "known": self._known.to_rows(),
            "last": time_to_json(self._last_look),
            "new": self._new,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._passes = {
            agent: [(int(each[0]), *each[1:]) for each in passes]
            for agent, passes in row["passes"].items()
        }
        self._first = dict(row["first"])
        self._count = sum(map(len, self._passes.values()))
        self._known.restore(row["known"])
        self._last_look = time_from_json(row["last"])
        self._new = row["new"]


def _alarms(closures: Closures) -> list[dict[str, Any]]:
    names = ("directed", "since", "detected", "missed", "reopened")
    columns = [getattr(closures, name).tolist() for name in names]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
