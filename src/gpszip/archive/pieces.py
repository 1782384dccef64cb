"""The pieces in which tracks with gaps come back: their names, and their knots from start to end."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.model.walk import Walk

__all__ = ["clip_to_span", "measure_shape", "pieces_by_track"]


def pieces_by_track(walks: Sequence[Walk]) -> dict[str, list[tuple[str, slice]]]:
    """Name and knots of the pieces between gaps, for each track.

    A track without gaps keeps its name, any other has pieces ``id/0``, ``id/1``, ...; with more slashes where one of these names is taken.

    Examples
    --------
    >>> torn, whole = np.array([False, True, False]), np.zeros(3, bool)
    >>> nodes, times = np.arange(4, dtype=np.int32), np.arange(4.0)
    >>> found = pieces_by_track([Walk("a", nodes, times, torn), Walk("a/1", nodes, times, whole)])
    >>> [name for pieces in found.values() for name, _ in pieces]
    ['a//0', 'a//1', 'a/1']
    """
    ends = [[0, *(np.flatnonzero(walk.gaps) + 1).tolist(), len(walk.nodes)] for walk in walks]
    taken = {walk.id for walk, cuts in zip(walks, ends, strict=True) if len(cuts) == 2}
    found = {}
    for walk, cuts in zip(walks, ends, strict=True):
        names, slashes = [walk.id], "/"
        if len(cuts) > 2:
            while not taken.isdisjoint(
                names := [f"{walk.id}{slashes}{i}" for i in range(len(cuts) - 1)]
            ):
                slashes += "/"
            taken.update(names)
        found[walk.id] = [
            (name, slice(a, b)) for name, (a, b) in zip(names, pairwise(cuts), strict=True)
        ]
    return found


def clip_to_span(
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
    >>> times, positions = clip_to_span(np.array([0.0, 10.0]), np.array([[0.0], [20.0]]), 1.0, 6.0)
    >>> times.tolist(), positions.tolist()
    ([1.0, 6.0], [[2.0], [12.0]])
    """
    if first <= times[0] and last >= times[-1]:
        return times, positions
    inside = times[(times > first) & (times < last)]
    when = np.unique(np.concatenate([[first], inside, [last]]))
    return when, np.stack([np.interp(when, times, axis) for axis in positions.T], axis=1)


def measure_shape(
    positions: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance along a shape at each of its positions, in metres; positions that repeat the one before are left out.

    Examples
    --------
    >>> along, positions = measure_shape(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 5.0]]))
    >>> along.tolist(), len(positions)
    ([0.0, 5.0, 6.0], 3)
    """
    along = np.append(0.0, np.cumsum(np.sqrt((np.diff(positions, axis=0) ** 2).sum(axis=1))))
    fresh = np.append(True, np.diff(along) > 0)
    return along[fresh], positions[fresh]
