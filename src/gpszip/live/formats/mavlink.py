"""Messages of MAVLink with positions, as pymavlink decodes them.

Format: message_definitions of MAVLink, common.xml. Degrees are in units of 1e-7, speeds in cm/s,
headings in 1/100 degree; times are those since the system began, to which SYSTEM_TIME gives the
clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gpszip.live.choice import Choice
from gpszip.live.fix import Fix, Marks, Unusable
from gpszip.live.formats.values import Context, make_fix
from gpszip.live.notices import Notices

__all__ = ["MavlinkParser"]

#: Degrees of a unit.
_DEGREE = 1e-7

#: Numbers that stand for unknown ones.
_UNKNOWN = 65_535

#: Types of fixes from here on have a position.
_FIX_2D = 2

#: Seconds since 1970: times below are those since the system began.
_FIRST_DATE = 1e8

#: Seconds by which the time of a system goes back when it began anew; less is disorder.
_RESTART = 10.0

#: The component that flies or drives; others may report what it does, too.
_AUTOPILOT = 1

#: Frames of ODOMETRY whose x is north or ahead and y east or right, and with x to the east or
#: ahead and y to the north or left.
_NED_FRAMES = frozenset({1, 7, 20})
_ENU_FRAMES = frozenset({4, 21})

#: Quality of odometry that has failed.
_FAILED = -1

#: Systems and components whose clocks are kept; a link has 255 systems.
_MAX_CLOCKS = 65_536


@dataclass(slots=True)
class _Clock:
    """The clock of a component: seconds since 1970 when it began, and its last time since then."""

    zero: float | None = None
    last: float = 0.0


class MavlinkParser:
    """Turns messages of any number of systems into fixes.

    Parameters
    ----------
    name : str
        Agents are called so, followed by the number of their system.
    local : bool
        Whether positions are taken in metres (ODOMETRY, LOCAL_POSITION_NED) instead of degrees.
    notices : Notices
        Is told what is special.
    """

    def __init__(self, name: str, notices: Notices, *, local: bool) -> None:
        self._name, self._notices = name, notices
        self._clocks: dict[tuple[int, int], _Clock] = {}
        self._resets: dict[tuple[int, int], int] = {}
        self._choice = Choice()
        # The first of them is taken where a system sends several.
        readers = (
            (("ODOMETRY", self._odometry), ("LOCAL_POSITION_NED", self._local_position))
            if local
            else (("GLOBAL_POSITION_INT", self._global_position), ("GPS_RAW_INT", self._gps))
        )
        self._readers: dict[str, tuple[int, Callable[..., Fix | Unusable]]] = {
            kind: (rank, reader) for rank, (kind, reader) in enumerate(readers)
        }

    def parse(self, message: Any, received: float) -> list[Fix | Unusable]:
        """Return the fix of a message, if it has one."""
        kind = message.get_type()
        key = message.get_srcSystem(), message.get_srcComponent()
        if kind == "SYSTEM_TIME":
            self._set_clock(key, message)
            return []
        if kind == "BAD_DATA":
            return [Unusable("", "bytes that are no packet of MAVLink left out")]
        if kind not in self._readers:
            return []

        # Of several kinds and components, the best one counts.
        rank, reader = self._readers[kind]
        context = Context(received, "mavlink", f"{self._name}-{key[0]}")
        fix = reader(message, key, context)
        if isinstance(fix, Unusable) or (fix.position == (0.0, 0.0) and fix.geographic):
            return [fix]
        rank = 2 * rank + (key[1] != _AUTOPILOT)
        source = f"{kind} of {key[1]}"
        if not self._choice.takes(context.agent, source, rank, fix.time, received):
            self._notices.count("positions of a second source of one system left out")
            return []
        return [self._with_break(fix, message, key) if kind == "ODOMETRY" else fix]

    def _global_position(self, message: Any, key: tuple[int, int], context: Context) -> Any:
        return make_fix(
            context,
            context.agent,
            self._time(key, message.time_boot_ms / 1e3),
            (_degrees(message.lat), _degrees(message.lon)),
            kind="GLOBAL_POSITION_INT",
            heading=_hundredths(message.hdg),
            speed=round(math.hypot(message.vx, message.vy) / 100, 6),
        )

    def _gps(self, message: Any, key: tuple[int, int], context: Context) -> Any:
        if message.fix_type < _FIX_2D:
            return Unusable(context.agent, "messages of receivers without a fix left out")
        return make_fix(
            context,
            context.agent,
            self._time(key, message.time_usec / 1e6),
            (_degrees(message.lat), _degrees(message.lon)),
            kind="GPS_RAW_INT",
            accuracy=message.h_acc / 1e3,
            heading=_hundredths(message.cog),
            speed=_hundredths(message.vel),
        )

    def _odometry(self, message: Any, key: tuple[int, int], context: Context) -> Any:
        # Odometry that can be used.
        frame = message.frame_id
        if frame not in _NED_FRAMES | _ENU_FRAMES:
            reason = "odometry in frames that have no map left out"
            return Unusable(context.agent, reason, str(frame))
        if message.quality == _FAILED:
            return Unusable(context.agent, "odometry that has failed left out")

        # East or ahead first, then north or left.
        x, y = (message.x, message.y) if frame in _ENU_FRAMES else (message.y, message.x)
        return make_fix(
            context,
            context.agent,
            self._time(key, message.time_usec / 1e6),
            (_finite(x), _finite(y)),
            kind="ODOMETRY",
            speed=_finite(math.hypot(message.vx, message.vy)),
            geographic=False,
        )

    def _local_position(self, message: Any, key: tuple[int, int], context: Context) -> Any:
        return make_fix(
            context,
            context.agent,
            self._time(key, message.time_boot_ms / 1e3),
            (_finite(message.y), _finite(message.x)),
            kind="LOCAL_POSITION_NED",
            speed=_finite(math.hypot(message.vx, message.vy)),
            geographic=False,
        )

    def _with_break(self, fix: Fix, message: Any, key: tuple[int, int]) -> Fix:
        """Mark a fix before which the estimator was reset: it has counted so."""
        last = self._resets.get(key, message.reset_counter)
        self._resets[key] = message.reset_counter
        return fix if message.reset_counter == last else fix.marked(Marks.BREAK)

    def _set_clock(self, key: tuple[int, int], message: Any) -> None:
        """Learn when a component began, from its clock; 0 is the time of one that has none."""
        unix = message.time_unix_usec / 1e6
        since = message.time_boot_ms / 1e3
        clock = self._clock(key, since)
        if unix >= _FIRST_DATE:
            clock.zero = unix - since

    def _clock(self, key: tuple[int, int], since: float) -> _Clock:
        """The clock of a component, which begins anew with it."""
        if len(self._clocks) >= _MAX_CLOCKS and key not in self._clocks:
            self._clocks.clear()
        clock = self._clocks.setdefault(key, _Clock())
        if since < clock.last - _RESTART:
            self._notices.note("systems that began anew", f"{self._name}-{key[0]}")
            clock.zero = None
        if since > clock.last or clock.zero is None:
            clock.last = since
        return clock

    def _time(self, key: tuple[int, int], time: float) -> float | None:
        """Seconds since 1970; None where the clock of the component isn't known."""
        if time >= _FIRST_DATE:
            return time
        zero = self._clock(key, time).zero
        return None if zero is None else round(zero + time, 6)


def _degrees(value: int) -> float:
    return round(value * _DEGREE, 7)


def _hundredths(value: int) -> float | None:
    return None if value == _UNKNOWN else value / 100


def _finite(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None
