"""Comparing archives and logs, track by track.

A log against an archive is compared at the log's samples. Two logs are compared at the times of
both. Between two archives, positions are linear in time between the knots of either, so that
statistics are taken over all time: the distance is convex there, and largest at a knot.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.container.layout import MAGIC
from gpszip.errors import OptionError
from gpszip.geo.gaps import estimate_gap, find_gaps_of_all, piece_time_ranges
from gpszip.geo.planes import plane_changes, reproject_positions
from gpszip.model import Plane, Track
from gpszip.model.difference import Difference, Distances, FarPlace, TrackDifference
from gpszip.model.grid import step_size
from gpszip.model.projection import map_coordinates
from gpszip.model.text import axes_text
from gpszip.walks.along import interpolate_positions
from gpszip.walks.error import TIME_SLACK
from gpszip.walks.polylines import polyline_distances

__all__ = ["Side", "diff", "holds_archive", "side_of_archive", "side_of_log"]

#: Share of the distances that the percentile does not exceed.
_SHARE = 0.95

#: Steps of the bisection for it: as many as a float64 has bits.
_BISECTIONS = 53

#: Change of a difference, relative to its size, below which its mean is that of its ends: the
#: closed form would lose half of its digits.
_SMALL_CHANGE = 1e-6

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """A track as a curve over time, with gaps.

    Parameters
    ----------
    id : str
        Name of the track.
    times, positions : float64 arrays, shape (n,) and (n, d)
        Samples of a log, or knots of an archive.
    gaps : bool array, shape (n - 1,)
        Steps in which no travel is claimed.
    timed : bool
        Whether it has times.
    """

    id: str
    times: Floats
    positions: Floats
    gaps: NDArray[np.bool_]
    timed: bool

    @property
    def ranges(self) -> Floats:
        """Times of the first and the last point of each piece, shape (k, 2)."""
        return piece_time_ranges(self.times, self.gaps) if self.timed else np.zeros((0, 2))

    @property
    def length(self) -> float:
        """Metres travelled, without gaps."""
        steps = np.sqrt((np.diff(self.positions, axis=0) ** 2).sum(axis=1))
        return float(steps[~self.gaps].sum())

    @property
    def duration(self) -> float:
        """Seconds of travel, without gaps."""
        return float(np.diff(self.ranges, axis=1).sum())

    def at(self, times: Floats) -> Floats:
        """Positions at given times; NaN where no travel is claimed."""
        return interpolate_positions(self.times, self.positions, self.gaps, times, TIME_SLACK)


@dataclass(frozen=True, eq=False)
class Side:
    """One of the two that are compared.

    Parameters
    ----------
    curves : dict of str to Curve
        Its tracks by their ids.
    plane : Plane or None
        Their plane; None in x and y.
    dimension : int
        Number of coordinates.
    sampled : bool
        Whether it is a log, whose points are samples.
    time_step : float, default 0
        Seconds to which an archive rounds times.
    """

    curves: dict[str, Curve]
    plane: Plane | None
    dimension: int
    sampled: bool
    time_step: float = 0.0


class _Compared(NamedTuple):
    """Both positions at successive times; between some of them they were compared throughout.

    Parameters
    ----------
    times : float64 array, shape (n,)
        Seconds.
    first, second : float64 arrays, shape (n, d)
        Both positions.
    begin, end : int arrays, shape (k,)
        What was compared: intervals between times, or single times, whose ends are the same.
    weights : float64 array, shape (k,)
        How much each counts.
    """

    times: Floats
    first: Floats
    second: Floats
    begin: NDArray[np.intp]
    end: NDArray[np.intp]
    weights: Floats

    @property
    def distances(self) -> Floats:
        """Distance in metres at each time."""
        distances: Floats = np.sqrt(((self.first - self.second) ** 2).sum(axis=1))
        return distances


class _Motion(NamedTuple):
    """Distances of two positions that move linearly, for several intervals.

    The difference of the positions is w along its change, from ``w`` on over the length ``change``,
    and ``offset`` across it, so that the distance is sqrt(w^2 + offset^2).

    Parameters
    ----------
    w, change, offset : float64 arrays, shape (k,)
        Metres.
    weights : float64 array, shape (k,)
        How much each interval counts.
    """

    w: Floats
    change: Floats
    offset: Floats
    weights: Floats


def side_of_log(tracks: Sequence[Track], gap: float | None = None) -> Side:
    """The tracks of a log; steps longer than ``gap`` seconds are gaps, by default estimated."""
    if not tracks:
        raise OptionError("there are no tracks to compare")
    timed = [track for track in tracks if track.timed]
    longest = estimate_gap(timed) if gap is None else gap
    curves = {
        track.id: Curve(track.id, track.times, track.positions, gaps, track.timed)
        for track, gaps in zip(tracks, find_gaps_of_all(tracks, longest), strict=True)
    }
    return Side(curves, tracks[0].plane, tracks[0].dimension, sampled=True)


def side_of_archive(archive: Archive) -> Side:
    """The walks of an archive, from the first sample of each piece to its last one."""
    # Pieces of each track, in the order of time.
    owners = archive.pieces
    pieces: dict[str, list[Track]] = {}
    for piece in archive.decompress():
        pieces.setdefault(owners[piece.id], []).append(piece)

    curves = {id: _join(id, own) for id, own in pieces.items()}
    grid = archive.grid
    return Side(curves, grid.plane, grid.dimension, sampled=False, time_step=step_size(grid.time))


def diff(first: Side, second: Side, *, worst: int = 100) -> Difference:
    """Compare two archives or logs; tracks of one id are compared with each other.

    Parameters
    ----------
    first, second : Side
        Of :func:`side_of_archive` and :func:`side_of_log`. The second is put on the plane of the
        first.
    worst : int, default 100
        Number of places to return where they are farthest apart.

    Raises
    ------
    OptionError
        If one is in degrees and the other in metres, or they are far from each other.

    Examples
    --------
    >>> walk = Track("walk", [0, 1, 2], [[0, 0], [1, 0], [2, 0]])
    >>> other = Track("walk", [0, 1, 2], [[0, 0], [1, 3], [2, 0]])
    >>> found = diff(side_of_log([walk]), side_of_log([other]))
    >>> found.total.maximum, found.tracks[0].at, found.tracks[0].frechet
    (3.0, 1.0, 3.0)
    """
    second = _on_plane_of(first, second)
    missing = (
        tuple(id for id in second.curves if id not in first.curves),
        tuple(id for id in first.curves if id not in second.curves),
    )

    # Compare what both have; keep the motions for the statistics of all tracks together.
    tracks: list[TrackDifference] = []
    motions: list[_Motion] = []
    far: list[FarPlace] = []
    for id, curve in first.curves.items():
        if id not in second.curves:
            continue
        other = second.curves[id]
        compared = _compare(curve, other, first.sampled, second.sampled)
        motion = _motion(compared)
        tracks.append(_track_difference(curve, other, first.sampled, second.sampled, compared))
        motions.append(motion)
        far = _farthest([*far, *_far_places(id, compared, first.plane, worst)], worst)

    # All tracks together.
    count = sum(track.distances.compared for track in tracks)
    total = _statistics(_joined(motions), count)
    return Difference(tuple(tracks), total, missing, tuple(far), first.plane is not None)


def _join(id: str, pieces: Sequence[Track]) -> Curve:
    """One curve of pieces, with gaps between them."""
    times = np.concatenate([piece.times for piece in pieces])
    gaps = np.zeros(len(times), np.bool_)
    gaps[np.cumsum([len(piece) for piece in pieces]) - 1] = True
    positions = np.concatenate([piece.positions for piece in pieces])
    return Curve(id, times, positions, gaps[:-1], pieces[0].timed)


def _on_plane_of(first: Side, second: Side) -> Side:
    """The second side on the plane of the first."""
    # The same kind of coordinates.
    of_first, of_second = (axes_text(side.dimension, side.plane) for side in (first, second))
    if of_first != of_second:
        raise OptionError(
            f"the first is in {of_first}, the second in {of_second}",
            remedy="compare logs and archives of one place",
        )
    if first.plane is None or second.plane is None or first.plane == second.plane:
        return second

    # Where a line leads from one plane to another, nothing is known between its ends.
    curves = {}
    for id, curve in second.curves.items():
        positions = reproject_positions(
            curve.positions, second.plane, first.plane, f"track {id!r} of the second"
        )
        gaps = curve.gaps | plane_changes(positions, first.plane)
        curves[id] = Curve(id, curve.times, positions, gaps, curve.timed)
    return replace(second, curves=curves, plane=first.plane)


def _compare(first: Curve, second: Curve, first_sampled: bool, second_sampled: bool) -> _Compared:
    """Both positions at the times at which two tracks are compared."""
    # Samples of the log where there is one log; else the points of both.
    if not (first.timed and second.timed):
        times = np.zeros(0)
    elif first_sampled != second_sampled:
        times = first.times if first_sampled else second.times
    else:
        times = np.union1d(first.times, second.times)
    a, b = first.at(times), second.at(times)
    is_known = ~(np.isnan(a[:, 0]) | np.isnan(b[:, 0]))
    times, a, b = times[is_known], a[is_known], b[is_known]

    # Single times count alike, ...
    count = np.arange(len(times))
    if first_sampled or second_sampled or len(times) < 2:
        return _Compared(times, a, b, count, count, np.ones(len(times)))

    # ... intervals between knots by their duration, unless there is a gap in one of the tracks.
    middle = (times[1:] + times[:-1]) / 2
    travels = ~(np.isnan(first.at(middle)[:, 0]) | np.isnan(second.at(middle)[:, 0]))
    begin = np.flatnonzero(travels & (np.diff(times) > TIME_SLACK))
    if not len(begin):
        return _Compared(times, a, b, count, count, np.ones(len(times)))
    return _Compared(times, a, b, begin, begin + 1, np.diff(times)[begin])


def _track_difference(
    first: Curve, second: Curve, first_sampled: bool, second_sampled: bool, compared: _Compared
) -> TrackDifference:
    """All figures of one track."""
    # Synchronised distances.
    distances = compared.distances
    statistics = _statistics(_motion(compared), len(distances))
    if not (first.timed and second.timed):
        compared_at = None
    elif first_sampled != second_sampled:
        compared_at = "samples"
    else:
        compared_at = "times" if first_sampled else "knots"
    # The largest distance between knots lies at one of them, also where gaps leave no interval.
    largest = float(distances.max(initial=0.0)) if len(distances) else math.nan

    # Lines, and what only one of them has.
    lines = polyline_distances(first.positions, second.positions)
    return TrackDifference(
        id=first.id,
        compared_at=compared_at,
        distances=replace(statistics, maximum=largest),
        at=float(compared.times[distances.argmax()]) if len(distances) else None,
        hausdorff=lines.hausdorff,
        frechet=lines.frechet,
        discrete_frechet=lines.discrete_frechet,
        within=lines.within,
        discrete_within=lines.discrete_within,
        lengths=(first.length, second.length),
        durations=(first.duration, second.duration),
        unmatched=(
            _count_unmatched(first, second) if first_sampled else 0,
            _count_unmatched(second, first) if second_sampled else 0,
        ),
        alone=(
            _ranges_alone(first.ranges, second.ranges),
            _ranges_alone(second.ranges, first.ranges),
        ),
    )


def _count_unmatched(own: Curve, other: Curve) -> int:
    """Samples at whose time another track has no position."""
    if not (own.timed and other.timed):
        return 0
    return int(np.isnan(other.at(own.times)[:, 0]).sum())


def _ranges_alone(own: Floats, other: Floats) -> tuple[tuple[float, float], ...]:
    """Time ranges that only the first of two sorted lists of disjoint ones covers.

    Examples
    --------
    >>> _ranges_alone(np.array([[0.0, 10.0]]), np.array([[2.0, 3.0], [9.0, 20.0]]))
    ((0.0, 2.0), (3.0, 9.0))
    """
    if not len(own) or not len(other):
        return ()
    # Between two successive ends of ranges, each list covers all or nothing.
    ends = np.unique(np.concatenate([own.ravel(), other.ravel()]))
    middle = (ends[1:] + ends[:-1]) / 2
    is_alone = _covers(own, middle) & ~_covers(other, middle)
    # Ends are kept to a millisecond.
    is_alone &= np.diff(ends) > 2 * TIME_SLACK

    # Join successive ones.
    changes = np.diff(np.concatenate([[0], is_alone.astype(np.int8), [0]]))
    begin, end = ends[np.flatnonzero(changes > 0)], ends[np.flatnonzero(changes < 0)]
    return tuple(zip(begin.tolist(), end.tolist(), strict=True))


def _covers(ranges: Floats, times: Floats) -> NDArray[np.bool_]:
    """Whether each time lies in one of the ranges."""
    piece = np.searchsorted(ranges[:, 0], times, side="right") - 1
    covered: NDArray[np.bool_] = (piece >= 0) & (times <= ranges[np.maximum(piece, 0), 1])
    return covered


def _motion(compared: _Compared) -> _Motion:
    """Differences of the positions, along and across their change."""
    difference = compared.first - compared.second
    start, end = difference[compared.begin], difference[compared.end]
    step = end - start
    change = np.sqrt((step**2).sum(axis=1))
    size = np.sqrt((start**2).sum(axis=1))
    is_moving = change > _SMALL_CHANGE * np.maximum(size, np.finfo(float).tiny)

    # Where it hardly changes, the difference is that of the middle, all of it across.
    middle = np.sqrt((((start + end) / 2) ** 2).sum(axis=1))
    w = (start * step).sum(axis=1) / np.where(is_moving, change, 1.0)
    offset = np.sqrt(np.maximum(size**2 - w**2, 0.0))
    return _Motion(
        np.where(is_moving, w, 0.0),
        np.where(is_moving, change, 0.0),
        np.where(is_moving, offset, middle),
        compared.weights,
    )


def _joined(motions: Iterable[_Motion]) -> _Motion:
    """The motions of several tracks as one."""
    listed = list(motions)
    if not listed:
        return _Motion(*(np.zeros(0) for _ in range(4)))
    return _Motion(*(np.concatenate(values) for values in zip(*listed, strict=True)))


def _statistics(motion: _Motion, compared: int) -> Distances:
    """Mean, root mean square, percentile and maximum of distances.

    With w from w0 to w1 and the offset h, the integral of w^2 + h^2 is (w^3 / 3 + h^2 w), and that
    of its root (w sqrt(w^2 + h^2) + h^2 asinh(w / h)) / 2, each between w0 and w1.
    """
    if not len(motion.w):
        return Distances(math.nan, math.nan, math.nan, math.nan, 0)
    w0, w1, h = motion.w, motion.w + motion.change, motion.offset
    share = motion.weights / motion.weights.sum()
    near, far = np.sqrt(w0**2 + h**2), np.sqrt(w1**2 + h**2)

    # Squares: the mean of w^2 between w0 and w1 is (w0^2 + w0 w1 + w1^2) / 3.
    square = (w0**2 + w0 * w1 + w1**2) / 3 + h**2

    # Distances.
    positive = np.where(h > 0, h, 1.0)
    bend = np.where(h > 0, h**2 * (np.arcsinh(w1 / positive) - np.arcsinh(w0 / positive)), 0.0)
    length = np.where(motion.change > 0, motion.change, 1.0)
    mean = np.where(motion.change > 0, (w1 * far - w0 * near + bend) / (2 * length), h)
    return Distances(
        float(share @ mean),
        math.sqrt(float(share @ square)),
        _percentile(motion, share),
        float(np.maximum(near, far).max()),
        compared,
    )


def _percentile(motion: _Motion, share: Floats) -> float:
    """Smallest distance that 95 % do not exceed, by bisection where distances change."""
    # Single distances are sorted.
    if not motion.change.any():
        order = np.argsort(motion.offset)
        reached = np.cumsum(share[order])
        found = min(int(np.searchsorted(reached, _SHARE - 1e-12)), len(order) - 1)
        return float(motion.offset[order[found]])

    # The distance is at most r where |w| is at most sqrt(r^2 - h^2).
    w0, w1 = motion.w, motion.w + motion.change
    low, high = 0.0, float(np.hypot(np.maximum(np.abs(w0), np.abs(w1)), motion.offset).max())
    length = np.where(motion.change > 0, motion.change, 1.0)
    for _ in range(_BISECTIONS):
        r = (low + high) / 2
        reach = np.sqrt(np.maximum(r**2 - motion.offset**2, 0.0))
        inside = np.maximum(np.minimum(w1, reach) - np.maximum(w0, -reach), 0.0) / length
        inside = np.where(motion.change > 0, inside, 1.0) * (motion.offset <= r)
        if float(share @ inside) >= _SHARE:
            high = r
        else:
            low = r
    return high


def _far_places(id: str, compared: _Compared, plane: Plane | None, count: int) -> list[FarPlace]:
    """Where the distance is at least as large as before and after; at most ``count`` places."""
    distances = compared.distances
    if not len(distances) or count < 1:
        return []

    # Larger than before, and no smaller than after: of equal ones, the first counts.
    padded = np.concatenate([[-1.0], distances, [-1.0]])
    peaks = np.flatnonzero((distances > padded[:-2]) & (distances >= padded[2:]) & (distances > 0))
    chosen = peaks[np.argsort(-distances[peaks], kind="stable")[:count]]
    first = map_coordinates(compared.first[chosen], plane).tolist()
    second = map_coordinates(compared.second[chosen], plane).tolist()
    return [
        FarPlace(id, float(compared.times[row]), float(distances[row]), tuple(a), tuple(b))
        for row, a, b in zip(chosen.tolist(), first, second, strict=True)
    ]


def _farthest(places: Iterable[FarPlace], count: int) -> list[FarPlace]:
    """The places with the largest distances, the largest first."""
    return heapq.nlargest(count, places, key=lambda place: place.distance)


def holds_archive(head: bytes) -> bool:
    """Whether a file that begins with these bytes is an archive."""
    return head.startswith(MAGIC)
