"""NMEA 0183 as it comes: sentence by sentence, one fix for each epoch.

Logs of NMEA are read by :mod:`gpszip.io.logs.nmea`, which sees a whole file. Here the date of a
sentence without one is that of the last one with a date, or else that of the system's clock.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import reduce

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import KNOT, Context, make_fix, scaled, to_number

__all__ = ["NmeaParser"]

#: Seconds in a day.
_DAY = 86_400.0

#: Seconds by which the time of day steps back at midnight, at least.
_MIN_MIDNIGHT_STEP = _DAY / 2

#: Bytes of a sentence at most; the standard has 82.
_MAX_SENTENCE_BYTES = 200

#: Two-digit years from here on are those of the last century.
_LAST_CENTURY = 80

#: A sentence: talker, type, fields, and the checksum if there is one.
_SENTENCE = re.compile(rb"\$([A-Z]{2})([A-Z]{3}),([^*$]*)(?:\*([0-9A-Fa-f]{2}))?")

#: Degrees and minutes in one number: ddmm.mmmm or dddmm.mmmm.
_DEGREES = re.compile(r"(\d{1,3})(\d\d(?:\.\d*)?)")

#: For each type, the indices of time, status, latitude, north or south, longitude, east or west.
_FIELDS = {
    "RMC": (0, 1, 2, 3, 4, 5),
    "GGA": (0, 5, 1, 2, 3, 4),
    "GNS": (0, 5, 1, 2, 3, 4),
    "GLL": (4, 5, 0, 1, 2, 3),
}

#: Types whose position is preferred to others of the same epoch.
_PREFERENCE = ("GGA", "GNS", "RMC", "GLL")


@dataclass
class _Epoch:
    """What the sentences of one time of day say."""

    clock: float
    text: str
    kind: str = ""
    latitude: float | None = None
    longitude: float | None = None
    day: float | None = None
    speed: float | None = None
    heading: str = ""
    void: bool = False


class NmeaParser:
    """Turns the sentences of one receiver into fixes.

    Parameters
    ----------
    agent : str
        Name of the receiver.

    Examples
    --------
    >>> parser = NmeaParser("boat")
    >>> context = Context(764380802.0, "nmea")
    >>> rmc = b"$GPRMC,000001.5,A,4807.038,N,01131.000,E,022.4,084.4,230394,,*06"
    >>> parser.push(rmc, context)
    []
    >>> [fix] = parser.finish(context)
    >>> fix.agent, fix.time, [round(degrees, 6) for degrees in fix.position], fix.heading
    ('boat', 764380801.5, [48.1173, 11.516667], 84.4)
    """

    def __init__(self, agent: str) -> None:
        self._agent = agent
        self._epoch: _Epoch | None = None
        #: Days since 1970 of the last sentence with a date, and its time of day.
        self._last_date: tuple[float, float] | None = None

    @property
    def pending(self) -> bool:
        """Whether an epoch may still go on."""
        return self._epoch is not None

    def push(self, line: bytes, context: Context) -> list[Fix | Unusable]:
        """Take a line; return the fix of the epoch that it ends, if it begins another one."""
        # Receivers write other sentences, too, and other protocols between them.
        match = _SENTENCE.search(line[:_MAX_SENTENCE_BYTES])
        if match is None:
            is_cut = b"*" in line or line.startswith((b"$", b"!")) is False
            reason = "lines that are no sentence of NMEA left out"
            return [Unusable(self._agent, reason)] if line.strip() and is_cut else []
        body = match[0][1:].partition(b"*")[0]
        if match[4] is not None and reduce(lambda a, b: a ^ b, body, 0) != int(match[4], 16):
            return [Unusable(self._agent, "sentences of NMEA with a wrong checksum left out")]
        kind = match[2].decode()
        if kind not in _FIELDS:
            return []

        # A sentence at another time begins another epoch.
        fields = match[3].decode("ascii", "replace").split(",")
        clock_text = _field(fields, _FIELDS[kind][0])
        clock = _clock(clock_text)
        if clock is None:
            return [Unusable(self._agent, "sentences of NMEA without a time left out")]
        ended: list[Fix | Unusable] = []
        if self._epoch is None or self._epoch.clock != clock:
            ended = self.finish(context)
            self._epoch = _Epoch(clock, clock_text)
        _add(self._epoch, kind, fields)
        return ended

    def finish(self, context: Context) -> list[Fix | Unusable]:
        """End the epoch, and return its fix."""
        # An epoch that holds a position.
        epoch, self._epoch = self._epoch, None
        if epoch is None:
            return []
        if epoch.void:
            # A receiver whose clock is not set may show any date.
            reason = "positions that the receiver marks as not valid left out"
            return [Unusable(self._agent, reason)]

        # Its date may have come before it.
        return [
            make_fix(
                context,
                self._agent,
                self._date(epoch, context.received) * _DAY + epoch.clock,
                (epoch.latitude, epoch.longitude),
                kind=epoch.kind,
                heading=epoch.heading,
                speed=epoch.speed,
            )
        ]

    def _date(self, epoch: _Epoch, received: float) -> float:
        """Days since 1970 of an epoch."""
        day = epoch.day
        if day is None and self._last_date is not None:
            day, clock = self._last_date
            day += epoch.clock < clock - _MIN_MIDNIGHT_STEP
        if day is None:
            # The day on which this time of day is nearest to the system's.
            return round((received - epoch.clock) / _DAY)
        self._last_date = day, epoch.clock
        return day


def _field(fields: list[str], index: int) -> str:
    return fields[index] if index < len(fields) else ""


def _add(epoch: _Epoch, kind: str, fields: list[str]) -> None:
    """Add a sentence to its epoch."""
    # Any sentence may say that there is no fix.
    _, status, latitude, north, longitude, east = (_field(fields, index) for index in _FIELDS[kind])
    epoch.void |= status in {"V", "0"} or (kind == "GNS" and not status.strip("N"))

    # Latitude and longitude come from one sentence, that of the preferred type.
    lat, lon = _degrees(latitude, north, "S"), _degrees(longitude, east, "W")
    is_better = not epoch.kind or _PREFERENCE.index(kind) < _PREFERENCE.index(epoch.kind)
    if lat is not None and lon is not None and is_better:
        epoch.kind, epoch.latitude, epoch.longitude = kind, lat, lon

    # Only RMC has a date, a speed and a course.
    if kind == "RMC":
        epoch.speed = scaled(_field(fields, 6), KNOT)
        epoch.heading = _field(fields, 7)
        epoch.day = _day(_field(fields, 8))


def _clock(text: str) -> float | None:
    """Seconds of the day of hhmmss.sss; None for what is none."""
    digits = text.partition(".")[0]
    if len(digits) != 6 or not digits.isdecimal():
        return None
    hours, minutes = int(digits[:2]), int(digits[2:4])
    seconds = to_number(text[4:])
    if seconds is None or hours >= 24 or minutes >= 60 or seconds >= 61:
        return None
    return round(hours * 3600 + minutes * 60 + seconds, 6)


def _degrees(text: str, side: str, negative: str) -> float | None:
    match = _DEGREES.fullmatch(text)
    if match is None:
        return None
    degrees = int(match[1]) + float(match[2]) / 60
    return -degrees if side == negative else degrees


def _day(text: str) -> float | None:
    """Days since 1970 of ddmmyy; None for what is none, such as 220899 written as 2208-1."""
    if len(text) != 6 or not text.isdecimal():
        return None
    short = int(text[4:])
    year = short + (1900 if short >= _LAST_CENTURY else 2000)
    try:
        date = datetime(year, int(text[2:4]), int(text[:2]), tzinfo=UTC)
    except ValueError:
        return None
    return date.timestamp() / _DAY
