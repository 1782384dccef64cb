"""Errors of walks against their tracks, by synchronised distance: each sample at its own time.

On a geographic plane, distances are measured in metres of the plane. A transverse Mercator plane
scales distances beside its central meridian up, by 0.2 % at 400 km, and none down. So the error on
the ground is never above the reported one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model.track import Track
from gpszip.model.walk import Walk
from gpszip.walks.along import interpolate_between, interpolate_positions
from gpszip.walks.shapes import shape_error

__all__ = ["TIME_SLACK", "ErrorSummary", "measure_errors", "positions_at", "synchronised_errors"]

#: Samples that are compared at a time: a call for each of 100,000 short tracks would take 10 s.
_BATCH_SAMPLES = 1 << 17

#: Times up to this many seconds outside of a piece belong to it.
TIME_SLACK = 1e-3


@dataclass(frozen=True)
class ErrorSummary:
    """Errors of walks against their tracks.

    Parameters
    ----------
    rmse, max_error : float
        Root mean square and largest synchronised distance in metres, over the covered samples.
    points, uncovered : int
        Number of samples, and of those at whose time the walks claim no position.
    """

    rmse: float
    max_error: float
    points: int
    uncovered: int


def positions_at(
    walk: Walk, nodes: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Positions of a walk at given times.

    Parameters
    ----------
    walk : Walk
        A walk with times.
    nodes : float64 array, shape (V, d)
        Positions of the road map's nodes in metres.
    times : float64 array, shape (n,)
        Seconds in the log's own zero, in any order.

    Returns
    -------
    float64 array, shape (n, d)
        Metres; NaN where the walk claims no travel: before, after and in gaps. Up to 1 ms outside
        of a piece, its nearest end counts.

    Raises
    ------
    OptionError
        If the walk has no times.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 10.0]), np.array([False]))
    >>> positions_at(walk, np.array([[0.0, 0.0], [5.0, 0.0]]), np.array([4.0, 11.0])).tolist()
    [[2.0, 0.0], [nan, nan]]
    """
    # Interpolation needs times.
    if walk.times is None:
        raise _no_times(walk)

    # Between its first and last knot, a piece may cover more than the time range of its samples.
    positions = interpolate_positions(
        walk.times, nodes[walk.nodes], walk.gaps, np.asarray(times, np.float64), TIME_SLACK
    )
    if walk.time_ranges is not None:
        positions[~_is_covered(walk.time_ranges, times)] = np.nan
    return positions


