"""Where an agent seems to go, when it arrives, and whether it is late."""

from __future__ import annotations

from typing import Any

from gpszip.errors import OptionError
from gpszip.history.prediction.read_route import tell_route
from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.text import duration_text

__all__ = ["Outlook"]

#: Seconds between two predictions for one agent, at least.
_PERIOD = 30.0

#: Least probability of a destination that is told.
_MIN_PROBABILITY = 0.3

#: Seconds, and share of the way that remains, by which an arrival changes before it is told again.
_MIN_CHANGE, _CHANGE_SHARE = 120.0, 0.25

#: Edges of a trip that predictions look back on.
_MAX_ROUTE = 100


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
        self._told: tuple[int, float] | None = None
        self._deadline: float | None = None
        self._is_late = False

    def end_trip(self) -> None:
        """Forget the trip, which is over."""
        self.route.clear()
        self.times.clear()
        self._last, self._told, self._deadline = float("-inf"), None, None
        self._is_late = False

    def enter(self, directed: int, time: float, *, starts: bool) -> list[Finding]:
        """Take an edge that was entered; return what is new."""
        if starts:
            self.route.clear()
            self.times.clear()
        self.route.append(directed)
        self.times.append(time)
        del self.route[:-_MAX_ROUTE], self.times[:-_MAX_ROUTE]
        if time - self._last < _PERIOD:
            return []
        self._last = time
        return self._predict(time)

    def pass_time(self, time: float, position: tuple[float, ...]) -> list[Finding]:
        """Return that the agent is late, if it is now."""
        if self._deadline is None or self._is_late or time <= self._deadline:
            return []
        self._is_late = True
        assert self._told is not None
        node, arrival = self._told
        details = {"node": node, "expected": round(arrival, 3), "until": round(self._deadline, 3)}
        why = f"{duration_text(time - arrival)} after it was expected"
        return [Finding("late", time, position, "", why, details)]

    def _predict(self, time: float) -> list[Finding]:
        route, predictor = list(tell_route(self.route)), self._map.predictor
        likely = predictor.destination(route, time, self._agent, count=1)
        if not likely or likely[0].probability < _MIN_PROBABILITY:
            return []
        node, probability = likely[0]
        length = float(self._map.lengths[self.route[-1] >> 1])
        try:
            arrival = predictor.arrival(
                route, node, time, self._agent, times=self.times, metres_left=length
            )
        except OptionError:
            # No path leads there.
            return []

        # Only what differs from what was told.
        expected, told = time + arrival.seconds, self._told
        least = max(_MIN_CHANGE, _CHANGE_SHARE * arrival.seconds)
        if told is not None and told[0] == node and abs(told[1] - expected) < least:
            return []
        if told is None or told[0] != node:
            self._deadline, self._is_late = time + arrival.high, False
        self._told = node, expected
        return [self._finding(time, node, probability, arrival)]

    def _finding(self, time: float, node: int, probability: float, arrival: Any) -> Finding:
        following = self._map.predictor.next(list(tell_route(self.route)), time, self._agent)
        options = [
            {"edge": each.edge, "forward": each.forward, "probability": round(each.probability, 3)}
            for each in following[:3]
        ]
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
            "last": self._last if self.route else None,
            "told": self._told,
            "deadline": self._deadline,
            "late": self._is_late,
        }

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self.route, self.times = list(row["route"]), list(row["times"])
        self._last = float("-inf") if row["last"] is None else row["last"]
        self._told = None if row["told"] is None else tuple(row["told"])
        self._deadline, self._is_late = row["deadline"], row["late"]
