"""Curves of archives, and how far a merge moves them.

A curve is the position of a track at any time, as its archive has it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track, Walk
from gpszip.model.merge_report import Deviation
from gpszip.walks.error import TIME_SLACK, positions_at

__all__ = [
    "Curve",
    "build_curve",
    "measure_deviation",
    "natural_sort_key",
    "order_by_start",
    "sample_curve",
    "sample_weighted",
    "share_at_knots",
    "split_at_gaps",
    "union_of_knot_times",
]

#: Points between two knots at which curves are sampled.
_POINTS_BETWEEN = 3

#: Least weight of a point: the samples of a track have positive weights.
_MIN_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Curve:
    """One track as its archive has it: linear in time between knots, and undefined in gaps.

    Parameters
    ----------
    track : Track
        The knots.
    gaps : bool array, shape (n - 1,)
        Steps between knots that are gaps.
    """

    track: Track
    gaps: NDArray[np.bool_]

    @property
    def walk(self) -> Walk:
        """The same curve as a walk over its own knots."""
        return Walk(
            self.track.id, np.arange(len(self.track), dtype=np.int32), self.track.times, self.gaps
        )


def build_curve(walk: Walk, nodes: NDArray[np.float64]) -> Curve:
    """Curve of a walk with times over nodes in metres."""
    return Curve(Track(walk.id, np.asarray(walk.times), nodes[walk.nodes]), walk.gaps)


def natural_sort_key(name: str) -> tuple[tuple[str | tuple[int, str], ...], str]:
    """Key to sort names by, with the numbers in them by value.

    Examples
    --------
    >>> sorted(["b", "a10", "a9", "7", "a09"], key=natural_sort_key)
    ['7', 'a09', 'a9', 'a10', 'b']
    """
    # Text and numbers alternate, text first, so that text is compared with text.
    words = re.split(r"([0-9]+)", name)
    return tuple(_digits_key(word) if i % 2 else word for i, word in enumerate(words)), name


def _digits_key(digits: str) -> tuple[int, str]:
    """Key that sorts digits by value; Python's integers are limited to 4300 digits."""
    # Of numbers without leading zeros, the longer one is larger; of equal length, text compares as
    # numbers do.
    number = digits.lstrip("0")
    return len(number), number


def order_by_start(curves: Sequence[Curve]) -> list[int]:
    """Indices of the curves in the order of their start times, then of their names."""
    return sorted(
        range(len(curves)),
        key=lambda i: (float(curves[i].track.times[0]), natural_sort_key(curves[i].track.id)),
    )


