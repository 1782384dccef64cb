"""Time ranges in which a track stays in place, however much its fixes wander.

The positions between fixes are taken to be linear in time. Then the mean and the spread of the
positions in any window of time follow from two running integrals, so that all windows of a track
take one pass, whether the phone wrote fixes each second or each hour. A window in which the spread
is within what a place and the errors of its fixes explain is one of a stay: a red light and a jam
are none, as the windows are longer than the one, and the other moves on.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.history.stays.fixes import Fixes, lengths
from gpszip.history.stays.values import Halt

__all__ = ["find_halts", "still_ranges"]

#: The spread within a place of a radius r, as a share of r: what a uniform line of length
#: 2 r sqrt(3) / 2 has, so that whoever moves at r sqrt(3) in a window (0.6 m/s for 100 m in 5 min)
#: or faster doesn't stay.
_SPREAD_SHARE = 0.5

#: Windows begin this share of their length apart, or more.
_STEPS_OF_WINDOW = 60

#: Fixes that are integrated at once, about positions of their own: the squares of far positions
#: would leave no digits for spreads.
_BLOCK = 1 << 16

#: Metres around the centre of a place that belong to it in any case, but no more than a share of
#: its radius.
_MIN_REACH = 30.0
_MIN_REACH_SHARE = 0.3

#: Reach of a place as a multiple of the median distance of its fixes from their centre.
_REACH_FACTOR = 2.0

#: Fixes of half a halt whose errors are taken to be independent, at most.
_MAX_INDEPENDENT = 4.0

#: Positions of a halt at even times from which its centre is computed: twice its fixes, but within
#: these bounds; more change it by little.
_MIN_SAMPLES = 21
_MAX_SAMPLES = 2001

#: Relative error of distances that are equal but for rounding: the ends of a step at one speed are
#: exactly at the reach.
_ROUNDING = 1e-9

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def find_halts(
    fixes: Fixes, window: float, radius: float, beyond: tuple[Floats, float] | None = None
) -> list[Halt]:
    """Find where a track stays within a radius for the length of a window.

    Parameters
    ----------
    fixes : Fixes
        A track.
    window : float
        Seconds; the shortest halt.
    radius : float
        Metres; the size of a place.
    beyond : tuple of (float64 array, shape (d,), float), optional
        A position, and metres from it within which halts need not be found.

    Returns
    -------
    list of Halt
        In the order of time. Two in succession may be at one place, with a move between.

    Examples
    --------
    >>> x = np.interp(np.arange(0, 1801, 10), [0, 600, 1200, 1800], [0, 0, 3000, 3000])
    >>> times, noise = np.arange(0.0, 1801, 10), np.full(181, 10.0)
    >>> fixes = Fixes(times, x[:, None], noise)
    >>> [(each.first, each.last) for each in find_halts(fixes, 300.0, 100.0)]
    [(0, 60), (120, 180)]
    """
    # Windows within which the track is still, cut where it must have moved unseen or slowly.
    halts = []
    for begin, end in still_ranges(fixes, window, radius).tolist():
        first = int(np.searchsorted(fixes.times, begin, side="left"))
        last = int(np.searchsorted(fixes.times, end, side="right")) - 1
        if first <= last and _reaches(fixes, first, last, beyond, radius):
            parts = _split_at_jumps(fixes, first, last, window, radius)
            halts += [
                part
                for start, after in parts
                for part in _split_at_drift(fixes, start, after, window, radius)
            ]

    # The fixes at the place, without those on the way to it and from it.
    return [_trim(fixes, first, last, radius) for first, last in halts]


def _reaches(
    fixes: Fixes, first: int, last: int, beyond: tuple[Floats, float] | None, radius: float
) -> bool:
    """Whether some fixes lie, within a radius, beyond a distance from a position."""
    if beyond is None:
        return True
    position, metres = beyond
    return bool(_distances(fixes.positions[first : last + 1], position).max() >= metres - radius)


# Windows.


def still_ranges(fixes: Fixes, window: float, radius: float) -> Floats:
    """Time ranges that are covered by windows in which the track is still.

    Returns
    -------
    float64 array, shape (k, 2)
        Seconds at which each begins and ends, in order and apart.
    """
    # Windows that begin at a fix, and windows that end at one.
    times = fixes.times
    begins = np.concatenate([times, times - window])
    begins = begins[(begins >= times[0]) & (begins + window <= times[-1])]
    begins.sort()

    # The first one in each sixtieth of a window: others hardly differ from it.
    bucket = np.floor(begins / (window / _STEPS_OF_WINDOW))
    begins = begins[np.append(True, np.diff(bucket) > 0)[: len(begins)]]

    # Those in which the track is still, and long steps in which all windows are alike.
    _, variance, noise = _window_moments(fixes, begins, window)
    begins = begins[variance <= (_SPREAD_SHARE * radius) ** 2 + noise]
    steps = np.diff(times)
    distances = lengths(np.diff(fixes.positions, axis=0))
    slow = np.flatnonzero((steps >= window) & (distances <= _max_speed(window, radius) * steps))

    # All of them, joined where they overlap.
    starts = np.concatenate([begins, times[slow]])
    ends = np.concatenate([begins + window, times[slow + 1]])
    order = np.argsort(starts, kind="stable")
    starts, ends = starts[order], np.maximum.accumulate(ends[order])
    first = np.append(True, starts[1:] > ends[:-1]) if len(starts) else np.zeros(0, np.bool_)
    last = np.append(first[1:], True) if len(starts) else first
    return np.stack([starts[first], ends[last]], axis=1)


def _max_speed(window: float, radius: float) -> float:
    """Speed in m/s of a straight line whose spread in a window is that of a place."""
    return math.sqrt(12) * _SPREAD_SHARE * radius / window


class _Integrals(NamedTuple):
    """Integrals over time from the first of some fixes to each of them.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds.
    values : float64 array, shape (n, c)
        What is linear in time between the fixes: positions, and the square of their error.
    first : float64 array, shape (n, c)
        Integrals of the values.
    second : float64 array, shape (n,)
        Integral of the squares of the positions.
    """

    times: Floats
    values: Floats
    first: Floats
    second: Floats

    def at(self, times: Floats) -> tuple[Floats, Floats]:
        """Return both integrals at times within those of the fixes."""
        # The last fix before each time, and the share of the step to the next.
        row = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        after = times - self.times[row]
        share = after / (self.times[row + 1] - self.times[row])
        start = self.values[row]
        end = start + (self.values[row + 1] - start) * share[:, None]
        return (
            self.first[row] + _trapezoid(start, end, after),
            self.second[row] + _square_integral(start[:, :-1], end[:, :-1], after),
        )


def _window_moments(fixes: Fixes, begins: Floats, window: float) -> tuple[Floats, Floats, Floats]:
    """Return the mean, the mean square distance from it, and the mean square error of windows.

    Parameters
    ----------
    fixes : Fixes
        A track.
    begins : float64 array, shape (m,)
        Seconds at which windows begin, in order, from the first fix on.
    window : float
        Their length; none goes on beyond the last fix.

    Returns
    -------
    float64 arrays, shape (m, d), (m,) and (m,)
    """
    mean = np.zeros((len(begins), fixes.positions.shape[1]))
    variance, noise = np.zeros(len(begins)), np.zeros(len(begins))

    # Windows that begin in a block of fixes, with all fixes that they need.
    starts = np.arange(0, len(fixes), _BLOCK)
    bounds = [*np.searchsorted(begins, fixes.times[starts]).tolist(), len(begins)]
    for start, low, high in zip(starts.tolist(), bounds[:-1], bounds[1:], strict=True):
        if low == high:
            continue
        after = int(np.searchsorted(fixes.times, begins[high - 1] + window)) + 1
        integrals = _integrate(fixes, slice(start, max(after, start + 2)))
        first_0, second_0 = integrals.at(begins[low:high])
        first_1, second_1 = integrals.at(begins[low:high] + window)

        # Positions are about that of the first fix of the block.
        means = (first_1 - first_0) / window
        mean[low:high] = means[:, :-1] + fixes.positions[start]
        variance[low:high] = (second_1 - second_0) / window - _dot(means[:, :-1], means[:, :-1])
        noise[low:high] = means[:, -1]
    return mean, variance, noise


def _integrate(fixes: Fixes, rows: slice) -> _Integrals:
    times = fixes.times[rows]
    positions = fixes.positions[rows] - fixes.positions[rows.start]
    values = np.column_stack([positions, fixes.noise[rows] ** 2])
    steps = np.diff(times)
    first = np.cumsum(_trapezoid(values[:-1], values[1:], steps), axis=0)
    second = np.cumsum(_square_integral(positions[:-1], positions[1:], steps))
    return _Integrals(
        times, values, np.concatenate([np.zeros((1, values.shape[1])), first]), np.append(0, second)
    )


def _trapezoid(start: Floats, end: Floats, duration: Floats) -> Floats:
    """Return the integral of a linear function over a duration."""
    area: Floats = (start + end) / 2 * duration[:, None]
    return area


def _square_integral(start: Floats, end: Floats, duration: Floats) -> Floats:
    """Return the integral of the square of a linear function over a duration."""
    squares = _dot(start, start) + _dot(start, end) + _dot(end, end)
    area: Floats = squares / 3 * duration
    return area


def _dot(one: Floats, other: Floats) -> Floats:
    # Several times as fast as a sum over the short axis.
    products: Floats = np.einsum("ij,ij->i", one, other)
    return products


# What windows can't tell.


def _split_at_jumps(
    fixes: Fixes, first: int, last: int, window: float, radius: float
) -> list[tuple[int, int]]:
    """Cut fixes at steps of a window or longer that lead away: the move itself was not seen."""
    rows = slice(first, last + 1)
    steps = lengths(np.diff(fixes.positions[rows], axis=0))
    noise = fixes.noise[rows][1:] + fixes.noise[rows][:-1]
    cuts = np.flatnonzero((np.diff(fixes.times[rows]) >= window) & (steps > radius + noise))
    bounds = [first, *(first + 1 + cuts).tolist(), last + 1]
    parts = [(start, after - 1) for start, after in pairwise(bounds)]
    if len(parts) == 1:
        return parts

    # A short part in which it moves is no halt, but one fix at each gap beside it.
    halts: list[tuple[int, int]] = []
    for number, (start, end) in enumerate(parts):
        if not _moves(fixes, start, end, window, radius):
            halts.append((start, end))
            continue
        if number > 0:
            halts.append((start, start))
        if number < len(parts) - 1:
            halts.append((end, end))
    return halts


def _moves(fixes: Fixes, first: int, last: int, window: float, radius: float) -> bool:
    """Whether some fixes of less than a window are on the way, apart from those at their ends."""
    halt = _trim(fixes, first, last, radius)
    duration = float(fixes.times[halt.last] - fixes.times[halt.first])
    if halt.first == halt.last or duration >= window:
        return first != last and duration < window
    way = math.dist(fixes.positions[halt.first], fixes.positions[halt.last])
    return way - halt.noise > _max_speed(window, radius) * duration


def _split_at_drift(
    fixes: Fixes, first: int, last: int, window: float, radius: float
) -> list[tuple[int, int]]:
    """Cut fixes where their mean over a window leaves the place, as on a walk to the next one.

    Parts that go on are left out: large errors hide a walk from the windows.
    """
    times = fixes.times[first : last + 1]
    if times[-1] - times[0] < 2 * window:
        return [(first, last)]
    positions, _ = _sample(fixes, first, last)
    centre = np.array([np.median(axis) for axis in positions.T])

    # Means of windows around fixes, which the place and their errors don't explain.
    own = Fixes(times, fixes.positions[first : last + 1], fixes.noise[first : last + 1])
    begins = np.clip(times - window / 2, times[0], times[-1] - window)
    means, _, noise = _window_moments(own, begins, window)
    away = _distances(means, centre) > radius + np.sqrt(noise)
    if not away.any():
        return [(first, last)]

    # Runs of fixes here and elsewhere, each cut again unless it is all there is.
    bounds = [0, *(np.flatnonzero(np.diff(away.astype(np.int8))) + 1).tolist(), len(times)]
    if len(bounds) == 2:
        return [(first, last)]
    return [
        part
        for start, after in pairwise(bounds)
        for part in _split_at_drift(fixes, first + start, first + after - 1, window, radius)
        if not _goes_on(fixes, *part, window, radius)
    ]


def _goes_on(fixes: Fixes, first: int, last: int, window: float, radius: float) -> bool:
    """Whether the means of both halves of some fixes lie too far apart for a halt."""
    duration = float(fixes.times[last] - fixes.times[first])
    positions, errors = _sample(fixes, first, last)
    half = len(positions) // 2
    way = math.dist(positions[:half].mean(axis=0), positions[-half:].mean(axis=0))

    # Errors last for several fixes, so that few of them count.
    count = min((last - first + 1) / 2, _MAX_INDEPENDENT)
    noise = float(np.median(errors)) / math.sqrt(max(count, 1.0))
    return way - noise > _max_speed(window, radius) * duration / 2


def _trim(fixes: Fixes, first: int, last: int, radius: float) -> Halt:
    """Return the halt of some fixes, from the first to the last one at the place."""
    # The centre: the median over time, which travel at the ends of the halt hardly moves.
    positions, errors = _sample(fixes, first, last)
    weights = 1.0 / errors
    centre = np.array([_weighted_median(axis, weights) for axis in positions.T])
    noise = float(np.median(errors))

    # How far fixes at the place are from there, and the first and the last of them.
    typical = _weighted_median(_distances(positions, centre), weights)
    reach = min(
        max(min(_MIN_REACH, _MIN_REACH_SHARE * radius), _REACH_FACTOR * typical, noise),
        radius + noise,
    )
    distances = _distances(fixes.positions[first : last + 1], centre)
    inside = np.flatnonzero(distances <= reach * (1 + _ROUNDING))
    if not len(inside):
        return Halt(first, last, centre, noise, reach, typical)
    return Halt(first + int(inside[0]), first + int(inside[-1]), centre, noise, reach, typical)


def _sample(fixes: Fixes, first: int, last: int) -> tuple[Floats, Floats]:
    """Return positions and errors at even times from one fix to another."""
    own = fixes.times[first : last + 1]
    times = np.linspace(own[0], own[-1], min(max(2 * len(own), _MIN_SAMPLES), _MAX_SAMPLES))
    positions = np.stack(
        [np.interp(times, own, axis) for axis in fixes.positions[first : last + 1].T], axis=1
    )
    return positions, np.interp(times, own, fixes.noise[first : last + 1])


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _distances(positions: Floats, centre: Floats) -> Floats:
    return lengths(positions - centre)
