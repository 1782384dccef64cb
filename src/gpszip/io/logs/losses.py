"""Losses that must be told first, and tracks whose points all share one time."""

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

#: A track that loses more than this share of its points must be told of first.
_LARGE_LOSS_SHARE = 0.1

#: So many points at different positions with one time in common must be told of first: a clock stood still.
_MIN_SIMULTANEOUS_POINTS = 3

#: Fewer positions than these at one time are no sign of a clock that stands still.
MIN_STOPPED_POSITIONS = 3

#: A log of more points than these is refused if only one of them can be used.
MAX_TINY_LOG_POINTS = 2

#: Seconds from 1970 between which times are dates in messages.
_DATE_RANGE = (1e8, 2.5e11)


#: What is wrong with times of day that go back.
TIME_OF_DAY_GOES_BACK = "the time of day goes back, perhaps at midnight, and there is no date; add a column named date, or start a new track there: --split"


@dataclass(frozen=True)
class RepeatedTimes:
    """Rows, grouped by track and in the order of time, at a time that a row of the track before has already.

    Parameters
    ----------
    same_position : bool array, shape (n,)
        Those at the same position as the first row of this time.
    other_position : bool array, shape (n,)
        Those at another position.
    """

    same_position: NDArray[np.bool_]
    other_position: NDArray[np.bool_]

    @property
    def first(self) -> NDArray[np.bool_]:
        """The rows that are none."""
        return ~(self.same_position | self.other_position)


def find_repeated_times(
    times: NDArray[np.float64], places: NDArray[np.float64], starts: NDArray[np.bool_]
) -> RepeatedTimes:
    """Find rows at a time that a row before has already.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Not decreasing within a track.
    places : float64 array, shape (n, d)
        Coordinates.
    starts : bool array, shape (n,)
        Where a track starts.
    """
    first = starts.copy()
    first[:1] = True
    first[1:] |= times[1:] != times[:-1]
    kept = np.maximum.accumulate(np.where(first, np.arange(len(times)), 0))
    same = np.asarray((places == places[kept]).all(axis=1))
    return RepeatedTimes(~first & same, ~first & ~same)


def find_large_losses(raw: RawLog, rows: NDArray[np.intp], doubles: RepeatedTimes) -> list[Loss]:
    """Find the tracks of a log that lose many points.

    Parameters
    ----------
    raw : RawLog
        The log.
    rows : int array, shape (n,)
        Rows that can be used, grouped by track and in the order of time.
    doubles : Doubles
        Which of these rows are at a time that is there already.
    """
    # Count the rows of each track: all, those that can be used, and those elsewhere at a time that is taken.
    codes = np.zeros(len(raw.times), np.int64) if raw.codes is None else raw.codes
    tracks = max(len(raw.ids), 1)
    own = codes[rows]
    points = np.bincount(codes, minlength=tracks)
    elsewhere = np.bincount(own[doubles.other_position], minlength=tracks)
    lost = points - np.bincount(own, minlength=tracks) + elsewhere

    # The most of a track's points that share one time.
    number = np.cumsum(doubles.first) - 1
    together = np.bincount(number[doubles.other_position], minlength=int(doubles.first.sum()))
    shared = np.zeros(tracks, np.int64)
    np.maximum.at(shared, own[doubles.first], np.where(together > 0, together + 1, 0))

    names = raw.ids or ("",)
    many = np.flatnonzero(
        (lost > 0) & ((lost > _LARGE_LOSS_SHARE * points) | (shared >= _MIN_SIMULTANEOUS_POINTS))
    ).tolist()
    return [Loss(names[i], raw.name, int(lost[i]), int(points[i]), int(shared[i])) for i in many]


def loss_if_large(track: str, where: str, lost: int, points: int, shared: int = 0) -> list[Loss]:
    """Return the loss of one track, if it is large enough to be told first."""
    return (
        [Loss(track, where, lost, points, shared)]
        if lost and (lost > _LARGE_LOSS_SHARE * points or shared >= _MIN_SIMULTANEOUS_POINTS)
        else []
    )


def find_stopped_tracks(raw: RawLog, rows: NDArray[np.intp], doubles: RepeatedTimes) -> list[int]:
    """Codes of the tracks of which only one time is left for several positions; parameters as of :func:`find_large_losses`."""
    own = np.zeros(len(rows), np.int64) if raw.codes is None else raw.codes[rows]
    tracks = max(len(raw.ids), 1)
    times = np.bincount(own[doubles.first], minlength=tracks)
    places = 1 + np.bincount(own[doubles.other_position], minlength=tracks)
    return np.flatnonzero((times == 1) & (places >= MIN_STOPPED_POSITIONS)).tolist()


def stopped_clock_error(where: str, track: str, points: int, time: float) -> InputError:
    """Return the error for a track whose points all have the same time."""
    when = (
        f"{np.datetime64(round(time), 's')}Z"
        if _DATE_RANGE[0] <= time <= _DATE_RANGE[1]
        else f"{time:.15g} s"
    )
    whose = f" of track {track!r}" if track else ""
    return InputError(
        f"{where}: all {points:,} points{whose} have the same time, {when}; name the right column with --columns t=COLUMN, "
        "or take the times out to read the points as a shape"
    )


def nearly_lost_error(where: str, points: int, word: str, repairs: Sequence[Repair]) -> InputError:
    """Return the error for a log of which one point is left of many."""
    causes = ", ".join(
        f"{one.count:,} {one.what}" + (f" ({one.value})" if one.value else "")
        for one in repairs
        if one.drops
    )
    return InputError(
        f"{where}: only 1 of {points:,} {word}s can be used: {causes}; name the right columns with --columns"
    )
