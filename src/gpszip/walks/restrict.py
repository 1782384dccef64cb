"""Walks restricted to a time range and an area, knot by knot.

The knots that remain are those of the walk itself. Travel is claimed only within the intervals that
remain, as :class:`gpszip.model.walk.Walk` keeps them in ``time_ranges``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.model.selection import BoundingBox
from gpszip.model.walk import Walk, cut_at_gaps

__all__ = [
    "RestrictedKnots",
    "find_intervals",
    "restrict_knots",
    "restrict_shape",
    "segments_in_box",
]

#: Degrees of a full turn.
_FULL_TURN = 360.0

Floats = NDArray[np.float64]


class RestrictedKnots(NamedTuple):
    """What remains of a walk.

    Parameters
    ----------
    knots : int array, shape (k + 1,)
        Indices of the knots that remain.
    gaps : bool array, shape (k,)
        Whether each segment between them is a gap.
    time_ranges : float64 array, shape (pieces, 2)
        Seconds at which travel begins and ends in each piece; empty for a walk without times.
    """

    knots: NDArray[np.intp]
    gaps: NDArray[np.bool_]
    time_ranges: Floats


def find_intervals(
    walk: Walk,
    coordinates: Floats,
    *,
    time_range: tuple[float, float],
    bbox: BoundingBox | None,
    geographic: bool,
) -> list[Floats]:
    """Find when a walk with times travels in a time range and an area.

    Parameters
    ----------
    walk : Walk
        With times.
    coordinates : float64 array, shape (k + 1, d)
        Position of each knot in the coordinates of the log: latitude and longitude, or x and y.
    time_range : tuple of float
        Seconds; may be infinite.
    bbox : BoundingBox or None
        The area; between two knots, coordinates are taken as linear.
    geographic : bool
        Whether coordinates are degrees.

    Returns
    -------
    list of float64 array, shape (n, 2)
        For each piece of the walk the times at which such travel begins and ends, in order.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 10.0]), np.array([False]))
    >>> box = BoundingBox(2, -1, 5, 1)
    >>> line = np.array([[0.0, 0.0], [10.0, 0.0]])
    >>> find_intervals(walk, line, time_range=(3.0, np.inf), bbox=box, geographic=False)
    [array([[3., 5.]])]
    """
    assert walk.times is not None
    intervals = []
    for number, knots in enumerate(cut_at_gaps(walk)):
        # Travel in the area, or all of the piece.
        times = walk.times[knots]
        found = np.array([[times[0], times[-1]]])
        if bbox is not None:
            inside = segments_in_box(coordinates[knots], bbox, geographic=geographic)
            found = _join_touching(_to_times(times, inside))

        # Of that, what lies in the time range, and is claimed.
        ends = times[[0, -1]] if walk.time_ranges is None else walk.time_ranges[number]
        begin, end = max(time_range[0], ends[0]), min(time_range[1], ends[1])
        found = np.stack([np.maximum(found[:, 0], begin), np.minimum(found[:, 1], end)], axis=1)
        intervals.append(found[found[:, 0] <= found[:, 1]])
    return intervals


def restrict_knots(walk: Walk, intervals: list[Floats]) -> RestrictedKnots | None:
    """Keep the knots that the travel in some intervals needs.

    Each interval needs the last knot before it, the first one after it, and all between. Two
    intervals of a piece may need the same knot, which then stands twice, with a gap between.

    Parameters
    ----------
    walk : Walk
        With times.
    intervals : list of float64 array, shape (n, 2)
        For each piece, as :func:`find_intervals` returns them.

    Returns
    -------
    RestrictedKnots or None
        None if no interval is left.

    Examples
    --------
    >>> times = np.array([0.0, 10.0, 20.0])
    >>> walk = Walk("a", np.arange(3, dtype=np.int32), times, np.zeros(2, bool))
    >>> restricted = restrict_knots(walk, [np.array([[12.0, 15.0]])])
    >>> restricted.knots.tolist(), restricted.time_ranges.tolist()
    ([1, 2], [[12.0, 15.0]])
    """
    assert walk.times is not None
    ranges: list[tuple[int, int]] = []
    time_ranges: list[list[float]] = []
    for knots, of_piece in zip(cut_at_gaps(walk), intervals, strict=True):
        times = walk.times[knots]
        for begin, end in of_piece.tolist():
            # The knots around the interval, of this piece.
            first = knots.start + max(int(np.searchsorted(times, begin, side="right")) - 1, 0)
            last = knots.start + min(int(np.searchsorted(times, end)), len(times) - 1)

            ranges.append((first, last))
            time_ranges.append([begin, end])
    return _restricted(ranges, np.array(time_ranges)) if ranges else None


def restrict_shape(
    walk: Walk, coordinates: Floats, bbox: BoundingBox, *, geographic: bool
) -> RestrictedKnots | None:
    """Keep the segments of a walk without times that touch an area, as they are.

    Parameters
    ----------
    walk : Walk
        The walk.
    coordinates : float64 array, shape (k + 1, d)
        Position of each knot in the coordinates of the log.
    bbox : BoundingBox
        The area.
    geographic : bool
        Whether coordinates are degrees.

    Returns
    -------
    RestrictedKnots or None
        None if no segment touches the area.
    """
    ranges = []
    for knots in cut_at_gaps(walk):
        # A piece of one knot has no segment; its knot counts.
        inside = segments_in_box(coordinates[knots], bbox, geographic=geographic)
        touches = np.concatenate([[False], ~np.isnan(inside[:, 0]), [False]])
        changes = np.flatnonzero(np.diff(touches.astype(np.int8)))
        last = knots.stop - 1
        for start, stop in zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True):
            ranges.append((knots.start + start, min(knots.start + stop, last)))
    return _restricted(ranges, np.zeros((0, 2))) if ranges else None


def segments_in_box(coordinates: Floats, bbox: BoundingBox, *, geographic: bool) -> Floats:
    """Find which share of each segment lies in an area, by clipping at its four sides.

    Parameters
    ----------
    coordinates : float64 array, shape (k + 1, d)
        Position of each knot: latitude and longitude in degrees, or x and y.
    bbox : BoundingBox
        The area, sides included.
    geographic : bool
        Whether coordinates are degrees. Segments go the short way around the globe.

    Returns
    -------
    float64 array, shape (max(k, 1), 2)
        Where each segment enters and leaves the area, from 0 at its first knot to 1 at its second;
        NaN if it lies outside. A single knot counts as a segment of no length.

    Examples
    --------
    >>> line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    >>> segments_in_box(line, BoundingBox(5, -1, 20, 1), geographic=False).tolist()
    [[0.5, 1.0], [0.0, 0.1]]
    """
    x, y = (coordinates[:, 1], coordinates[:, 0]) if geographic else coordinates[:, :2].T
    if len(x) == 1:
        x, y = np.repeat(x, 2), np.repeat(y, 2)
    if not geographic:
        return _clip(x, y, (bbox.west, bbox.east), (bbox.south, bbox.north))

    # Longitudes without jumps at 180 degrees; the area repeats with every turn.
    x = np.unwrap(x, period=_FULL_TURN)
    first = np.floor((x.min() - bbox.west - bbox.width) / _FULL_TURN)
    last = np.ceil((x.max() - bbox.west) / _FULL_TURN)
    inside = np.full((len(x) - 1, 2), np.nan)
    for turn in np.arange(first, last + 1):
        west = bbox.west + turn * _FULL_TURN
        found = _clip(x, y, (west, west + bbox.width), (bbox.south, bbox.north))
        inside = np.stack(
            [np.fmin(inside[:, 0], found[:, 0]), np.fmax(inside[:, 1], found[:, 1])], axis=1
        )
    return inside


def _clip(
    x: Floats, y: Floats, x_range: tuple[float, float], y_range: tuple[float, float]
) -> Floats:
    """Shares of segments within ranges of both axes, shape (k, 2); NaN where there is none."""
    enters, leaves = np.zeros(len(x) - 1), np.ones(len(x) - 1)
    for values, (low, high) in ((x, x_range), (y, y_range)):
        # A segment along the side of the area is inside or outside as a whole.
        start, step = values[:-1], np.diff(values)
        is_level = step == 0
        divisor = np.where(is_level, 1.0, step)
        at_low, at_high = (low - start) / divisor, (high - start) / divisor
        is_inside = (start >= low) & (start <= high)
        own_enters = np.where(is_level, 0.0, np.minimum(at_low, at_high))
        own_leaves = np.where(is_level, np.where(is_inside, 1.0, -1.0), np.maximum(at_low, at_high))
        enters, leaves = np.maximum(enters, own_enters), np.minimum(leaves, own_leaves)
    shares = np.stack([enters, leaves], axis=1)
    shares[enters > leaves] = np.nan
    return shares


def _to_times(times: Floats, inside: Floats) -> Floats:
    """Times at which segments enter and leave an area, shape (n, 2), of those that touch it."""
    # A piece of one knot has one time.
    if len(times) == 1:
        return np.repeat(times[:, None], 2, axis=1)[~np.isnan(inside[:, 0])]
    begin, step = times[:-1, None], np.diff(times)[:, None]
    found = np.where(inside == 1, times[1:, None], begin + inside * step)
    return found[~np.isnan(inside[:, 0])]


def _join_touching(intervals: Floats) -> Floats:
    """Join intervals that begin where the one before ends; they are in order."""
    if not len(intervals):
        return intervals
    starts = np.append(True, intervals[1:, 0] > intervals[:-1, 1])
    stops = np.append(starts[1:], True)
    return np.stack([intervals[starts, 0], intervals[stops, 1]], axis=1)


def _restricted(ranges: list[tuple[int, int]], time_ranges: Floats) -> RestrictedKnots:
    """Knots of successive ranges, with a gap between any two."""
    knots = np.concatenate([np.arange(first, last + 1) for first, last in ranges])
    gaps = np.zeros(len(knots) - 1, np.bool_)
    gaps[np.cumsum([last + 1 - first for first, last in ranges])[:-1] - 1] = True
    return RestrictedKnots(knots, gaps, time_ranges)