def _is_covered(time_ranges: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each time lies in the time range of a piece, within the slack."""
    # A walk of one piece needs no search.
    if len(time_ranges) == 1:
        begin, end = time_ranges[0]
    else:
        piece = np.clip(
            np.searchsorted(time_ranges[:, 0], times + TIME_SLACK, side="right") - 1, 0, None
        )
        begin, end = time_ranges[piece, 0], time_ranges[piece, 1]
    return np.asarray((times >= begin - TIME_SLACK) & (times <= end + TIME_SLACK))


def synchronised_errors(
    track: Track, walk: Walk, nodes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance in metres between each sample and the walk at the sample's time, shape (n,).

    Parameters
    ----------
    track : Track
        The samples.
    walk : Walk
        A walk with times.
    nodes : float64 array, shape (V, d)
        Positions of the road map's nodes in metres.

    Returns
    -------
    float64 array, shape (n,)
        NaN at times at which the walk claims no travel.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 2.0]), np.array([False]))
    >>> track = Track("a", [0, 1], [[0, 0], [1, 3]])
    >>> synchronised_errors(track, walk, np.array([[0.0, 0.0], [2.0, 0.0]])).tolist()
    [0.0, 3.0]
    """
    differences = positions_at(walk, nodes, track.times) - track.positions
    distances: NDArray[np.float64] = np.sqrt(np.einsum("ij,ij->i", differences, differences))
    return distances


def measure_errors(
    tracks: Sequence[Track], walks: Sequence[Walk], nodes: NDArray[np.float64]
) -> ErrorSummary:
    """Measure the errors of walks at all samples of their tracks.

    Tracks without times are compared at equal fractions of their length, by
    :func:`gpszip.walks.shapes.shape_error`. Their mean square error has as much weight as they have
    samples.

    Parameters
    ----------
    tracks : sequence of Track
        The samples.
    walks : sequence of Walk
        The walk of each track, in the same order, with times.
    nodes : float64 array, shape (V, d)
        Positions of the road map's nodes in metres.
    """
    # Sum up squared errors in square metres. Shapes come one by one, ...
    squares, max_error, uncovered = 0.0, 0.0, 0
    pairs = list(zip(tracks, walks, strict=True))
    for track, walk in pairs:
        if not track.timed:
            mean_square, largest = shape_error(track.positions, nodes[walk.nodes])
            squares, max_error = squares + len(track) * mean_square, max(max_error, largest)

    # ... tracks with times in batches.
    for batch in _batches([pair for pair in pairs if pair[0].timed]):
        errors = _errors_of_batch(batch, nodes)
        covered = errors[~np.isnan(errors)]
        squares += float(covered @ covered)
        max_error = max(max_error, float(covered.max(initial=0.0)))
        uncovered += len(errors) - len(covered)

    # Average over the samples that the walks cover; others have no error.
    points = sum(map(len, tracks))
    rmse = math.sqrt(squares / max(points - uncovered, 1))
    return ErrorSummary(rmse, max_error, points, uncovered)


def _batches(pairs: Sequence[tuple[Track, Walk]]) -> Iterator[list[tuple[Track, Walk]]]:
    """Gather tracks with their walks, up to about so many samples at a time."""
    batch: list[tuple[Track, Walk]] = []
    samples = 0
    for pair in pairs:
        batch.append(pair)
        samples += len(pair[0])
        if samples >= _BATCH_SAMPLES:
            yield batch
            batch, samples = [], 0
    if batch:
        yield batch


def _errors_of_batch(
    batch: Sequence[tuple[Track, Walk]], nodes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of each sample from its walk, as :func:`synchronised_errors` returns it."""
    if len(batch) == 1:
        return synchronised_errors(*batch[0], nodes)

    # Knots of all walks; none leads on from the last knot of a walk.
    walks = [walk for _, walk in batch]
    knot_times = np.concatenate([_times_of(walk) for walk in walks])
    last_knots = np.cumsum([len(walk.nodes) for walk in walks]) - 1
    gap_after = np.ones(len(knot_times), np.bool_)
    is_last = np.zeros(len(knot_times), np.bool_)
    is_last[last_knots] = True
    gap_after[~is_last] = np.concatenate([walk.gaps for walk in walks])

    # The knots around each sample of its own walk.
    counts = [len(track) for track, _ in batch]
    after = np.concatenate(
        [np.searchsorted(_times_of(walk), track.times, side="right") for track, walk in batch]
    )
    first_knots = last_knots + 1 - [len(walk.nodes) for walk in walks]
    first, last = np.repeat(first_knots, counts), np.repeat(last_knots, counts)
    left, right = np.maximum(first + after - 1, first), np.minimum(first + after, last)

    # Positions and distances.
    times = np.concatenate([track.times for track, _ in batch])
    positions = interpolate_between(
        knot_times,
        nodes[np.concatenate([walk.nodes for walk in walks])],
        gap_after,
        left,
        right,
        times,
        TIME_SLACK,
    )
    positions[~_are_covered(batch, times)] = np.nan
    differences = positions - np.concatenate([track.positions for track, _ in batch])
    distances: NDArray[np.float64] = np.sqrt(np.einsum("ij,ij->i", differences, differences))
    return distances


def _are_covered(
    batch: Sequence[tuple[Track, Walk]], times: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether each sample lies in the time range of a piece of its walk, within the slack."""
    # Most walks have one piece; the samples of all of these are compared at once.
    begins, ends = np.full(len(times), -np.inf), np.full(len(times), np.inf)
    after = np.cumsum([len(track) for track, _ in batch]).tolist()
    covered = np.ones(len(times), np.bool_)
    for (track, walk), end in zip(batch, after, strict=True):
        samples = slice(end - len(track), end)
        if walk.time_ranges is not None and len(walk.time_ranges) == 1:
            begins[samples], ends[samples] = walk.time_ranges[0]
        elif walk.time_ranges is not None:
            covered[samples] = _is_covered(walk.time_ranges, track.times)
    return covered & (times >= begins - TIME_SLACK) & (times <= ends + TIME_SLACK)


def _times_of(walk: Walk) -> NDArray[np.float64]:
    """Times of the knots of a walk that has some."""
    if walk.times is None:
        raise _no_times(walk)
    return walk.times


def _no_times(walk: Walk) -> OptionError:
    return OptionError(
        f"track {walk.id!r} has no times: the archive was written without them, "
        "so it has no positions at given times"
    )
