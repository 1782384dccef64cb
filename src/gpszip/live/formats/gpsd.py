"""gpsd: reports in JSON, of which TPV has positions.

Format: gpsd_json(5). Times are ISO 8601, speeds m/s, errors of 95 % in metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import Context, clean_name, make_fix, read_time, to_number
from gpszip.live.formats.values import to_amount as amount

__all__ = ["GpsdParser"]

#: Seconds between two reports of one device that are of one epoch; no receiver is faster.
_EPOCH_SECONDS = 0.02

#: Modes from here on have a position.
_MODE_2D = 2

#: Devices whose last time is kept; gpsd knows four.
_MAX_DEVICES = 64


class GpsdParser:
    """Turns reports of gpsd into fixes.

    Examples
    --------
    >>> report = {"class": "TPV", "device": "/dev/gps0", "mode": 3, "lat": 48.1, "lon": 11.5,
    ...           "time": "1970-01-01T00:00:07.000Z", "eph": 4.0}
    >>> [fix] = GpsdParser().parse(report, Context(9.0, "gpsd"))
    >>> fix.agent, fix.time, fix.accuracy, fix.quality
    ('/dev/gps0', 7.0, 4.0, '')
    """

    def __init__(self) -> None:
        self._last_times: dict[str, float] = {}

    def parse(self, report: Mapping[str, Any], context: Context) -> list[Fix | Unusable]:
        """Return the fix of a report; those of other classes have none."""
        # A receiver that has lost its fix may go on with its last position.
        if report.get("class") != "TPV":
            return []
        agent = clean_name(context.agent, report.get("device"), "gpsd")
        if (to_number(report.get("mode")) or 0) < _MODE_2D:
            return [Unusable(agent, "reports of gpsd without a fix left out")]

        # Some receivers give two reports for one epoch, 1.5 ms apart.
        time = read_time(report.get("time"), context)
        last = self._last_times.get(agent)
        if time is not None:
            if last is not None and 0 < abs(time - last) < _EPOCH_SECONDS:
                return [Unusable(agent, "second reports of one epoch left out")]
            if len(self._last_times) < _MAX_DEVICES or agent in self._last_times:
                self._last_times[agent] = time
        return [
            make_fix(
                context,
                agent,
                time,
                (to_number(report.get("lat")), to_number(report.get("lon"))),
                kind="TPV",
                accuracy=report.get("eph"),
                heading=report.get("track"),
                speed=amount(report.get("speed")),
            )
        ]
