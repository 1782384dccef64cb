"""Shapes, which are tracks without times: errors and times by fractions of their length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.model import GridWalk, GridWalks, Track, Walk

__all__ = [
    "SyntheticTimes",
    "assign_times_by_distance",
    "drop_time_steps",
    "shape_error",
    "shape_slice_error",
    "synthetic_times",
    "with_synthetic_times",
]


class SyntheticTimes(NamedTuple):
    """Times for shapes, which all move at one speed.

    Parameters
    ----------
    start : float
        Seconds at which each shape starts.
    speed : float
        Metres per second.
    """

    start: float = 0.0
    speed: float = 1.0

    def assign_to(self, track: Track) -> Track:
        """Return a shape, or a slice of one, with times; a track with times as it is."""
        if track.timed:
            return track
        # The "times" of a shape are distances from its start.
        return replace(track, times=self.start + track.times / self.speed, timed=True)


def with_synthetic_times(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]
) -> tuple[Track, ...]:
    """Give shapes times, at the mean speed of the tracks that have times.

    Parameters
    ----------
    tracks : sequence of Track
        Tracks with and without times.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, whether each step between samples is a gap.

    Returns
    -------
    tuple of Track
        All with times. Shapes start with the earliest track. If there are only shapes, they start
        at 0, and a metre takes a second.

    Examples
    --------
    >>> shape = Track("a", [0.0, 6.0], [[0.0], [6.0]], timed=False)
    >>> drive = Track("b", [10.0, 11.0], [[0.0], [3.0]])
    >>> timed = with_synthetic_times([shape, drive], [np.zeros(1, bool)] * 2)
    >>> [track.times.tolist() for track in timed]
    [[10.0, 12.0], [10.0, 11.0]]
    """
    # Without shapes, nothing has to change.
    if all(track.timed for track in tracks):
        return tuple(tracks)
    times = synthetic_times(tracks, gaps)
    return tuple(times.assign_to(track) for track in tracks)


def synthetic_times(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> SyntheticTimes:
    """Find the start and the speed that shapes get; see :func:`with_synthetic_times`."""
    # Add up distance and duration of all moving steps.
    distance, duration = 0.0, 0.0
    for track, gap in zip(tracks, gaps, strict=True):
        if not track.timed:
            continue
        length = np.sqrt((np.diff(track.positions, axis=0) ** 2).sum(axis=1))
        moved = ~gap & (length > 0)
        distance += float(length[moved].sum())
        duration += float(np.diff(track.times)[moved].sum())

    # Shapes start with the earliest track, even if it is parked.
    start = min((float(track.times[0]) for track in tracks if track.timed), default=0.0)
    speed = distance / duration if distance > 0 and duration > 0 else 1.0
    return SyntheticTimes(start, speed)


def shape_error(samples: NDArray[np.float64], knots: NDArray[np.float64]) -> tuple[float, float]:
    """Compare two lines at equal fractions of their length.

    With s from 0 to 1 the fraction of each line's own length, and D(s) the difference of the two
    positions, D is linear between the fractions at which either line has a vertex. So the mean of
    |D|^2 over an interval with ends a and b is (a.a + a.b + b.b) / 3, and the largest |D| is at a
    vertex.

    Parameters
    ----------
    samples, knots : float64 arrays, shape (n, d) and (k, d)
        Vertices in metres.

    Returns
    -------
    (float, float)
        Mean square in square metres, and the largest distance in metres.

    Examples
    --------
    >>> shape_error(np.array([[0.0, 0.0], [9.0, 0.0]]), np.array([[0.0, 3.0], [9.0, 3.0]]))
    (9.0, 3.0)
    """
    sample_fractions, knot_fractions = _distance_fractions(samples), _distance_fractions(knots)
    vertices = np.unique(np.concatenate([sample_fractions, knot_fractions]))
    return _error_between(vertices, (sample_fractions, samples), (knot_fractions, knots))


def shape_slice_error(track: Track, walk: Walk, nodes: NDArray[np.float64]) -> tuple[float, float]:
    """Compare a slice of a shape with its walk, as :func:`shape_error` compares all of both.

    Parameters
    ----------
    track : Track
        Samples of the shape; its "times" are distances from the start of the whole shape.
    walk : Walk
        Knots about these samples. Their times are in proportion to the length of the whole walk,
        from 0 to the length of the whole shape; see :func:`assign_times_by_distance`.
    nodes : float64 array, shape (V, d)
        Positions of the nodes in metres.

    Returns
    -------
    (float, float)
        Mean square over the length of the slice in square metres, and the largest distance.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([0.0, 9.0]), np.array([False]))
    >>> slice = Track("a", [3.0, 9.0], [[3.0, 1.0], [9.0, 1.0]], timed=False)
    >>> shape_slice_error(slice, walk, np.array([[0.0, 0.0], [9.0, 0.0]]))
    (1.0, 1.0)
    """
    assert walk.times is not None
    first, last = track.times[[0, -1]]
    inside = walk.times[(walk.times > first) & (walk.times < last)]
    vertices = np.unique(np.concatenate([track.times, inside]))
    return _error_between(vertices, (track.times, track.positions), (walk.times, nodes[walk.nodes]))


def _error_between(
    vertices: NDArray[np.float64],
    line: tuple[NDArray[np.float64], NDArray[np.float64]],
    other: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[float, float]:
    """Mean square and largest distance of two lines, given how far along their vertices are."""
    # Difference of the positions at the vertices of both lines.
    difference = _interpolate_at(vertices, *line) - _interpolate_at(vertices, *other)
    square = (difference**2).sum(axis=1)
    if len(vertices) == 1:
        return float(square[0]), float(np.sqrt(square[0]))

    # Integrate |D|^2 from vertex to vertex.
    mixed = (difference[1:] * difference[:-1]).sum(axis=1)
    integral = (np.diff(vertices) * (square[1:] + square[:-1] + mixed)).sum() / 3
    mean_square = float(integral / (vertices[-1] - vertices[0]))
    return mean_square, float(np.sqrt(square.max()))


def assign_times_by_distance(
    walk: Walk, nodes: NDArray[np.float64], first: float, last: float
) -> Walk:
    """Give a walk times from ``first`` to ``last`` seconds, in proportion to its length.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), None, np.array([False]))
    >>> assign_times_by_distance(walk, np.array([[0.0], [5.0]]), 2.0, 4.0).times.tolist()
    [2.0, 4.0]
    """
    fractions = _distance_fractions(nodes[walk.nodes])
    return replace(walk, times=first + fractions * (last - first), time_ranges=None)


def drop_time_steps(walks: GridWalks, untimed: frozenset[int], *, others: bool) -> GridWalks:
    """Remove the times from the walks of shapes.

    Parameters
    ----------
    walks : GridWalks
        Walks with times.
    untimed : frozenset of int
        Numbers of the walks of shapes.
    others : bool
        Whether the archive has times nevertheless: those of other walks, or of a separate map. The
        knots of shapes are then one time step apart, which takes next to no bits.
    """
    if not untimed:
        return walks

    # Shapes start with the first walk that has times.
    starts = [int(w.time_steps[0]) for number, w in enumerate(walks.walks) if number not in untimed]
    start = min(starts, default=0)
    stripped = tuple(
        _drop_stops(walk, start, others=others) if number in untimed else walk
        for number, walk in enumerate(walks.walks)
    )
    return replace(walks, walks=stripped, timed=others, untimed=untimed if others else frozenset())


def _drop_stops(walk: GridWalk, start: int, *, others: bool) -> GridWalk:
    """Drop stops, which mean nothing without times, and set time steps that are cheap to encode."""
    # A gap stays, even one between two knots at one node: it ends a piece.
    keep = np.append(True, walk.gaps | (walk.nodes[1:] != walk.nodes[:-1]))
    nodes, gaps = walk.nodes[keep], walk.gaps[keep[1:]]
    time_steps = start + np.arange(len(nodes)) if others else np.zeros(len(nodes), np.int64)
    return GridWalk(nodes, time_steps.astype(np.int64), gaps)


def _distance_fractions(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fraction of the length at each vertex; evenly spaced if the line has no length."""
    along = np.append(0.0, np.cumsum(np.sqrt((np.diff(vertices, axis=0) ** 2).sum(axis=1))))
    if along[-1] > 0:
        fractions: NDArray[np.float64] = along / along[-1]
        return fractions
    # A single vertex is at 0.
    return np.linspace(0.0, 1.0, len(along)) * (len(along) > 1)


def _interpolate_at(
    fractions: NDArray[np.float64],
    vertex_fractions: NDArray[np.float64],
    vertices: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Positions of a line at fractions of its length."""
    axes = [np.interp(fractions, vertex_fractions, axis) for axis in vertices.T]
    return np.stack(axes, axis=1)
