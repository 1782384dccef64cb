"""Losses of points that users have to know first, and tracks whose clock stood still.

Several points of a track may have one timestamp, but only the first of them is kept. A few such
points are noise; many of them mean that the times are wrong or too coarse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.raw import RawLog
from gpszip.model.read_result import Loss, Repair

__all__ = [
    "MAX_TINY_LOG_POINTS",
    "MIN_STOPPED_POSITIONS",
    "TIME_OF_DAY_GOES_BACK",
    "RepeatedTimes",
    "find_large_losses",
    "find_repeated_times",
    "find_stopped_tracks",
    "loss_if_large",
    "nearly_lost_error",
    "stopped_clock_error",
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

#: Error for times of day that go back.
TIME_OF_DAY_GOES_BACK = (
    "the time of day goes back, perhaps at midnight, and there is no date; "
    "add a column named date, or start a new track there: --split"
)


@dataclass(frozen=True)
class RepeatedTimes:
    """Rows, ordered by track and time, whose timestamp an earlier row of the same track has.

    Parameters
    ----------
    same_position : bool array, shape (n,)
        Rows at the same position as the first row with this timestamp.
    other_position : bool array, shape (n,)
        Rows at another position.
    """

    same_position: NDArray[np.bool_]
    other_position: NDArray[np.bool_]

    @property
    def first(self) -> NDArray[np.bool_]:
        """Rows that are the first of their track with their timestamp."""
        return ~(self.same_position | self.other_position)


def find_repeated_times(
    times: NDArray[np.float64], coordinates: NDArray[np.float64], starts: NDArray[np.bool_]
) -> RepeatedTimes:
    """Find rows whose timestamp an earlier row of the same track has.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Not decreasing within a track.
    coordinates : float64 array, shape (n, d)
        Positions.
    starts : bool array, shape (n,)
        Whether a track starts at the row.
    """
    first = starts.copy()
    first[:1] = True
    first[1:] |= times[1:] != times[:-1]

    # Index of the first row with the same timestamp, for each row.
    first_row = np.maximum.accumulate(np.where(first, np.arange(len(times)), 0))
    same = np.asarray((coordinates == coordinates[first_row]).all(axis=1))
    return RepeatedTimes(~first & same, ~first & ~same)


def find_large_losses(raw: RawLog, rows: NDArray[np.intp], repeated: RepeatedTimes) -> list[Loss]:
    """Find the tracks of a log that lose many points.

    Parameters
    ----------
    raw : RawLog
        The log.
    rows : int array, shape (n,)
        Rows that can be used, ordered by track and time.
    repeated : RepeatedTimes
        Which of these rows repeat a timestamp.
    """
    # Count each track's points, and those that can't be used or repeat a time at another position.
    codes = np.zeros(len(raw.times), np.int64) if raw.codes is None else raw.codes
    track_count = max(len(raw.ids), 1)
    track = codes[rows]
    points = np.bincount(codes, minlength=track_count)
    moved = np.bincount(track[repeated.other_position], minlength=track_count)
    lost = points - np.bincount(track, minlength=track_count) + moved

    # Find the largest number of each track's points that share one timestamp.
    timestamp = np.cumsum(repeated.first) - 1
    timestamp_count = int(repeated.first.sum())
    sharing = np.bincount(timestamp[repeated.other_position], minlength=timestamp_count)
    shared = np.zeros(track_count, np.int64)
    np.maximum.at(shared, track[repeated.first], np.where(sharing > 0, sharing + 1, 0))

    # Report the large losses.
    names = raw.ids or ("",)
    is_large = (lost > _LARGE_LOSS_SHARE * points) | (shared >= _MIN_SIMULTANEOUS_POINTS)
    return [
        Loss(names[code], raw.name, int(lost[code]), int(points[code]), int(shared[code]))
        for code in np.flatnonzero((lost > 0) & is_large).tolist()
    ]


def loss_if_large(track: str, where: str, lost: int, points: int, shared: int = 0) -> list[Loss]:
    """Return the loss of one track if it is large; else an empty list."""
    is_large = lost > _LARGE_LOSS_SHARE * points or shared >= _MIN_SIMULTANEOUS_POINTS
    return [Loss(track, where, lost, points, shared)] if lost and is_large else []


def find_stopped_tracks(raw: RawLog, rows: NDArray[np.intp], repeated: RepeatedTimes) -> list[int]:
    """Find the tracks that have several positions, but a single timestamp.

    Parameters
    ----------
    raw, rows, repeated
        As for :func:`find_large_losses`.

    Returns
    -------
    list of int
        Codes of the tracks.
    """
    track = np.zeros(len(rows), np.int64) if raw.codes is None else raw.codes[rows]
    track_count = max(len(raw.ids), 1)
    timestamps = np.bincount(track[repeated.first], minlength=track_count)
    positions = 1 + np.bincount(track[repeated.other_position], minlength=track_count)
    return np.flatnonzero((timestamps == 1) & (positions >= MIN_STOPPED_POSITIONS)).tolist()


def stopped_clock_error(where: str, track: str, points: int, time: float) -> InputError:
    """Return the error for a track whose points all have the same time."""
    if _DATE_RANGE[0] <= time <= _DATE_RANGE[1]:
        shown_time = f"{np.datetime64(round(time), 's')}Z"
    else:
        shown_time = f"{time:.15g} s"
    whose = f" of track {track!r}" if track else ""
    return InputError(
        f"{where}: all {points:,} points{whose} have the same time, {shown_time}; "
        "name the right column with --columns t=COLUMN, "
        "or take the times out to read the points as a shape"
    )


def nearly_lost_error(where: str, points: int, noun: str, repairs: Sequence[Repair]) -> InputError:
    """Return the error for a log of which only one point of many can be used."""
    causes = ", ".join(
        f"{repair.count:,} {repair.what}" + (f" ({repair.value})" if repair.value else "")
        for repair in repairs
        if repair.drops
    )
    return InputError(
        f"{where}: only 1 of {points:,} {noun}s can be used: {causes}; "
        "name the right columns with --columns"
    )
