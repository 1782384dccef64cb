"""Where an agent seems to go, when it arrives, and whether it is late."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from typing import Any

from gpszip.errors import OptionError
from gpszip.history.prediction.read_route import tell_route
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.text import duration_text
from gpszip.model.prediction import TripArrival

__all__ = ["Outlook"]

#: Seconds between two predictions for one agent, at least.
_PERIOD = 30.0

#: Least probability of a destination that is told.
_MIN_PROBABILITY = 0.3

#: Least probability of a destination at which an agent can be late.
_SURE = 0.7

#: Seconds that it takes at most, mostly, until an arrival is certain.
_SOME_TIME = 60.0

#: Seconds, and share of the way that remains, by which an arrival changes before it is told again.
_MIN_CHANGE, _CHANGE_SHARE = 120.0, 0.25

#: Edges of a trip that predictions look back on.
_MAX_ROUTE = 100


@dataclass(frozen=True)
class _Goal:
    """Where an agent was told to go.

    Parameters
    ----------
    node : int
        Node of the map.
    probability : float
        How sure that was.
    first_expected, expected : float
        Seconds at which it was first expected there, and last.
    latest : float or None
        Seconds after which it is late; None where its goal was not sure.
    """

    node: int
    probability: float
    first_expected: float
    expected: float
    latest: float | None


class Outlook:
    """Predicts the trip of one agent, and tells what changes in it.

    Parameters
    ----------
    agent : str
        Its name.
    known_map : KnownMap
        What is known.
    """

    def __init__(self, agent: str, known_map: KnownMap) -> None:
        self._agent, self._map = agent, known_map
        self.route: list[int] = []
        self.times: list[float] = []
        self._last = float("-inf")
        self._goal: _Goal | None = None
        self._path: tuple[int, list[int]] | None = None
        self._is_late = False

    def end_trip(self) -> None:
        """Forget the trip, which is over."""
        self.route.clear()
        self.times.clear()
        self._last, self._goal, self._path = float("-inf"), None, None
        self._is_late = False

    def enter(self, directed: int, time: float, *, starts: bool) -> list[Finding]:
        """Take an edge that was entered; return what is new."""
        if starts:
            self.route.clear()
            self.times.clear()
        self.route.append(directed)
        self.times.append(time)
        del self.route[:-_MAX_ROUTE], self.times[:-_MAX_ROUTE]

        # Past its goal, it has another one.
        goal = self._goal
        passed = self.route[-2:-1]
        if goal is not None and passed and self._map.exits.heads[passed[0]] == goal.node:
            self._goal = None
        if time - self._last < _PERIOD:
            return []
        self._last = time
        return self._predict(time)

    def pass_time(self, time: float, position: tuple[float, ...]) -> list[Finding]:
        """Return that the agent is late, if it is now."""
        goal = self._goal
        if goal is None or self._is_late or goal.latest is None:
            return []
        if time <= goal.latest + _SOME_TIME:
            return []
        self._is_late = True
        details = {
            "node": goal.node,
            "first_expected": round(goal.first_expected, 3),
            "expected": round(max(goal.expected, time), 3),
        }
        why = f"{duration_text(time - goal.first_expected)} after it was first expected"
        return [Finding("late", time, position, "", why, details, confidence=goal.probability)]

    def _predict(self, time: float) -> list[Finding]:
        goal, predictor = self._goal, self._map.predictor
        route = list(tell_route(self.route))
        likely = predictor.destination(route, time, self._agent, count=1)
        if not likely or likely[0].probability < _MIN_PROBABILITY:
            return []
        node, probability = likely[0]
        arrival = self._arrival(route, node, time)
        if arrival is None:
            return []

        # Only what differs from what was told.
        expected = time + arrival.seconds
        least = max(_MIN_CHANGE, _CHANGE_SHARE * arrival.seconds)
        if goal is not None and goal.node == node and abs(goal.expected - expected) < least:
            return []
        if goal is None or goal.node != node:
            is_sure = probability >= _SURE
            latest = time + arrival.high if is_sure else None
            self._goal = _Goal(node, probability, expected, expected, latest)
            self._is_late = False
        else:
            self._goal = replace(goal, expected=expected)
        return [self._finding(time, node, probability, arrival)]

    def _arrival(self, route: list[tuple[int, bool]], node: int, time: float) -> TripArrival | None:
        """When the agent arrives at a node; None if no path leads there."""
        # As long as it follows the path that was found, none is sought anew.
        path = self._path
        goal: Any = node
        if path is not None and path[0] == node and self.route[-1] in path[1]:
            following = path[1][path[1].index(self.route[-1]) + 1 :]
            goal = list(tell_route(following)) or node
        length = float(self._map.lengths[self.route[-1] >> 1])
        try:
            arrival = self._map.predictor.arrival(
                route, goal, time, self._agent, times=self.times, metres_left=length
            )
        except OptionError:
            return None
        self._path = node, [2 * edge + (not forward) for edge, forward in arrival.route]
        return arrival

    def _finding(self, time: float, node: int, probability: float, arrival: TripArrival) -> Finding:
        # Edges that may follow.
        following = self._map.predictor.next(list(tell_route(self.route)), time, self._agent)
        options = [
            {"edge": each.edge, "forward": each.forward, "probability": round(each.probability, 3)}
            for each in following[:3]
        ]

        # Where it goes, and when it arrives.
        details = {
            "node": node,
            "arrival": round(time + arrival.seconds, 3),
            "low": round(time + arrival.low, 3),
            "high": round(time + arrival.high, 3),
            "metres": round(arrival.metres, 1),
            "next": options,
        }
        why = f"{probability:.0%} of trips like this one ended there"
        place = self._map.node_position(node)
        return Finding("predicted", time, place, "", why, details, confidence=probability)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "route": self.route,
            "times": self.times,
            "last": time_to_json(self._last),
            "goal": None if self._goal is None else astuple(self._goal),
            "path": self._path,
            "late": self._is_late,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self.route, self.times = list(row["route"]), list(row["times"])
        self._last = time_from_json(row["last"])
        self._goal = None if row["goal"] is None else _Goal(*row["goal"])
        self._path = None if row["path"] is None else (row["path"][0], row["path"][1])
        self._is_late = row["late"]
