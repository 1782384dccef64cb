"""Jumps of positions on a metric plane: where SLAM corrects its map, nobody has travelled.

After a loop is closed, a robot is localised anew or starts its map again, its next pose lies
elsewhere at once. Such a fix is marked, so that no way is made of the jump.
"""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from dataclasses import dataclass, field

from gpszip.live.fix import Fix, Marks, distance
from gpszip.live.notices import Notices

__all__ = ["Jumps"]

#: Metres by which a pose may be off without being a jump: corrections of usual size.
_TOLERANCE = 1.0

#: Metres a second squared; 1 g, more than any robot or car accelerates.
_ACCELERATION = 10.0

#: Metres a second that an agent may have become faster between two fixes, however far apart: a car
#: that stood at the last fix may be on a motorway at the next.
_MAX_GAIN = 40.0

#: Agents that are kept in memory; of more, the one unused for longest goes.
_MAX_AGENTS = 20_000

#: Times of the last jumps of an agent, at which fixes are jumps when they come again.
_TIMES_KEPT = 8


@dataclass(slots=True)
class _State:
    """What is known of an agent; the speed of one that has not moved yet is unknown."""

    last: Fix
    speed: float | None = None
    times: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES_KEPT))


class Jumps:
    """Marks fixes that no travel can have led to.

    A fix is a jump if it is further from the last one than an agent gets that accelerates with 1 g
    from its last speed: ``d > 1 m + (v + min(a dt / 2, 40 m/s)) dt``. None of 121,434 poses of five
    robots and of racing drones is taken for one.

    Parameters
    ----------
    notices : Notices
        Is told of jumps.

    Examples
    --------
    >>> jumps = Jumps(Notices(print))
    >>> for t, x in [(0.0, 0.0), (0.1, 0.1), (0.2, 4.0), (0.3, 4.1)]:
    ...     fix = jumps.check(Fix("robot", "ros", t, t, (x, 0.0), geographic=False))
    ...     print(repr(fix.quality))
    ''
    ''
    robot: positions that jumped, taken as a break (3.9 m)
    'break'
    ''
    """

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._states: OrderedDict[str, _State] = OrderedDict()

    def remember(self, fix: Fix) -> None:
        """Take a fix that was stored before the process began."""
        if fix.geographic:
            return
        state = self._states.pop(fix.agent, None) or _State(fix)
        seconds = fix.time - state.last.time
        state.speed = distance(state.last, fix) / seconds if seconds > 0 else fix.speed
        state.last = fix

        # Of too many, the one unused for longest goes.
        self._states[fix.agent] = state
        if len(self._states) > _MAX_AGENTS:
            self._states.popitem(last=False)

    def check(self, fix: Fix) -> Fix:
        """Return a fix, marked if it jumped; degrees come from receivers, which don't jump so."""
        if fix.geographic:
            return fix
        state = self._states.get(fix.agent)
        if state is None:
            self.remember(fix)
            return fix
        self._states.move_to_end(fix.agent)

        # A fix that could not be stored comes again. Late ones tell nothing.
        if fix.time in state.times:
            return _marked(fix)
        seconds = fix.time - state.last.time
        if seconds <= 0:
            return fix

        # Compare with the way that can have been travelled; the source may know of a break.
        metres = distance(state.last, fix)
        state.last = fix
        if Marks.BREAK in fix.quality or metres > _reach(state.speed, seconds):
            # The speed is that of before: a correction makes nobody faster.
            state.times.append(fix.time)
            event = "positions that jumped, taken as a break"
            self._notices.note(event, fix.agent, f"{metres:.1f} m")
            return _marked(fix)
        state.speed = max(metres / seconds, fix.speed or 0.0)
        return fix


def _reach(speed: float | None, seconds: float) -> float:
    """Metres that an agent of a speed may get in some seconds; any if its speed isn't known."""
    if speed is None:
        return math.inf
    return _TOLERANCE + (speed + min(_ACCELERATION * seconds / 2, _MAX_GAIN)) * seconds


def _marked(fix: Fix) -> Fix:
    return fix if Marks.BREAK in fix.quality else fix.marked(Marks.BREAK)
