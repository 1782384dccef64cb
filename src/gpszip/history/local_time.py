"""Local hours, nights and working days of stays."""

from __future__ import annotations

from datetime import UTC, datetime, tzinfo

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.errors import OptionError

__all__ = ["find_zone", "hour_rows", "zone_of_place"]

#: Seconds of a day and of an hour.
_DAY = 86_400.0
_HOUR = 3600.0

#: Seconds of a quarter of an hour.
_PART = 900.0

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def find_zone(name: str) -> tzinfo:
    """Return the time zone of a name such as ``Europe/Berlin`` or ``UTC``.

    Raises
    ------
    OptionError
        If there is none.

    Examples
    --------
    >>> find_zone("UTC")
    datetime.timezone.utc
    """
    from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

    # UTC is known where the system has no database of time zones.
    if name.upper() in {"UTC", "Z"}:
        return UTC
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise OptionError(
            f"there is no time zone {name!r}",
            remedy="write one such as Europe/Berlin or UTC; gpszip[timezones] brings all",
        ) from None


def zone_of_place(lat: float, lon: float) -> str | None:
    """Name of the time zone of a place, if the package timezonefinder is there to tell it."""
    try:
        from timezonefinder import TimezoneFinder
    except ImportError:
        return None
    name = TimezoneFinder().timezone_at(lat=lat, lng=lon)
    return None if name is None else str(name)


def hour_rows(
    starts: ArrayLike, ends: ArrayLike, zone: tzinfo
) -> tuple[Integers, Floats, Integers, Integers]:
    """Split time ranges at the quarters of local clocks.

    Parameters
    ----------
    starts, ends : array_like, shape (n,)
        Seconds from 1970.
    zone : tzinfo
        The time zone.

    Returns
    -------
    int64 array, shape (m,)
        Number of the range of each part.
    float64 array, shape (m,)
        Its duration in seconds.
    int64 array, shape (m,)
        Its local hour, 0 to 23.
    int64 array, shape (m,)
        Its local date, in days from 1970-01-01; a Thursday is 0.

    Examples
    --------
    >>> rows, durations, hours, days = hour_rows([3000.0], [7500.0], UTC)
    >>> durations.tolist(), hours.tolist(), days.tolist()
    ([600.0, 900.0, 900.0, 900.0, 900.0, 300.0], [0, 1, 1, 1, 1, 2], [0, 0, 0, 0, 0, 0])
    """
    # Parts within quarters of an hour: offsets of time zones are multiples of one.
    starts, ends = np.asarray(starts, np.float64), np.asarray(ends, np.float64)
    first = np.floor(starts / _PART).astype(np.int64)
    counts = np.floor(ends / _PART).astype(np.int64) - first + 1
    rows = np.repeat(np.arange(len(starts)), counts)
    part = first[rows] + np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    begin = np.maximum(starts[rows], part * _PART)
    duration = np.minimum(ends[rows], (part + 1) * _PART) - begin

    # Their local time.
    known, place = np.unique(part, return_inverse=True)
    offsets = np.array([_offset(each * _PART, zone) for each in known.tolist()], np.float64)
    local = begin + duration / 2 + offsets[place] if len(known) else begin
    days = np.floor(local / _DAY)
    hours = np.floor((local - days * _DAY) / _HOUR).astype(np.int64)
    keep = duration > 0
    return rows[keep], duration[keep], hours[keep], days[keep].astype(np.int64)


def _offset(time: float, zone: tzinfo) -> float:
    offset = datetime.fromtimestamp(time, zone).utcoffset()
    return 0.0 if offset is None else offset.total_seconds()
