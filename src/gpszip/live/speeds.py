"""Units of speeds: what an agent reports is compared with the speed over ground of its positions.

Apps and trackers send knots or km/h where their protocol says m/s, and the other way round. Nothing
is decided by a speed; it is kept in m/s where its unit shows.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, field

from gpszip.live.fix import Fix, distance
from gpszip.live.notices import Notices

__all__ = ["SpeedUnits"]

#: Moves after which the unit is judged by the median of their ratios.
_MOVES = 30

#: Metres a second from which the errors of positions and times matter little.
_MIN_SPEED = 4.0

#: Seconds between two fixes of a move: with less, errors matter; with more, roads turn.
_MIN_SECONDS = 0.9
_MAX_SECONDS = 15.0

#: Relative deviation of the median from the ratio of a unit.
_TOLERANCE = 0.08

#: Ratio of a reported speed to that in m/s, by what went wrong.
_UNITS = {
    "knots": 3600 / 1852,
    "km/h": 3.6,
    "mph": 3600 / 1609.344,
    "m/s read as knots": 1852 / 3600,
    "m/s read as km/h": 1 / 3.6,
}

#: Agents that are kept in memory; of more, the one unused for longest goes.
_MAX_AGENTS = 20_000


@dataclass(slots=True)
class _State:
    """What is known of an agent."""

    last: Fix
    ratios: list[float] = field(default_factory=list)
    factor: float = 1.0


class SpeedUnits:
    """Converts speeds of agents whose unit is not m/s.

    Parameters
    ----------
    notices : Notices
        Is told of agents that report in other units.

    Examples
    --------
    >>> units = SpeedUnits(Notices(print))
    >>> for t in range(40):
    ...     fix = Fix("van", "osmand", t, t, (48 + t / 11_120, 11.0), speed=36.0)
    ...     speed = units.convert(fix).speed
    van: speeds converted to m/s (km/h)
    >>> speed
    10.0
    """

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._states: OrderedDict[str, _State] = OrderedDict()

    def convert(self, fix: Fix) -> Fix:
        """Return a fix with its speed in m/s, and learn from it."""
        if fix.speed is None:
            return fix
        state = self._states.get(fix.agent)
        if state is None:
            self._states[fix.agent] = _State(fix)
            if len(self._states) > _MAX_AGENTS:
                self._states.popitem(last=False)
            return fix

        # Learn from moves forward in time.
        self._states.move_to_end(fix.agent)
        if fix.time > state.last.time:
            self._learn(state, fix)
            state.last = fix
        return fix if state.factor == 1.0 else fix.with_speed(round(fix.speed / state.factor, 6))

    def _learn(self, state: _State, fix: Fix) -> None:
        """Add a move to those of an agent, and judge its unit if these are enough."""
        seconds = fix.time - state.last.time
        if not _MIN_SECONDS <= seconds <= _MAX_SECONDS or not fix.speed or not state.last.speed:
            return
        ground = distance(state.last, fix) / seconds
        if ground < _MIN_SPEED:
            return
        state.ratios.append((fix.speed + state.last.speed) / 2 / ground)
        if len(state.ratios) < _MOVES:
            return

        # The median is that of a unit, or none.
        median = sorted(state.ratios)[_MOVES // 2]
        state.ratios.clear()
        unit = next((name for name, ratio in _UNITS.items() if _is_near(median, ratio)), None)
        factor = 1.0 if unit is None else _UNITS[unit]
        if unit is not None and factor != state.factor:
            self._notices.note("speeds converted to m/s", fix.agent, unit)
        if unit is not None or _is_near(median, 1.0):
            state.factor = factor


def _is_near(ratio: float, unit: float) -> bool:
    return abs(math.log(ratio / unit)) < _TOLERANCE
