"""Hours of the day at which an agent always travels, and this time did not."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.history.calendar import Calendar
from gpszip.history.traversals import Traversals
from gpszip.model import Track
from gpszip.model.unusual import Anomaly

__all__ = ["find_absences"]

#: Days of an archive on which an agent travelled, from which its habits are known.
_MIN_DAYS = 5

#: Bits from which an absence is told; with n of n days known, an absence has log2(n + 2).
_MIN_BITS = 2.5

#: Seconds of an hour and of a day, and hours of a day.
_HOUR, _DAY, _HOURS = 3600.0, 86_400.0, 24


def find_absences(
    known: Traversals, tracks: Sequence[Track], traversals: Traversals, calendar: Calendar
) -> tuple[Anomaly, ...]:
    """Find hours without travel at which the same agent travelled on nearly all days before.

    With travel in the hour on k of n days, ``p = (n - k + 1) / (n + 2)``. Days are those on which
    the agent travelled at all; hours are local ones that the log spans entirely.

    Parameters
    ----------
    known : Traversals
        Of an archive.
    tracks : sequence of Track
        A log, whose track ids are those of the archive.
    traversals : Traversals
        Of the log.
    calendar : Calendar
        How times become local hours.

    Returns
    -------
    tuple of Anomaly
        Hours in a row are one.
    """
    if not calendar.name or not len(traversals):
        return ()

    # The log is complete from its first to its last sample.
    begin = min(float(track.times[0]) for track in tracks)
    end = max(float(track.times[-1]) for track in tracks)
    first, last = calendar.local([begin, end]).tolist()
    found: list[Anomaly] = []
    for number, track in enumerate(tracks):
        if track.id not in known.ids:
            continue
        usual = _travels(known, known.track == known.ids.index(track.id), calendar)
        now = _travels(traversals, traversals.track == number, calendar)
        days = {hour // _HOURS for hour in usual}
        if len(days) < _MIN_DAYS:
            continue

        # Whole hours of the log in which the agent travels on nearly all days, and did not now.
        counts = np.bincount([hour % _HOURS for hour in usual], minlength=_HOURS)
        bits = -np.log2((len(days) - counts + 1) / (len(days) + 2))
        hours = range(math.ceil(first / _HOUR), math.floor(last / _HOUR))
        absent = [hour for hour in hours if bits[hour % _HOURS] >= _MIN_BITS and hour not in now]
        found += _join_hours(track.id, absent, bits, round(begin - first), calendar)
    return tuple(found)


def _travels(rows: Traversals, chosen: NDArray[np.bool_], calendar: Calendar) -> set[int]:
    """Hours of the local clock since 1970 in which some traversals began or ended."""
    both = calendar.local(np.concatenate((rows.enter[chosen], rows.leave[chosen])))
    return set((both[np.isfinite(both)] // _HOUR).astype(np.int64).tolist())


def _join_hours(
    name: str, hours: list[int], bits: NDArray[np.float64], offset: int, calendar: Calendar
) -> list[Anomaly]:
    """Make one absence of local hours in a row; ``offset`` makes times of the log's first hours."""
    # When each begins, as clocks may change within the log.
    local = np.array(hours, np.float64) * _HOUR
    begins = local + offset
    begins -= calendar.local(begins) - local

    # An hour that clocks leave out in spring is none.
    is_shown = calendar.local(begins) == local
    kept = [(hours[i], float(begins[i])) for i in np.flatnonzero(is_shown).tolist()]

    # Hours in a row.
    joined: list[list[tuple[int, float]]] = []
    for hour, begin in kept:
        if joined and hour == joined[-1][-1][0] + 1:
            joined[-1].append((hour, begin))
        else:
            joined.append([(hour, begin)])

    return [
        Anomaly(
            name,
            "absence",
            run[0][1],
            run[-1][1] + _HOUR,
            float(max(bits[hour % _HOURS] for hour, _ in run)),
            f"no travel from {run[0][0] % _HOURS} to {run[-1][0] % _HOURS + 1} h {calendar.name}, "
            "as on most days",
            (),
        )
        for run in joined
    ]
