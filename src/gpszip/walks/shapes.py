"""Shapes: tracks without times, compared with what stands for them at equal shares of the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model import GridWalk, GridWalks, Track, Walk

__all__ = ["assign_times_by_distance", "drop_time_steps", "shape_error", "with_synthetic_times"]


def with_synthetic_times(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]
) -> tuple[Track, ...]:
    """Give shapes times as if they had been travelled at the typical speed of the tracks that have times.

    Parameters
    ----------
    tracks : sequence of Track
        With and without times.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.

    Returns
    -------
    tuple of Track
        All with times; of shapes alone, a metre takes a second.

    Examples
    --------
    >>> shape = Track("a", [0.0, 6.0], [[0.0], [6.0]], timed=False)
    >>> drive = Track("b", [10.0, 11.0], [[0.0], [3.0]])
    >>> [track.times.tolist() for track in with_synthetic_times([shape, drive], [np.zeros(1, bool)] * 2)]
    [[10.0, 12.0], [10.0, 11.0]]
    """
    if all(track.timed for track in tracks):
        return tuple(tracks)

    # way and time of all moving steps
    start, way, time = 0.0, 0.0, 0.0
    for track, gap in zip(tracks, gaps, strict=True):
        if not track.timed:
            continue
        start = min(start, float(track.times[0])) if time else float(track.times[0])
        length = np.sqrt((np.diff(track.positions, axis=0) ** 2).sum(axis=1))
        moved = ~gap & (length > 0)
        way, time = (
            way + float(length[moved].sum()),
            time + float(np.diff(track.times)[moved].sum()),
        )

    # distance over speed
    speed = way / time if way > 0 and time > 0 else 1.0
    return tuple(
        track if track.timed else replace(track, times=start + track.times / speed, timed=True)
        for track in tracks
    )


def shape_error(samples: NDArray[np.float64], knots: NDArray[np.float64]) -> tuple[float, float]:
    """Compare two lines at equal shares of their ways.

    With s from 0 to 1 the share of each line's own length, and D(s) the difference of the two places, D is linear between the shares
    at which either line has a vertex. So the mean of |D|^2 over an interval with ends a and b is (a.a + a.b + b.b) / 3, and the
    largest |D| is at a vertex.

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
    ours, theirs = _distance_fractions(samples), _distance_fractions(knots)
    shares = np.unique(np.concatenate([ours, theirs]))
    apart = _interpolate_at(shares, ours, samples) - _interpolate_at(shares, theirs, knots)
    square = (apart**2).sum(axis=1)
    if len(shares) == 1:
        return float(square[0]), float(np.sqrt(square[0]))
    mixed = (apart[1:] * apart[:-1]).sum(axis=1)
    mean = float(
        (np.diff(shares) * (square[1:] + square[:-1] + mixed)).sum() / 3 / (shares[-1] - shares[0])
    )
    return mean, float(np.sqrt(square.max()))


def assign_times_by_distance(
    walk: Walk, nodes: NDArray[np.float64], first: float, last: float
) -> Walk:
    """Give a walk without times the share of its way as time, from ``first`` to ``last``.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), None, np.array([False]))
    >>> assign_times_by_distance(walk, np.array([[0.0], [5.0]]), 2.0, 4.0).times.tolist()
    [2.0, 4.0]
    """
    return replace(
        walk, times=first + _distance_fractions(nodes[walk.nodes]) * (last - first), spans=None
    )


def drop_time_steps(walks: GridWalks, untimed: frozenset[int], *, others: bool) -> GridWalks:
    """Take the times away from walks that stand for shapes.

    Parameters
    ----------
    walks : LatticeWalks
        With times.
    untimed : frozenset of int
        Numbers of the walks that stand for shapes.
    others : bool
        Whether the archive has times all the same: of other walks, or of a map kept elsewhere. The knots of shapes are then one cell
        apart, which takes next to no bits.
    """
    if not untimed:
        return walks
    start = min(
        (
            int(walk.time_steps[0])
            for number, walk in enumerate(walks.walks)
            if number not in untimed
        ),
        default=0,
    )
    stripped = tuple(
        _drop_stops(walk, start, others=others) if number in untimed else walk
        for number, walk in enumerate(walks.walks)
    )
    return replace(walks, walks=stripped, timed=others, untimed=untimed if others else frozenset())


def _drop_stops(walk: GridWalk, start: int, *, others: bool) -> GridWalk:
    """The walk without stops, which mean nothing where there are no times."""
    keep = np.append(True, walk.gaps | (walk.nodes[1:] != walk.nodes[:-1]))
    nodes, gaps = walk.nodes[keep], walk.gaps[keep[1:]]
    cells = start + np.arange(len(nodes)) if others else np.zeros(len(nodes), np.int64)
    return GridWalk(nodes, cells.astype(np.int64), gaps)


def _distance_fractions(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the way at each vertex; a line without length is at its start."""
    along = np.append(0.0, np.cumsum(np.sqrt((np.diff(vertices, axis=0) ** 2).sum(axis=1))))
    return (
        along / along[-1] if along[-1] > 0 else np.linspace(0.0, 1.0, len(along)) * (len(along) > 1)
    )


def _interpolate_at(
    shares: NDArray[np.float64], own: NDArray[np.float64], vertices: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.stack([np.interp(shares, own, axis) for axis in vertices.T], axis=1)
