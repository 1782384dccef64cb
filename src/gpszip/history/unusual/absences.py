"""Hours of the day at which an agent always travels, and this time did not."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.history.traversals import Traversals
from gpszip.model import Track
from gpszip.model.timestamps import counts_from_1970
from gpszip.model.unusual import Anomaly

__all__ = ["find_absences"]

#: Days of an archive on which an agent travelled, from which its habits are known.
_MIN_DAYS = 5

#: Bits from which an absence is told; with n of n days known, an absence has log2(n + 2).
_MIN_BITS = 2.5

#: Seconds of an hour and of a day, and hours of a day.
_HOUR, _DAY, _HOURS = 3600.0, 86_400.0, 24


def find_absences(
    known: Traversals, tracks: Sequence[Track], traversals: Traversals
) -> tuple[Anomaly, ...]:
    """Find hours without travel at which the same agent travelled on nearly all days before.

    With travel in the hour on k of n days, ``p = (n - k + 1) / (n + 2)``. Days are those on which
    the agent travelled at all; hours are those in UTC that the log spans entirely.

    Parameters
    ----------
    known : Traversals
        Of an archive.
    tracks : sequence of Track
        A log, whose track ids are those of the archive.
    traversals : Traversals
        Of the log.

    Returns
    -------
    tuple of Anomaly
        Hours in a row are one.
    """
    times = known.enter[np.isfinite(known.enter)]
    if not len(times) or not len(traversals) or not counts_from_1970(float(times.min())):
        return ()

    # The log is complete from its first to its last sample.
    begin = min(float(track.times[0]) for track in tracks)
    end = max(float(track.times[-1]) for track in tracks)
    found: list[Anomaly] = []
    for number, track in enumerate(tracks):
        if track.id not in known.ids:
            continue
        usual = _travels(known, known.track == known.ids.index(track.id))
        now = _travels(traversals, traversals.track == number)
        days = {hour // _HOURS for hour in usual}
        if len(days) < _MIN_DAYS:
            continue

        # Whole hours of the log on days on which the agent travelled.
        counts = np.bincount([hour % _HOURS for hour in usual], minlength=_HOURS)
        bits = -np.log2((len(days) - counts + 1) / (len(days) + 2))
        hours = range(math.ceil(begin / _HOUR), math.floor(end / _HOUR))
        absent = [hour for hour in hours if bits[hour % _HOURS] >= _MIN_BITS and hour not in now]
        found += _join_hours(track.id, absent, bits)
    return tuple(found)


def _travels(rows: Traversals, chosen: NDArray[np.bool_]) -> set[int]:
    """Hours since 1970 in which some traversals began or ended."""
    both = np.concatenate((rows.enter[chosen], rows.leave[chosen]))
    return set((both[np.isfinite(both)] // _HOUR).astype(np.int64).tolist())


def _join_hours(name: str, hours: list[int], bits: NDArray[np.float64]) -> list[Anomaly]:
    """Make one absence of hours in a row."""
    joined: list[list[int]] = []
    for hour in hours:
        if joined and hour == joined[-1][-1] + 1:
            joined[-1].append(hour)
        else:
            joined.append([hour])
    return [
        Anomaly(
            name,
            "absence",
            run[0] * _HOUR,
            (run[-1] + 1) * _HOUR,
            float(max(bits[hour % _HOURS] for hour in run)),
            f"no travel from {run[0] % _HOURS} to {run[-1] % _HOURS + 1} h UTC, as on most days",
            (),
        )
        for run in joined
    ]
