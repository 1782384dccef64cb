"""Losses of points that users have to know first, and files of which hardly a point can be used.

Several points of a track may have one timestamp, but only the first of them is kept. A few such
points are noise; many of them mean that the times are wrong or too coarse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.errors import InputError
from gpszip.model.read_result import Loss, Repair

__all__ = [
    "MAX_TINY_LOG_POINTS",
    "MIN_STOPPED_POSITIONS",
    "loss_if_large",
    "nearly_lost_error",
    "stopped_clock_error",
    "time_of_day_error",
]

#: Share of a track's points above which a loss is large.
_LARGE_LOSS_SHARE = 0.1

#: Points at different positions with one timestamp from which on a loss is large: the clock stood
#: still.
_MIN_SIMULTANEOUS_POINTS = 3

#: Positions at one timestamp from which on a track's clock is taken to have stood still throughout.
MIN_STOPPED_POSITIONS = 3

#: Points of the largest log that is read even if only one of them can be used.
MAX_TINY_LOG_POINTS = 2

#: Seconds since 1970 that messages show as dates.
_DATE_RANGE = (1e8, 2.5e11)


def loss_if_large(track: str, where: str, lost: int, points: int, shared: int = 0) -> list[Loss]:
    """Return the loss of one track if it is large; else an empty list.

    Parameters
    ----------
    track, where, lost, points, shared
        As for :class:`gpszip.model.read_result.Loss`.
    """
    # A clock that stood still for a while is a small share of a long track, but still a fault.
    is_large = lost > _LARGE_LOSS_SHARE * points or shared >= _MIN_SIMULTANEOUS_POINTS
    return [Loss(track, where, lost, points, shared)] if lost and is_large else []


def time_of_day_error(path: str, location: str) -> InputError:
    """Return the error for times of day that go back."""
    return InputError(
        "the time of day goes back, perhaps at midnight, and there is no date",
        path=path,
        location=location,
        remedy="add a column named date, or start a new track there: --split",
    )


def stopped_clock_error(where: str, track: str, points: int, noun: str, time: float) -> InputError:
    """Return the error for a track whose points all have the same time."""
    # Only tables have columns to name.
    if noun == "row":
        remedy = "name the right column with --columns t=COLUMN, or take the times out to read the "
        remedy += "points as a shape"
    else:
        remedy = "correct the times, or take them out to read the points as a shape"
    if _DATE_RANGE[0] <= time <= _DATE_RANGE[1]:
        shown_time = f"{np.datetime64(round(time), 's')}Z"
    else:
        shown_time = f"{time:.15g} s"
    whose = f" of track {track!r}" if track else ""
    return InputError(
        f"all {points:,} points{whose} have the same time, {shown_time}",
        path=where,
        remedy=remedy,
    )


def nearly_lost_error(where: str, points: int, noun: str, repairs: Sequence[Repair]) -> InputError:
    """Return the error for a log of which only one point of many can be used."""
    causes = ", ".join(
        f"{repair.count:,} {repair.what}" + (f" ({repair.value})" if repair.value else "")
        for repair in repairs
        if repair.drops
    )
    return InputError(
        f"only 1 of {points:,} {noun}s can be used: {causes}",
        path=where,
        remedy="name the right columns with --columns"
        if noun == "row"
        else "correct the file, or leave it out",
    )
