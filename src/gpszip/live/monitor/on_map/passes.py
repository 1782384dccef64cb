"""From matched positions to passes: which edges an agent travels, and when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gpszip.history.prediction.paths import connect_roads
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.matching.live import FinalisedPosition

__all__ = ["Pass", "PassReader", "Step"]

#: Positions in a row off the map, or on it, before that counts: single ones are errors.
_MIN_OFF, _MIN_ON = 3, 2

#: Share of an edge by which an agent falls back on it if it has gone round.
_AGAIN = 0.5

#: Metres per second below which an agent stands.
_STANDING = 0.5


@dataclass
class Pass:
    """An edge that an agent travels.

    Parameters
    ----------
    directed : int
        Twice the edge, plus 1 if it is travelled backward.
    enter : float
        Seconds.
    begin : float
        Metres along the edge at which it begins.
    starts : bool
        Whether it does not go on from the one before.
    along : float
        Metres along the edge that were reached.
    leave : float
        Seconds at which that was.
    standing : float
        Seconds in which the agent stood.
    """

    directed: int
    enter: float
    begin: float
    starts: bool
    along: float
    leave: float
    standing: float = 0.0

    @property
    def metres(self) -> float:
        """Metres travelled."""
        return abs(self.along - self.begin)


@dataclass(frozen=True)
class Step:
    """What a matched position tells.

    Parameters
    ----------
    left : tuple of Pass
        Passes that are over, in the order of travel.
    entered : Pass, optional
        One that began.
    off : float, optional
        When the agent left the map.
    on : float, optional
        When it was back.
    """

    left: tuple[Pass, ...] = ()
    entered: Pass | None = None
    off: float | None = None
    on: float | None = None


class PassReader:
    """Reads the passes of one agent.

    Parameters
    ----------
    known_map : KnownMap
        The edges.
    """

    def __init__(self, known_map: KnownMap) -> None:
        self._map = known_map
        self.current: Pass | None = None
        self.is_off = False
        self._off_times: list[float] = []
        self._on_count = 0

    def read(self, found: FinalisedPosition) -> Step:
        """Take the next matched position; return what it tells."""
        if found.edge < 0:
            return self._read_off(found.time)

        # Back on the map, if a second position confirms it.
        on = None
        self._off_times.clear()
        if self.is_off:
            self._on_count += 1
            if self._on_count < _MIN_ON:
                return Step()
            self.is_off, on = False, found.time
        return self._read_on(found, on)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {
            "current": None if self.current is None else asdict(self.current),
            "off": self.is_off,
            "off_times": self._off_times,
            "on_count": self._on_count,
        }

    def restore(self, row: Mapping[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self.current = None if row["current"] is None else Pass(**row["current"])
        self.is_off, self._on_count = row["off"], row["on_count"]
        self._off_times = list(row["off_times"])

    def _read_off(self, time: float) -> Step:
        self._on_count = 0
        if self.is_off:
            return Step()
        self._off_times.append(time)
        if len(self._off_times) < _MIN_OFF:
            return Step()
        left, self.current, self.is_off = self.current, None, True
        return Step(() if left is None else (left,), None, self._off_times[0])

    def _read_on(self, found: FinalisedPosition, on: float | None) -> Step:
        directed = 2 * found.edge + (not found.forward)
        along = self._map.offset(directed, found.offset)
        current = self.current

        # On the same edge, unless it went round and begins it again.
        route = None
        if current is not None and found.linked and self._begins_again(current, directed, along):
            route = [directed, directed]
        elif current is not None and current.directed == directed:
            seconds = found.time - current.leave
            if abs(along - current.along) < _STANDING * seconds:
                current.standing += seconds
            current.along, current.leave = along, found.time
            return Step(on=on)

        # On another one, with those between.
        if current is not None and found.linked and route is None:
            route = connect_roads([current.directed, directed], self._map.exits, self._map.lengths)
        if current is None or route is None or route[0] != current.directed:
            self.current = Pass(directed, found.time, along, True, along, found.time)
            return Step(() if current is None else (current,), self.current, on=on)
        return self._travel(current, route, found.time, along, on)

    def _begins_again(self, current: Pass, directed: int, along: float) -> bool:
        """Whether an agent on an edge that ends where it begins is at its start again."""
        length = float(self._map.lengths[directed >> 1])
        is_back = current.directed == directed and along < current.along - _AGAIN * length
        return is_back and directed in self._map.exits.options[directed]

    def _travel(
        self, current: Pass, route: list[int], time: float, along: float, on: float | None
    ) -> Step:
        """Go on from one edge to another, at one speed since the last position."""
        lengths = [float(self._map.lengths[each >> 1]) for each in route]
        turns_back = route[1] == current.directed ^ 1
        if turns_back:
            # It turned on the edge, which it did not reach the end of.
            lengths[0] = current.along
        metres = [max(lengths[0] - current.along, 0.0), *lengths[1:-1], max(along, 0.0)]
        total = sum(metres) or 1.0
        seconds = time - current.leave
        current.leave += seconds * metres[0] / total
        current.along = lengths[0]

        # Those between are passed as a whole.
        left = [current]
        for directed, length in zip(route[1:-1], metres[1:-1], strict=True):
            enter = left[-1].leave
            leave = enter + seconds * length / total
            left.append(Pass(directed, enter, 0.0, False, length, leave))
        begin = min(float(self._map.lengths[route[-1] >> 1]) - lengths[0], along)
        self.current = Pass(
            route[-1], left[-1].leave, begin if turns_back else 0.0, False, along, time
        )
        return Step(tuple(left), self.current, on=on)
