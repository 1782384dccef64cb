"""Curves of archives: where their tracks are at any time, as the measure of what a merge changes."""

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
_BETWEEN = 3

#: Weight that every point has at least: tracks have no points without.
_MIN_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Curve:
    """One track as its archive has it: linear in time between knots, and nowhere in gaps.

    Parameters
    ----------
    track : Track
        The knots.
    gaps : bool array, shape (n - 1,)
        Steps during which no travel is claimed.
    """

    track: Track
    gaps: NDArray[np.bool_]

    @property
    def walk(self) -> Walk:
        """The same as a walk over its own knots."""
        return Walk(
            self.track.id, np.arange(len(self.track), dtype=np.int32), self.track.times, self.gaps
        )


def build_curve(walk: Walk, nodes: NDArray[np.float64]) -> Curve:
    """Curve of a walk with times over nodes in metres."""
    return Curve(Track(walk.id, np.asarray(walk.times), nodes[walk.nodes]), walk.gaps)


def natural_sort_key(name: str) -> tuple[tuple[str | tuple[int, str], ...], str]:
    """What names are sorted by: numbers in them by value.

    Examples
    --------
    >>> sorted(["b", "a10", "a9", "7", "a09"], key=natural_sort_key)
    ['7', 'a09', 'a9', 'a10', 'b']
    """
    # texts and numbers take turns, a text first, so that like is compared with like
    return tuple(
        _by_value(word) if i % 2 else word for i, word in enumerate(re.split(r"([0-9]+)", name))
    ), name


def _by_value(digits: str) -> tuple[int, str]:
    """What sorts digits like their value, however many there are."""
    number = digits.lstrip("0")
    return len(number), number


def order_by_start(curves: Sequence[Curve]) -> list[int]:
    """Numbers of the curves in the order in which their tracks start; of those that start together, in the order of their names."""
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
    """Share of a log's points that may lie at knots: as many as there are knots, of one each ``step`` seconds; all if that is not known.

    Examples
    --------
    >>> curve = Curve(Track("a", [0, 60, 100], [[0.0], [9.0], [2.0]]), np.zeros(2, bool))
    >>> share_at_knots([curve], 1.0), share_at_knots([curve], 60.0), share_at_knots([curve], None)
    (0.03, 1.0, 1.0)
    """
    seconds = sum(float(np.diff(curve.track.times)[~curve.gaps].sum()) for curve in curves)
    knots = sum(len(curve.track) for curve in curves)
    return 1.0 if step is None or knots * step >= seconds else knots * step / seconds


def sample_curve(curve: Curve) -> Curve:
    """Return the curve with three more points on each part, evenly spaced."""
    knots, shares = len(curve.track), np.arange(1, _BETWEEN + 1) / (_BETWEEN + 1)
    inside = np.flatnonzero(~curve.gaps)
    at = np.sort(np.concatenate([np.arange(knots), (inside[:, None] + shares).ravel()]))
    times = np.interp(at, np.arange(knots), curve.track.times)
    apart = np.append(True, np.diff(times) > 0) | (at == np.floor(at))
    at, times = at[apart], times[apart]
    positions = np.stack(
        [np.interp(at, np.arange(knots), axis) for axis in curve.track.positions.T], axis=1
    )
    gaps = np.append(curve.gaps, False)[at[:-1].astype(np.int64)] & (at[:-1] == np.floor(at[:-1]))
    return Curve(Track(curve.track.id, times, positions), gaps)


