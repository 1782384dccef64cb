"""Paths off the map that are travelled again: edges that the map does not have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.live.events import Event
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.known import Finding, KnownEvents
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.model.projection import map_coordinates

__all__ = ["NewEdges"]

#: Metres of a path, at least: shorter ones are errors of the receiver.
_MIN_LENGTH = 50.0

#: Metres by which two travels of one path differ on average, at most, and as a multiple of the
#: error of the map.
_MAX_DISTANCE, _MAX_ERRORS = 20.0, 4.0

#: Positions at even shares of a path, by which paths are compared.
_POSITIONS = 16

#: Paths that are kept; of more, the one that was travelled least recently is forgotten.
_MAX_PATHS = 500

#: Travels of a path that are kept: late fixes may show that one of the first two was none.
_MAX_TRAVELS = 4

Floats = NDArray[np.float64]


class _Travel(NamedTuple):
    """A path off the map that an agent travelled."""

    time: float
    agent: str
    number: int
    length: float
    path: Floats


class NewEdges:
    """Keeps paths off the map of all agents, and tells those that are travelled again.

    Parameters
    ----------
    known_map : KnownMap
        The map.
    """

    def __init__(self, known_map: KnownMap) -> None:
        self._map = known_map
        self._limit = max(_MAX_DISTANCE, _MAX_ERRORS * known_map.scales.error)
        self._known = KnownEvents("", geographic=known_map.plane is not None)
        self._travels: dict[str, list[_Travel]] = {}
        self._settled = -math.inf

    def take(
        self, agent: str, count: int, paths: Sequence[tuple[Floats, float]], received: float
    ) -> list[Event]:
        """Take paths of an agent; return the events that follow.

        Parameters
        ----------
        agent : str
            Its name.
        count : int
            Paths before these: others did not happen.
        paths : sequence of tuple
            Metres, shape (n, 2), and when each ended in seconds.
        received : float
            When the last fix was received.
        """
        # What did not happen, and what did.
        before = self._travels.get(agent, [])
        travels = [each for each in before if each.number < count]
        for number, (positions, time) in enumerate(paths, count):
            length, path = _sampled(positions)
            if length >= _MIN_LENGTH:
                travels.append(_Travel(time, agent, number, length, path))
        if len(travels) == len(before) and not paths:
            return []
        self._travels[agent] = travels

        # Each path is a new edge when it is travelled the second time.
        groups = self._groups()
        findings = [self._finding(group[1]) for group in groups if len(group) > 1]
        events = self._known.update(findings, received, after=self._settled)
        self._forget(groups)
        return events

    def forget(self, agent: str) -> None:
        """Note that an agent begins anew; what it travelled stays."""
        own = self._travels.pop(agent, [])
        if own:
            settled = self._travels.setdefault("", [])
            settled += [each._replace(number=-1) for each in own]

    def _groups(self) -> list[list[_Travel]]:
        """Travels of each path in the order of time, the path that was travelled first in front."""
        groups: list[list[_Travel]] = []
        firsts = np.zeros((0, _POSITIONS, 2))
        every = [each for travels in self._travels.values() for each in travels]
        for travel in sorted(every, key=lambda each: each[:3]):
            # In either direction, it is one path.
            apart = [
                np.linalg.norm(firsts - path, axis=2).mean(axis=1)
                for path in (travel.path, travel.path[::-1])
            ]
            (same,) = np.nonzero(np.minimum(*apart) <= self._limit)
            if len(same):
                groups[same[0]].append(travel)
                continue
            groups.append([travel])
            firsts = np.append(firsts, travel.path[None], axis=0)
        return groups

    def _forget(self, groups: list[list[_Travel]]) -> None:
        """Forget travels that tell nothing, and paths that were not travelled for longest."""
        groups.sort(key=lambda group: group[-1].time)
        for group in groups[:-_MAX_PATHS]:
            self._settled = max(self._settled, group[-1].time)
        kept = [travel for group in groups[-_MAX_PATHS:] for travel in group[:_MAX_TRAVELS]]
        self._known.forget(self._settled)
        self._travels = {}
        for travel in kept:
            owner = travel.agent if travel.number >= 0 else ""
            self._travels.setdefault(owner, []).append(travel)

    def _finding(self, travel: _Travel) -> Finding:
        line = map_coordinates(travel.path, self._map.plane)
        decimals = 2 if self._map.plane is None else 7
        details = {"length": round(travel.length, 1), "path": line.round(decimals).tolist()}
        place = tuple(line[len(line) // 2].tolist())
        why = f"{travel.length:,.0f} m off the map were travelled twice"
        return Finding("new_edge", travel.time, place, travel.agent, why, details)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        every = [each for travels in self._travels.values() for each in travels]
        return {
            "travels": [[*each[:-1], each.path.tolist()] for each in every],
            "known": self._known.to_rows(),
            "settled": time_to_json(self._settled),
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._travels = {}
        for *facts, path in row["travels"]:
            travel = _Travel._make([*facts, np.array(path, np.float64)])
            owner = travel.agent if travel.number >= 0 else ""
            self._travels.setdefault(owner, []).append(travel)
        self._known.restore(row["known"])
        self._settled = time_from_json(row["settled"])


def _sampled(positions: Floats) -> tuple[float, Floats]:
    """Length of a path in metres, and positions at even shares of it."""
    if len(positions) < 2:
        return 0.0, positions
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    along = np.append(0.0, np.cumsum(steps))
    shares = np.linspace(0.0, along[-1], _POSITIONS)
    path = np.stack([np.interp(shares, along, axis) for axis in positions.T], axis=1)
    return float(along[-1]), path
