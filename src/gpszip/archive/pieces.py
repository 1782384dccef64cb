"""The gap-free pieces of tracks: their names, and their knots from start to end."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model.grid import Plane
from gpszip.model.track import Track
from gpszip.model.walk import Walk, cut_at_gaps

__all__ = [
    "add_points",
    "build_pieces",
    "clip_to_time_range",
    "measure_shape",
    "pieces_by_track",
    "plain_names",
    "time_range_of_piece",
]

#: Seconds between a knot and a point that is added, as files write times in milliseconds.
_LEAST_INTERVAL = 1e-3


def pieces_by_track(walks: Sequence[Walk]) -> dict[str, list[tuple[str, slice]]]:
    """Name and knots of the pieces between gaps, for each track.

    A track without gaps keeps its name, any other has pieces ``id/0``, ``id/1``, ...; with more
    slashes where one of these names is taken.

    Examples
    --------
    >>> with_gap, without = np.array([False, True, False]), np.zeros(3, bool)
    >>> nodes, times = np.arange(4, dtype=np.int32), np.arange(4.0)
    >>> walks = [Walk("a", nodes, times, with_gap), Walk("a/1", nodes, times, without)]
    >>> [name for pieces in pieces_by_track(walks).values() for name, _ in pieces]
    ['a//0', 'a//1', 'a/1']
    """
    # Tracks without gaps have the first choice: they keep their names.
    taken = {walk.id for walk in walks if not walk.gaps.any()}
    pieces = {}
    for walk in walks:
        knots = cut_at_gaps(walk)
        names, slashes = [walk.id], "/"
        if len(knots) > 1:
            # Another slash, until none of the names is taken.
            while not taken.isdisjoint(
                names := [f"{walk.id}{slashes}{number}" for number in range(len(knots))]
            ):
                slashes += "/"
            taken.update(names)
        pieces[walk.id] = list(zip(names, knots, strict=True))
    return pieces


def plain_names(id: str, count: int, ids: Container[str]) -> list[str] | None:
    """Names of the pieces of one track, without a look at any other walk.

    Returns
    -------
    list of str or None
        None where another track may have taken one of them, see :func:`pieces_by_track`.

    Examples
    --------
    >>> plain_names("a", 2, {"a", "b"}), plain_names("a", 2, {"a", "a/1"})
    (['a/0', 'a/1'], None)
    """
    if count == 1:
        return [id]
    names = [f"{id}/{number}" for number in range(count)]
    # Pieces of "a" may be called "a//0", as those of a track "a/" would be.
    if id.endswith("/") or any(name in ids for name in names):
        return None
    return names


def time_range_of_piece(walk: Walk, number: int, knots: slice) -> tuple[float, float]:
    """Seconds at which travel begins and ends in a piece of a walk with times."""
    assert walk.times is not None
    # Without the ends of pieces, as in version 2, travel is claimed from knot to knot.
    ends = walk.times[knots][[0, -1]] if walk.time_ranges is None else walk.time_ranges[number]
    return float(ends[0]), float(ends[1])


def build_pieces(
    walk: Walk,
    nodes: NDArray[np.float64],
    pieces: Sequence[tuple[str, slice]],
    plane: Plane | None,
) -> list[Track]:
    """Tracks of the knots of each piece, from its first sample to its last one.

    Parameters
    ----------
    walk : Walk
        With or without times.
    nodes : float64 array, shape (V, d)
        Positions of its nodes in metres.
    pieces : sequence of (str, slice)
        Name and knots of each piece.
    plane : Plane or None
        Where the nodes lie on the earth.
    """
    tracks = []
    for number, (name, knots) in enumerate(pieces):
        positions = nodes[walk.nodes[knots]]
        if walk.times is None:
            # A shape, with the distance along it in place of times.
            tracks.append(Track(name, *measure_shape(positions), plane=plane, timed=False))
            continue

        # The first and the last knot lie outside of the samples by up to a time step.
        first, last = time_range_of_piece(walk, number, knots)
        times, positions = clip_to_time_range(walk.times[knots], positions, first, last)
        tracks.append(Track(name, times, positions, plane=plane))
    return tracks


def clip_to_time_range(
    times: NDArray[np.float64], positions: NDArray[np.float64], first: float, last: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cut a piece to the time in which travel is claimed.

    Parameters
    ----------
    times : float64 array, shape (k,)
        Seconds of the knots, strictly increasing.
    positions : float64 array, shape (k, d)
        Metres.
    first, last : float
        Seconds, within the knots.

    Returns
    -------
    float64 array, shape (j,), and float64 array, shape (j, d)
        Knots at ``first``, at ``last`` and all between them.

    Examples
    --------
    >>> knots = np.array([0.0, 10.0]), np.array([[0.0], [20.0]])
    >>> times, positions = clip_to_time_range(*knots, 1.0, 6.0)
    >>> times.tolist(), positions.tolist()
    ([1.0, 6.0], [[2.0], [12.0]])
    """
    # Exact knots are given back as they are.
    if first <= times[0] and last >= times[-1]:
        return times, positions
    inside = times[(times > first) & (times < last)]
    # unique drops the second of two equal ends, as times must increase.
    clipped = np.unique(np.concatenate([[first], inside, [last]]))
    return clipped, np.stack([np.interp(clipped, times, axis) for axis in positions.T], axis=1)


def add_points(piece: Track, times: NDArray[np.float64]) -> Track:
    """A piece with further points on its lines, at times in seconds.

    Times outside of it, and within a millisecond of another, are left out.

    Examples
    --------
    >>> piece = Track("a", [0.0, 10.0], [[0.0], [20.0]])
    >>> add_points(piece, np.array([4.0, 4.0005, 10.0, 12.0])).positions.tolist()
    [[0.0], [8.0], [20.0]]
    """
    # Times apart from each other, and from those of the knots.
    if not piece.timed:
        return piece
    inside = np.unique(times[(times > piece.times[0]) & (times < piece.times[-1])])
    inside = inside[np.append(True, np.diff(inside) > _LEAST_INTERVAL)[: len(inside)]]
    after = np.searchsorted(piece.times, inside)
    if not len(inside):
        return piece
    to_knots = np.minimum(inside - piece.times[after - 1], piece.times[after] - inside)
    inside = inside[to_knots > _LEAST_INTERVAL]

    # The points on the lines.
    merged = np.union1d(piece.times, inside)
    axes = [np.interp(merged, piece.times, axis) for axis in piece.positions.T]
    return replace(piece, times=merged, positions=np.stack(axes, axis=1))


def measure_shape(
    positions: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance along a shape at each of its positions, in metres; repeated positions are dropped.

    Examples
    --------
    >>> shape = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 5.0]])
    >>> along, positions = measure_shape(shape)
    >>> along.tolist(), len(positions)
    ([0.0, 5.0, 6.0], 3)
    """
    along = np.append(0.0, np.cumsum(np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))))
    # Distances stand in for times, which must increase.
    moved = np.append(True, np.diff(along) > 0)
    return along[moved], positions[moved]