def split_at_gaps(gaps: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First knot of each piece between gaps, and the one after its last.

    Examples
    --------
    >>> split_at_gaps(np.array([False, True, False]))
    [(0, 2), (2, 4)]
    """
    return list(pairwise([0, *(np.flatnonzero(gaps) + 1).tolist(), len(gaps) + 1]))


def share_at_knots(curves: Sequence[Curve], step: float | None) -> float:
    """Largest share of a log's samples that are at knots.

    As many samples as there are knots, of one for each ``step`` seconds; 1 if the step is unknown.

    Examples
    --------
    >>> curve = Curve(Track("a", [0, 60, 100], [[0.0], [9.0], [2.0]]), np.zeros(2, bool))
    >>> share_at_knots([curve], 1.0), share_at_knots([curve], 60.0), share_at_knots([curve], None)
    (0.03, 1.0, 1.0)
    """
    # Over the time travelled, the log has a sample for each step.
    duration = sum(float(np.diff(curve.track.times)[~curve.gaps].sum()) for curve in curves)
    knots = sum(len(curve.track) for curve in curves)
    return 1.0 if step is None or knots * step >= duration else knots * step / duration


def sample_curve(curve: Curve) -> Curve:
    """Return the curve with three more points on each segment, evenly spaced."""
    # Points as fractions of knot indices.
    knots = len(curve.track)
    shares = np.arange(1, _POINTS_BETWEEN + 1) / (_POINTS_BETWEEN + 1)
    segments = np.flatnonzero(~curve.gaps)
    index = np.sort(np.concatenate([np.arange(knots), (segments[:, None] + shares).ravel()]))
    times = np.interp(index, np.arange(knots), curve.track.times)

    # Drop points that double precision can't tell from the one before, but no knots.
    is_distinct = np.append(True, np.diff(times) > 0) | (index == np.floor(index))
    index, times = index[is_distinct], times[is_distinct]

    # Interpolate positions; gaps start at the same knots as before.
    positions = np.stack(
        [np.interp(index, np.arange(knots), axis) for axis in curve.track.positions.T], axis=1
    )
    starts_at_knot = index[:-1] == np.floor(index[:-1])
    gaps = np.append(curve.gaps, False)[index[:-1].astype(np.int64)] & starts_at_knot
    return Curve(Track(curve.track.id, times, positions), gaps)


def sample_weighted(curves: Sequence[Curve], at_knots: float) -> list[Curve]:
    """Sample curves so that a weighted sum over points is one over time, and over knots.

    Parameters
    ----------
    curves : sequence of Curve
        The curves of an archive.
    at_knots : float
        Share of the weight that the knots have together.

    Returns
    -------
    list of Curve
        Points with weights of mean 1 over all curves.
    """
    # Points of each curve, and which of them are knots.
    points = [sample_curve(curve) for curve in curves]
    is_knot = [
        np.isin(point.track.times, curve.track.times)
        for point, curve in zip(points, curves, strict=True)
    ]

    # Each point stands for half the time to its neighbours.
    steps = [np.where(point.gaps, 0.0, np.diff(point.track.times)) for point in points]
    spans = [(np.append(step, 0.0) + np.append(0.0, step)) / 2 for step in steps]

    # Weight of a knot, and of a second.
    count, duration = sum(map(len, is_knot)), sum(float(span.sum()) for span in spans)
    # Weights sum up to the number of points. Where no time passes, knots have all of it.
    knot_weight = (
        count * (at_knots if duration > 0 else 1.0) / sum(int(knots.sum()) for knots in is_knot)
    )
    second_weight = count * (1 - at_knots) / duration if duration > 0 else 0.0
    return [
        Curve(
            Track(
                point.track.id,
                point.track.times,
                point.track.positions,
                knot_weight * knots + second_weight * span + _MIN_WEIGHT,
            ),
            point.gaps,
        )
        for point, knots, span in zip(points, is_knot, spans, strict=True)
    ]


def measure_deviation(
    curves: Sequence[Curve],
    walks: Sequence[Walk],
    nodes: NDArray[np.float64],
    at_knots: float = 1.0,
) -> Deviation:
    """How far walks are from curves, at the same times.

    Both are linear between knots, so the largest distance is at a knot of either, and the mean
    square has a closed form: between two times, the mean of |x|^2 over a line from a to b is
    (|a|^2 + |b|^2 + a.b) / 3. The result is exact, but for the last 1 ms before the end of a piece.

    Parameters
    ----------
    curves : sequence of Curve
        The curves to compare with.
    walks : sequence of Walk
        One for each curve, with times.
    nodes : float64 array, shape (V, d)
        Positions of the walks' nodes in metres.
    at_knots : float, default 1.0
        Largest share of a log's samples at knots; the others are evenly spread in time.

    Returns
    -------
    Deviation
        Infinite where a walk has a gap and its curve has none.

    Examples
    --------
    >>> curve = Curve(Track("a", [0, 2], [[0.0, 0.0], [2.0, 0.0]]), np.zeros(1, bool))
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 2.0]), np.zeros(1, bool))
    >>> measure_deviation([curve], [walk], np.array([[0.0, 0.0], [2.0, 3.0]])).maximum
    3.0
    """
    # Add up over pieces between gaps, in which curve and walk are linear between knots.
    largest, time_square, duration, knot_square, knots = 0.0, 0.0, 0.0, 0.0, 0
    for curve, walk in zip(curves, walks, strict=True):
        for first, after in split_at_gaps(curve.gaps):
            # Offsets at all knots of either, which bound linear pieces.
            curve_times = curve.track.times[first:after]
            times = union_of_knot_times(curve_times, walk)
            offsets = positions_at(walk, nodes, times) - positions_at(
                curve.walk, curve.track.positions, times
            )
            if np.isnan(offsets).any() or _has_gap_within(walk, times):
                return Deviation(math.inf, math.inf)

            # Maximum, integral over time, and sum over the curve's knots.
            squares = (offsets**2).sum(axis=1)
            largest = max(largest, float(squares.max()))
            steps = np.diff(times)
            products = (offsets[1:] * offsets[:-1]).sum(axis=1)
            time_square += float((steps * (squares[1:] + squares[:-1] + products) / 3).sum())
            duration += float(steps.sum())
            at_curve_knots = squares[np.isin(times, curve_times)]
            knot_square += float(at_curve_knots.sum())
            knots += len(at_curve_knots)

    # If knots are farther away than the rest, samples at knots count by their share.
    in_time = time_square / duration if duration > 0 else 0.0
    in_knots = knot_square / max(knots, 1)
    mean_square = in_time + at_knots * max(in_knots - in_time, 0.0)
    return Deviation(math.sqrt(mean_square), math.sqrt(largest))


def _has_gap_within(walk: Walk, times: NDArray[np.float64]) -> bool:
    """Whether a walk has a gap between the first and the last of these times.

    A gap of at most two time slacks does not count.
    """
    if walk.times is None:
        return True
    # The part of each segment that lies between these times; none where it ends before it begins.
    begins, ends = np.maximum(walk.times[:-1], times[0]), np.minimum(walk.times[1:], times[-1])
    return bool((ends - begins > 2 * TIME_SLACK)[walk.gaps].any())


def union_of_knot_times(times: NDArray[np.float64], walk: Walk) -> NDArray[np.float64]:
    """Times of the knots of a piece, and of a walk's knots between them."""
    if walk.times is None:
        return times
    # Knots outside of the piece are of no interest: the curve claims no travel there.
    between = walk.times[(walk.times > times[0]) & (walk.times < times[-1])]
    return np.union1d(times, between)
