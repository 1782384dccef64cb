"""Screening of fixes before they are stored: what can't be true is left out, and counted."""

from __future__ import annotations

import math
from collections import OrderedDict

from gpszip.live.fix import Fix, Marks
from gpszip.live.jumps import Jumps
from gpszip.live.notices import Notices
from gpszip.live.speeds import SpeedUnits

__all__ = ["Screen"]

#: Seconds by which a fix may be ahead of the system's clock: zones that are mixed up are not.
_MAX_AHEAD = 86_400.0

#: Seconds after which a fix is stale when it comes.
_STALE = 3_600.0

#: Weeks of GPS are counted modulo 1024: receivers that don't know when they were made are so many
#: seconds late.
_ROLLOVER = 1024 * 7 * 86_400.0

#: Seconds before now in which a time is believed once the weeks are added: what phones keep.
_ROLLOVER_WINDOW = 90 * 86_400.0

#: Times below are seconds since some other zero than 1970, as robots have them.
_FIRST_DATE = 1e8

#: Metres and seconds from zero at most; float64 still tells their tenths.
_MAX_NUMBER = 1e12

#: Degrees within which positions are neighbours of 0,0.
_NEAR_ZERO = 1.0

#: Agents near 0,0 that are kept in memory.
_MAX_NEAR_ZERO = 10_000


class Screen:
    """Looks at fixes before they are stored.

    Parameters
    ----------
    notices : Notices
        Is told what was left out and changed.
    geographic : bool, optional
        Whether positions are degrees; by default as in the first fix.

    Examples
    --------
    >>> screen = Screen(Notices(print))
    >>> screen.check(Fix("bus", "gpsd", 7.0e8, 7.0e8, (0.0, 0.0)))
    bus: positions at 0,0 left out
    >>> screen.check(Fix("bus", "gpsd", 9.0e8, 7.0e8, (1.5, 2.0)))
    bus: times more than a day in the future left out (55555.6 hours)
    """

    def __init__(self, notices: Notices, geographic: bool | None = None) -> None:
        self._notices = notices
        self.geographic = geographic
        self._speeds = SpeedUnits(notices)
        self._jumps = Jumps(notices)
        self._near_zero: OrderedDict[str, None] = OrderedDict()

    def check(self, fix: Fix) -> Fix | None:
        """Return a fix as it is to be stored; None for one that can't be used."""
        reason, value = self._refusal(fix)
        if reason:
            self._notices.note(reason, fix.agent, value)
            return None
        self.geographic = fix.geographic
        return self._jumps.check(self._speeds.convert(self._repaired(fix)))

    def remember(self, fix: Fix) -> None:
        """Take a fix that was stored before the process began."""
        self.geographic = fix.geographic
        self._jumps.remember(fix)

    def _refusal(self, fix: Fix) -> tuple[str, str]:
        """Say why a fix can't be used, and show the value; nothing if it can."""
        numbers = (fix.time, *fix.position)
        if not all(math.isfinite(number) and abs(number) < _MAX_NUMBER for number in numbers):
            return "positions and times that are no numbers left out", ""
        if fix.time >= _FIRST_DATE and -fix.age > _MAX_AHEAD:
            return "times more than a day in the future left out", f"{-fix.age / 3600:.1f} hours"
        if self.geographic is not None and fix.geographic != self.geographic:
            wanted = "degrees" if self.geographic else "metres"
            return f"positions that are not in {wanted}, as others in the journal, left out", ""
        return self._refusal_in_degrees(fix) if fix.geographic else ("", "")

    def _refusal_in_degrees(self, fix: Fix) -> tuple[str, str]:
        latitude, longitude = fix.position[:2]
        if fix.time < 0:
            return "times before 1970 left out", ""
        if abs(latitude) > 90 or abs(longitude) > 180:
            return "positions outside of the earth left out", f"{latitude:g},{longitude:g}"
        if self._is_null(fix, latitude, longitude):
            return "positions at 0,0 left out", ""
        return "", ""

    def _is_null(self, fix: Fix, latitude: float, longitude: float) -> bool:
        """Whether a position is 0,0 for want of a better one; keep who is near there."""
        near = max(abs(latitude), abs(longitude)) <= _NEAR_ZERO
        if not near:
            self._near_zero.pop(fix.agent, None)
            return False
        if latitude == longitude == 0:
            return fix.agent not in self._near_zero
        self._near_zero[fix.agent] = None
        if len(self._near_zero) > _MAX_NEAR_ZERO:
            self._near_zero.popitem(last=False)
        return False

    def _repaired(self, fix: Fix) -> Fix:
        """Repair the time of a receiver that counts weeks wrongly, and mark what is special."""
        if fix.time < _FIRST_DATE:
            return fix
        weeks = math.ceil((fix.age - _ROLLOVER_WINDOW) / _ROLLOVER) if fix.age > 0 else 0
        if weeks > 0 and fix.age - weeks * _ROLLOVER > -_MAX_AHEAD:
            self._notices.note("times 1024 weeks in the past repaired", fix.agent)
            fix = fix.marked(Marks.ROLLOVER, time=fix.time + weeks * _ROLLOVER)
        if Marks.ARRIVAL in fix.quality:
            self._notices.note("fixes without a time dated by their receipt", fix.agent)
        if fix.age > _STALE:
            fix = fix.marked(Marks.STALE)
        return fix
