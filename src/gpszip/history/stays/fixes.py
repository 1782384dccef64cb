"""The fixes of a track that tell where it was, each with the size of its error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.geo.outliers import (
    SPEED_FACTOR,
    SPEED_QUANTILE,
    mark_outliers,
    min_adjacent_speeds,
)

__all__ = [
    "DEFAULT_NOISE",
    "MAX_ACCELERATION",
    "MAX_SPEED",
    "MIN_NOISE",
    "Fixes",
    "add_travel",
    "choose_fixes",
    "lengths",
]

#: Metres per second that no traveller on the ground exceeds: fast trains travel at up to 97 m/s. A
#: step that is faster is an error of the receiver, or a flight.
MAX_SPEED = 100.0

#: Metres; the least error of a fix. Receivers state less, but their errors last for minutes.
MIN_NOISE = 5.0

#: Metres; the error of a fix that states none: a phone under open sky, with some margin.
DEFAULT_NOISE = 15.0

#: Metres up to which a fix is used in any case. Satellites give less, WiFi up to about this, and
#: cells of a network more.
_GOOD_NOISE = 100.0

#: A fix whose error is this many times that of the best one around is left out.
_NOISE_RATIO = 3.0

#: Seconds; the best fix around is looked for in its own interval of this length, the one before
#: and the one after.
_NOISE_INTERVAL = 300.0

#: Metres per second from which a way there and back, with a few fixes at its far end, is an
#: outlier: nobody turns at 110 km/h.
_MIN_JUMP_SPEED = 30.0

#: Steps shorter than this share of the median count as that long, as for outliers of logs.
_MIN_INTERVAL_SHARE = 0.5

#: Fixes that are left out if they lead away and back at once, and the seconds in which they must do
#: so: no stay of minutes fits into these, and a single fix shows no trip.
_EXCURSIONS = ((1, 900.0), (2, 300.0), (3, 300.0), (4, 300.0))

#: The ways there and back are longer than this factor times the step that skips these fixes, or
#: than the errors of the fixes around.
_EXCURSION_RATIO = 4.0

#: Seconds of the longest run of fixes at a wrong place that is left out.
_MAX_ISLAND = 900.0

#: Metres per second squared by which travellers speed up and slow down at most, on average over a
#: way from rest to rest: buses and trains at about 1.
MAX_ACCELERATION = 1.0

#: Metres of a step from which positions are added on its way.
_MIN_TRAVEL = 50.0

#: Shares of a step at which they are added.
_QUARTERS = np.array([0.25, 0.5, 0.75])

#: Fixes at exactly one position that are taken for one that a receiver repeats without a new one,
#: if a step at an impossible speed follows.
_MIN_REPEATS = 2

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Fixes:
    """Times and positions of one track, with the size of their errors.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds, strictly increasing.
    positions : float64 array, shape (n, d)
        Metres.
    noise : float64 array, shape (n,)
        Metres within which the true position is in two of three cases, as phones state it.
    """

    times: Floats
    positions: Floats
    noise: Floats

    def __len__(self) -> int:
        return len(self.times)

    def take(self, rows: Bools) -> Fixes:
        """Return some of the fixes."""
        return Fixes(self.times[rows], self.positions[rows], self.noise[rows])


def choose_fixes(
    times: ArrayLike,
    positions: ArrayLike,
    accuracy: ArrayLike | None = None,
    *,
    noise: float = DEFAULT_NOISE,
    min_noise: float = MIN_NOISE,
) -> Fixes:
    """Choose the fixes of a track that tell where it was.

    1. A fix has the error that it states. One without, or with an error of 0, which phones write
       where they don't know, has a common one.
    2. Fixes with an error of more than 100 m are left out where much better ones are around.
    3. Outliers, which jump away and back, are left out, also if they last for minutes.
    4. Positions that a receiver repeats while it travels on are left out: those before a step at
       an impossible speed.

    Parameters
    ----------
    times : array_like, shape (n,)
        Seconds, strictly increasing.
    positions : array_like, shape (n, d)
        Metres.
    accuracy : array_like, shape (n,), optional
        Errors in metres that the log states; NaN or 0 where it states none.
    noise : float
        Error in metres of fixes that state none.
    min_noise : float
        Least error in metres of any fix.

    Returns
    -------
    Fixes

    Examples
    --------
    >>> places = [[0, 0], [3, 0], [2000, 0], [6, 0], [9, 0]]
    >>> choose_fixes(range(5), places, [10, 10, 1500, 10, 10]).times.tolist()
    [0.0, 1.0, 3.0, 4.0]
    """
    # Errors.
    times, positions = np.asarray(times, np.float64), np.asarray(positions, np.float64)
    stated = np.full(len(times), np.nan) if accuracy is None else np.asarray(accuracy, np.float64)
    known = np.isfinite(stated) & (stated > 0)
    errors = np.maximum(np.where(known, stated, noise), min_noise)
    fixes = Fixes(times, positions, errors)

    # Fixes that tell nothing.
    fixes = fixes.take(~_is_poor(fixes))
    fixes = _drop_excursions(fixes.take(~_is_outlier(fixes)))
    fixes = _drop_islands(fixes)
    return fixes.take(~_is_repeated(fixes))


def add_travel(fixes: Fixes, longest: float) -> Fixes:
    """Add positions on the way of steps that are travel, though they are single steps.

    A trip along one straight line at one speed has no knot on its way in an archive.

    Parameters
    ----------
    fixes : Fixes
        Knots, between which the track is linear in time.
    longest : float
        Seconds; longer steps stay as they are.

    Examples
    --------
    >>> fixes = Fixes(np.array([0.0, 60.0]), np.array([[0.0], [400.0]]), np.array([5.0, 5.0]))
    >>> add_travel(fixes, 300.0).positions[:, 0].tolist()
    [0.0, 100.0, 200.0, 300.0, 400.0]
    """
    # Steps that lead away, and not faster than from rest to rest.
    durations, distances = np.diff(fixes.times), lengths(np.diff(fixes.positions, axis=0))
    is_travel = (distances > _MIN_TRAVEL) & (durations <= longest)
    rows = np.flatnonzero(is_travel & (durations**2 > 4 * distances / MAX_ACCELERATION))

    # Positions at their quarters.
    inner = fixes.times[rows][:, None] + durations[rows][:, None] * _QUARTERS
    times = np.union1d(fixes.times, inner)
    line = [np.interp(times, fixes.times, axis) for axis in fixes.positions.T]
    return Fixes(times, np.stack(line, axis=1), np.interp(times, fixes.times, fixes.noise))


def _is_poor(fixes: Fixes) -> Bools:
    """Whether each fix has a large error, and a much better one is around."""
    # The least error in each interval of time; most intervals of a long log are empty.
    interval = np.floor(fixes.times / _NOISE_INTERVAL).astype(np.int64)
    starts = np.flatnonzero(np.append(True, np.diff(interval) != 0))
    best = np.minimum.reduceat(fixes.noise, starts)
    around = best.copy()
    is_next = np.diff(interval[starts]) == 1
    around[1:][is_next] = np.minimum(around[1:][is_next], best[:-1][is_next])
    around[:-1][is_next] = np.minimum(around[:-1][is_next], best[1:][is_next])

    nearby = np.repeat(around, np.diff(np.append(starts, len(fixes))))
    poor: Bools = (fixes.noise > _GOOD_NOISE) & (fixes.noise > _NOISE_RATIO * nearby)
    return poor


def _is_repeated(fixes: Fixes) -> Bools:
    """Whether each fix repeats the position of the one before, up to an impossible step."""
    steps = lengths(np.diff(fixes.positions, axis=0))
    same = np.append(False, steps == 0)
    speeds = steps / np.diff(fixes.times)

    # Runs of one position, by the number of the fix that begins each.
    run = np.cumsum(~same) - 1
    first = np.flatnonzero(~same)
    last = np.append(first[1:], len(fixes)) - 1
    is_frozen = (last - first >= _MIN_REPEATS - 1) & (np.append(speeds, 0.0)[last] > MAX_SPEED)
    repeated: Bools = same & is_frozen[run]
    return repeated


def _drop_excursions(fixes: Fixes) -> Fixes:
    """Leave out few fixes that lead far away and back at once.

    A run of fixes is left out if the steps to it and from it are much longer than the step that
    skips it. Where a traveller turns back, this takes the last few fixes before and after the turn.
    """
    for run, longest in _EXCURSIONS:
        if len(fixes) < run + 2:
            continue
        times, positions, noise = fixes.times, fixes.positions, fixes.noise
        skip = lengths(positions[run + 1 :] - positions[: -run - 1])
        skip = np.maximum(skip, noise[run + 1 :] + noise[: -run - 1])
        steps = lengths(np.diff(positions, axis=0))
        there, back = steps[: len(skip)], steps[run:]
        brief = times[run + 1 :] - times[: -run - 1] <= longest
        starts = np.flatnonzero(brief & (np.minimum(there, back) > _EXCURSION_RATIO * skip)) + 1

        # Without these; runs that overlap are left out both.
        kept = np.ones(len(fixes), np.bool_)
        for offset in range(run):
            kept[starts + offset] = False
        fixes = fixes.take(kept)
    return fixes


def lengths(differences: Floats) -> Floats:
    """Lengths of vectors, shape (n, d)."""
    # Several times as fast as a sum over the short axis.
    found: Floats = np.sqrt(np.einsum("ij,ij->i", differences, differences))
    return found


def _drop_islands(fixes: Fixes) -> Fixes:
    """Leave out runs of fixes to which a track jumps, and from which it jumps, for minutes.

    Its way without them is possible: a wrong place that lasts, as in a tunnel.
    """
    if len(fixes) < 3:
        return fixes
    distances = lengths(np.diff(fixes.positions, axis=0)) - fixes.noise[1:] - fixes.noise[:-1]
    jumps = np.flatnonzero(distances > MAX_SPEED * np.diff(fixes.times))
    kept, last = np.ones(len(fixes), np.bool_), -1
    for before, end in pairwise(jumps.tolist()):
        # Between two jumps, unless the first one ends a run that is left out.
        duration = float(fixes.times[end + 1] - fixes.times[before])
        distance = float(np.linalg.norm(fixes.positions[end + 1] - fixes.positions[before]))
        if before > last and duration <= _MAX_ISLAND and distance <= MAX_SPEED * duration:
            kept[before + 1 : end + 1], last = False, end
    return fixes.take(kept)


def _is_outlier(fixes: Fixes) -> Bools:
    """Whether each fix jumps away and back, faster than the track and than any car."""
    if len(fixes) < 3:
        return np.zeros(len(fixes), np.bool_)
    min_interval = _MIN_INTERVAL_SHARE * float(np.median(np.diff(fixes.times)))
    speeds = min_adjacent_speeds(fixes.times, fixes.positions, min_interval)
    moving = speeds[speeds > 0]
    usual = float(np.quantile(moving, SPEED_QUANTILE)) if len(moving) else 0.0
    limit = max(SPEED_FACTOR * usual, _MIN_JUMP_SPEED)
    return mark_outliers(fixes.times, fixes.positions, min_interval, limit)