def sample_weighted(curves: Sequence[Curve], at_knots: float) -> list[Curve]:
    """Sample curves so that a weighted sum over points is one over time, and over the knots for a share of the weight.

    The weights are 1 in the mean of all curves.
    """
    points = [sample_curve(curve) for curve in curves]
    knots = [
        np.isin(point.track.times, curve.track.times)
        for point, curve in zip(points, curves, strict=True)
    ]
    steps = [np.where(point.gaps, 0.0, np.diff(point.track.times)) for point in points]
    spans = [(np.append(step, 0.0) + np.append(0.0, step)) / 2 for step in steps]
    count, whole = sum(map(len, knots)), sum(float(span.sum()) for span in spans)
    each = count * (at_knots if whole > 0 else 1.0) / sum(int(own.sum()) for own in knots)
    second = count * (1 - at_knots) / whole if whole > 0 else 0.0
    return [
        Curve(
            Track(
                point.track.id,
                point.track.times,
                point.track.positions,
                each * own + second * span + _MIN_WEIGHT,
            ),
            point.gaps,
        )
        for point, own, span in zip(points, knots, spans, strict=True)
    ]


def measure_deviation(
    curves: Sequence[Curve],
    walks: Sequence[Walk],
    nodes: NDArray[np.float64],
    at_knots: float = 1.0,
) -> Deviation:
    """How far walks lie from curves, at the same times.

    Both are linear between knots, so the largest distance is at a knot of either and the mean square has a closed form: what
    comes out is exact, but for what lies within 1 ms of the end of a piece.

    Parameters
    ----------
    curves : sequence of Curve
        What is to be kept.
    walks : sequence of Walk
        One for each curve, with times.
    nodes : float64 array, shape (V, d)
        Places of the walks' nodes in metres.
    at_knots : float, default 1.0
        Share of a log's points that may lie at knots; the others are taken to lie evenly in time.

    Returns
    -------
    Deviation
        Infinite where a walk claims no travel and its curve does.

    Examples
    --------
    >>> curve = Curve(Track("a", [0, 2], [[0.0, 0.0], [2.0, 0.0]]), np.zeros(1, bool))
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 2.0]), np.zeros(1, bool))
    >>> measure_deviation([curve], [walk], np.array([[0.0, 0.0], [2.0, 3.0]])).maximum
    3.0
    """
    worst, square, span, knot_square, knots = 0.0, 0.0, 0.0, 0.0, 0
    for curve, walk in zip(curves, walks, strict=True):
        for first, after in split_at_gaps(curve.gaps):
            times = union_of_knot_times(curve.track.times[first:after], walk)
            away = positions_at(walk, nodes, times) - positions_at(
                curve.walk, curve.track.positions, times
            )
            if np.isnan(away).any() or _has_gap_within(walk, times):
                return Deviation(math.inf, math.inf)
            squares = (away**2).sum(axis=1)
            worst = max(worst, float(squares.max()))
            steps = np.diff(times)
            square += float(
                (
                    steps * (squares[1:] + squares[:-1] + (away[1:] * away[:-1]).sum(axis=1)) / 3
                ).sum()
            )
            span += float(steps.sum())
            own = squares[np.isin(times, curve.track.times[first:after])]
            knot_square, knots = knot_square + float(own.sum()), knots + len(own)
    in_time, in_knots = square / span if span > 0 else 0.0, knot_square / max(knots, 1)
    mean = in_time + at_knots * max(in_knots - in_time, 0.0)
    return Deviation(math.sqrt(mean), math.sqrt(worst))


def _has_gap_within(walk: Walk, times: NDArray[np.float64]) -> bool:
    """Whether a walk claims no travel somewhere between the first and the last of these times, and not just for a moment."""
    if walk.times is None:
        return True
    begins, ends = np.maximum(walk.times[:-1], times[0]), np.minimum(walk.times[1:], times[-1])
    return bool((ends - begins > 2 * TIME_SLACK)[walk.gaps].any())


def union_of_knot_times(times: NDArray[np.float64], walk: Walk) -> NDArray[np.float64]:
    """Times of a piece's knots, and those at which a walk has knots meanwhile."""
    if walk.times is None:
        return times
    meanwhile = walk.times[(walk.times > times[0]) & (walk.times < times[-1])]
    return np.union1d(times, meanwhile)
