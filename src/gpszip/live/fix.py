"""A fix: one position of one agent, as a source reports it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gpszip.errors import InputError

__all__ = ["Fix", "Marks", "Unusable", "distance"]

#: Metres; mean radius of the earth.
_EARTH_RADIUS = 6_371_000.0


class Marks:
    """Words in ``Fix.quality`` that say what was done to a fix."""

    #: The source gave no time: that of receipt counts.
    ARRIVAL = "arrival"
    #: The agent did not travel here from its last position: its map was corrected, or began anew.
    BREAK = "break"
    #: 1024 weeks were added to the time.
    ROLLOVER = "rollover"
    #: The speed was converted to m/s.
    SPEED = "speed"
    #: The fix was more than an hour old when it was received.
    STALE = "stale"


@dataclass(frozen=True, slots=True)
class Fix:
    """One position of one agent.

    Parameters
    ----------
    agent : str
        Who was there: a phone, a vehicle, a robot.
    source : str
        Where the fix came from, such as ``owntracks`` or ``gpsd``.
    time : float
        Time of the fix, in seconds since 1970 (or since the agent's own zero).
    received : float
        Time of receipt, in seconds since 1970.
    position : tuple of float
        Latitude and longitude in degrees, or x, y[, z] in metres.
    geographic : bool, default True
        Whether the position is in degrees.
    accuracy : float, optional
        Radius in metres; None where the source doesn't know it.
    heading : float, optional
        Degrees clockwise from north, in [0, 360).
    speed : float, optional
        Metres a second.
    quality : str
        Words that say what is special about the fix, see :class:`Marks`.
    kind : str
        The kind of message, as the source names it, such as ``TPV``.

    Examples
    --------
    >>> fix = Fix("bus", "gpsd", 7.0, 8.0, (48.1, 11.5), kind="TPV")
    >>> fix.age, fix.marked(Marks.STALE).quality
    (1.0, 'stale')
    """

    agent: str
    source: str
    time: float
    received: float
    position: tuple[float, ...]
    geographic: bool = True
    accuracy: float | None = None
    heading: float | None = None
    speed: float | None = None
    quality: str = ""
    kind: str = ""

    @property
    def age(self) -> float:
        """Seconds from the fix to its receipt."""
        return self.received - self.time

    def marked(self, mark: str, *, time: float | None = None) -> Fix:
        """Return the fix with one more word in its quality, at another time if one is given."""
        # dataclasses.replace takes 3 us, which is most of what screening takes.
        return Fix(
            self.agent,
            self.source,
            self.time if time is None else time,
            self.received,
            self.position,
            self.geographic,
            self.accuracy,
            self.heading,
            self.speed,
            f"{self.quality} {mark}".strip(),
            self.kind,
        )

    def with_speed(self, speed: float) -> Fix:
        """Return the fix with another speed, marked."""
        return replace(self, speed=speed, quality=f"{self.quality} {Marks.SPEED}".strip())

    def to_row(self) -> list[object]:
        """Return the fields in the order of the journal, without empty ones at the end."""
        row: list[object] = [
            self.agent,
            self.source,
            self.time,
            self.received,
            self.position,
            self.geographic,
            self.accuracy,
            self.heading,
            self.speed,
            self.quality,
            self.kind,
        ]
        return row

    @classmethod
    def from_row(cls, row: Sequence[Any]) -> Fix:
        """Return the fix of a row of the journal.

        Raises
        ------
        InputError
            If the row is none.

        Examples
        --------
        >>> fix = Fix("bus", "gpsd", 7.0, 8.0, (48.1, 11.5))
        >>> Fix.from_row(fix.to_row()) == fix
        True
        """
        try:
            agent, source, time, received, position, *others = row
            return cls(agent, source, time, received, tuple(position), *others)
        except (TypeError, ValueError):
            raise InputError("is no row of a journal") from None


@dataclass(frozen=True, slots=True)
class Unusable:
    """A message, or an item in one, that gives no fix.

    Parameters
    ----------
    agent : str
        Who sent it, if that is known.
    reason : str
        Why it can't be used; messages with one reason are counted together.
    value : str
        What was found instead, if that helps.
    """

    agent: str
    reason: str
    value: str = ""


def distance(one: Fix, other: Fix) -> float:
    """Metres between two fixes of one kind: on a sphere for degrees, straight for metres.

    Examples
    --------
    >>> north = [Fix("a", "", 0.0, 0.0, (lat, 0.0)) for lat in (0.0, 0.001)]
    >>> round(distance(*north), 1)
    111.2
    """
    if not one.geographic:
        return math.dist(one.position, other.position)
    lat, lon, other_lat, other_lon = map(math.radians, (*one.position[:2], *other.position[:2]))

    # Haversine.
    share = (
        math.sin((other_lat - lat) / 2) ** 2
        + math.cos(lat) * math.cos(other_lat) * math.sin((other_lon - lon) / 2) ** 2
    )
    return 2 * _EARTH_RADIUS * math.asin(math.sqrt(min(share, 1.0)))
