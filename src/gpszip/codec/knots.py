"""The knots of all walks, concatenated in the arrays that kernels take."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import CorruptArchiveError
from gpszip.model import GridWalk, GridWalks

__all__ = ["Knots", "check_times", "concatenate_knots", "ends_of_pieces", "split_knots"]


class Knots(NamedTuple):
    """Knots of all walks, one walk after the other; K in all.

    Parameters
    ----------
    nodes, time_steps : int64 arrays, shape (K,)
        Node and time step of each knot.
    gaps : int8 array, shape (K,)
        1 where a gap leads to the knot.
    begins : int8 array, shape (K,)
        1 where a track begins at the knot.
    """

    nodes: NDArray[np.int64]
    time_steps: NDArray[np.int64]
    gaps: NDArray[np.int8]
    begins: NDArray[np.int8]


def concatenate_knots(walks: GridWalks) -> Knots:
    """Concatenate the knots of all walks.

    Examples
    --------
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([5, 9]), np.array([True]))
    >>> knots = concatenate_knots(GridWalks(np.array([[0, 0], [30, 4]]), (walk, walk)))
    >>> knots.nodes.tolist(), knots.gaps.tolist(), knots.begins.tolist()
    ([0, 1, 0, 1], [0, 1, 0, 1], [1, 0, 1, 0])
    """
    if not walks.walks:
        return Knots(
            np.zeros(0, np.int64),
            np.zeros(0, np.int64),
            np.zeros(0, np.int8),
            np.zeros(0, np.int8),
        )
    nodes = np.concatenate([walk.nodes for walk in walks.walks]).astype(np.int64)
    time_steps = np.concatenate([walk.time_steps for walk in walks.walks]).astype(np.int64)
    begins = np.zeros(len(nodes), np.int8)
    begins[np.cumsum([0] + [len(walk.nodes) for walk in walks.walks[:-1]])] = 1
    gaps = np.zeros(len(nodes), np.int8)
    gaps[begins == 0] = np.concatenate([walk.gaps for walk in walks.walks])
    return Knots(nodes, time_steps, gaps, begins)


def ends_of_pieces(knots: Knots) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether each knot is the first of its piece, and whether it is the last.

    Examples
    --------
    >>> from gpszip.model import GridWalk
    >>> walk = GridWalk(np.arange(3, dtype=np.int32), np.arange(3), np.array([False, True]))
    >>> first, last = ends_of_pieces(concatenate_knots(GridWalks(np.zeros((3, 1)), (walk,))))
    >>> first.tolist(), last.tolist()
    ([True, False, True], [False, True, True])
    """
    first = (knots.begins == 1) | (knots.gaps == 1)
    return first, np.append(first[1:], True)[: len(first)]


def split_knots(knots: Knots) -> tuple[GridWalk, ...]:
    """Undo :func:`concatenate_knots`."""
    # The walks share three arrays: 100,000 walks take half as long as with arrays of their own.
    bounds = np.append(np.flatnonzero(knots.begins), len(knots.nodes))
    nodes, time_steps = knots.nodes.astype(np.int32), knots.time_steps.copy()
    gaps = knots.gaps == 1
    return tuple(
        GridWalk(nodes[first:end], time_steps[first:end], gaps[first + 1 : end])
        for first, end in pairwise(bounds.tolist())
    )


def check_times(knots: Knots) -> None:
    """Refuse knots of walks with times that don't increase along each walk.

    Raises
    ------
    CorruptArchiveError
        If a time goes back, or stays.
    """
    # From one track to the next, time may go back.
    if (np.diff(knots.time_steps)[knots.begins[1:] == 0] <= 0).any():
        raise CorruptArchiveError("times of the walks go back")
