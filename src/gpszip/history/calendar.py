"""Local hours, weekdays and months of the times of a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, tzinfo

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError
from gpszip.geo.planes import to_geographic
from gpszip.history.local_time import find_zone, zone_of_place
from gpszip.model import Network

__all__ = ["PARTS", "Calendar", "choose_calendar"]

#: Start of 1980 in seconds since 1970; smaller times don't count from 1970.
_EARLIEST = 315_532_800.0

#: Offsets of time zones change at multiples of this many seconds.
_STEP = 900.0

#: Seconds of an hour and of a day.
_HOUR = 3600.0
_DAY = 86_400.0

#: Days from a Monday to the first of January 1970.
_MONDAY = 3

#: Hours at which the periods of a day begin, and their names.
_PERIODS = ((0, "night"), (6, "morning"), (10, "midday"), (16, "evening"), (20, "night"))

#: Parts of local time by which traversals are counted.
PARTS = ("hour", "weekday", "month", "period", "date")

#: Those that a log has only if its times are dates.
_NEED_DATES = ("month", "date")


@dataclass(frozen=True)
class Calendar:
    """How times of a log become local hours and dates.

    Parameters
    ----------
    zone : tzinfo
        The time zone.
    name : str
        Its name; empty for a log whose times are no dates.
    source : str
        Who said it: ``option``, ``place`` (its coordinates), ``default``; or ``log`` for a log
        whose times are no dates, whose hours and days count from its zero.
    """

    zone: tzinfo
    name: str
    source: str

    def local(self, times: ArrayLike) -> NDArray[np.float64]:
        """Seconds of the local clock, shape (n,), NaN where times are.

        Raises
        ------
        OptionError
            If a time is no date of the years 1 to 9999.

        Examples
        --------
        >>> from datetime import UTC
        >>> Calendar(UTC, "UTC", "default").local([3600.0]).tolist()
        [3600.0]
        """
        # One look at the zone for each quarter of an hour that occurs.
        seconds = np.asarray(times, np.float64)
        known = np.isfinite(seconds)
        steps, place = np.unique(np.floor(seconds[known] / _STEP), return_inverse=True)
        offsets = np.array([self._offset(step * _STEP) for step in steps.tolist()], np.float64)
        local = np.full(len(seconds), np.nan)
        local[known] = seconds[known] + (offsets[place] if len(steps) else 0.0)
        return local

    def _offset(self, time: float) -> float:
        # A log whose times are no dates has no offset.
        if not self.name:
            return 0.0
        try:
            offset = datetime.fromtimestamp(time, self.zone).utcoffset()
        except (OSError, OverflowError, ValueError) as error:
            raise OptionError(f"{time:g} s since 1970 is no date") from error
        return 0.0 if offset is None else offset.total_seconds()

    def hours(self, times: ArrayLike) -> NDArray[np.float64]:
        """Local time of day in hours, from 0 to 24; NaN where times are."""
        hours: NDArray[np.float64] = self.local(times) % _DAY / _HOUR
        return hours

    def part(self, name: str, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """One of :data:`PARTS` of finite times, shape (n,).

        Returns
        -------
        int64 array
            Hour 0 to 23, weekday 0 (Monday) to 6, month 1 to 12, number of the period, or days
            since 1970. Of a log whose times are no dates, the first day is weekday 0.

        Raises
        ------
        OptionError
            If times are no dates, and have no month or date.

        Examples
        --------
        >>> from datetime import UTC
        >>> utc = Calendar(UTC, "UTC", "default")
        >>> [utc.part(name, np.array([90000.0])).item() for name in PARTS]
        [1, 4, 1, 0, 1]
        """
        # Refuse what only dates have.
        if name in _NEED_DATES and not self.name:
            raise OptionError(
                f"the times of the log are no dates, so that they have no {name}",
                remedy="hour, weekday and period count from its zero",
            )

        # Days since 1970 and hours of the local clock.
        local = self.local(times)
        days = np.floor(local / _DAY).astype(np.int64)
        hours = np.floor(local % _DAY / _HOUR).astype(np.int64)
        if name == "hour":
            return hours
        if name == "weekday":
            return (days + (_MONDAY if self.name else 0)) % 7
        if name == "month":
            months = days.astype("datetime64[D]").astype("datetime64[M]").astype(np.int64)
            return months % 12 + 1
        if name == "period":
            first = [begin for begin, _ in _PERIODS]
            number = np.searchsorted(first, hours, side="right") - 1
            return np.where(number == len(_PERIODS) - 1, 0, number)
        return days

    def labels(self, name: str, values: NDArray[np.int64]) -> NDArray[np.generic]:
        """Values of a part as they are written: periods by name, dates as text."""
        if name == "period":
            return np.array([text for _, text in _PERIODS])[values]
        if name == "date":
            return np.datetime_as_string(values.astype("datetime64[D]"), unit="D")
        return values

    def describe(self) -> str:
        """Say whose hours are told.

        Examples
        --------
        >>> from datetime import UTC
        >>> Calendar(UTC, "UTC", "default").describe()
        'hours are those of UTC, as no time zone was given'
        """
        if self.source == "log":
            return "times are no dates: hours and days count from the log's zero"
        why = {
            "default": ", as no time zone was given",
            "place": ", by the coordinates of the log",
        }
        return f"hours are those of {self.name}{why.get(self.source, '')}"

    def at(self, hour: float, near: float) -> float:
        """Seconds of the last time before ``near`` at which local clocks show an hour.

        Examples
        --------
        >>> from datetime import UTC
        >>> Calendar(UTC, "UTC", "default").at(8.5, 200_000.0)
        117000.0
        """
        now = float(self.hours([near])[0])
        return near - timedelta(hours=(now - hour) % 24).total_seconds()


def choose_calendar(
    network: Network, times: Sequence[float] | NDArray[np.float64], timezone: str | None
) -> Calendar:
    """Choose the time zone of a log: as given, else that of the place, else UTC.

    Parameters
    ----------
    network : Network
        Where the log lies.
    times : array_like, shape (n,)
        Times of the log; NaN is none.
    timezone : str, optional
        A name such as ``Europe/Berlin``.

    Raises
    ------
    OptionError
        If there is no such zone, or the times are no dates.
    """
    # Times that don't count from 1970 have hours, but no zone.
    seconds = np.asarray(times, np.float64)
    known = seconds[np.isfinite(seconds)]
    is_dated = len(known) > 0 and bool(known.min() > _EARLIEST)
    if timezone is not None and len(known) and not is_dated:
        raise OptionError(
            "the times of the log are no dates, so that they have no time zone",
            remedy="leave out the time zone",
        )
    if timezone is not None:
        return Calendar(find_zone(timezone), timezone, "option")
    if not is_dated:
        return Calendar(find_zone("UTC"), "", "log")

    # The zone of the middle of the map, where a package knows it.
    if network.plane is not None:
        middle = np.median(network.nodes[:, :2], axis=0)[None]
        lat, lon = to_geographic(middle, network.plane)
        name = zone_of_place(float(lat[0]), float(lon[0]))
        if name is not None:
            return Calendar(find_zone(name), name, "place")
    return Calendar(find_zone("UTC"), "UTC", "default")
