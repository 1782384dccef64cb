"""Walks that begin and end exactly where their tracks do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model.walk import Walk
from gpszip.walks.cut_ends import trim_walks

__all__ = ["walks_to_their_ends"]


def walks_to_their_ends(
    nodes: NDArray[np.float64], walks: Sequence[Walk]
) -> tuple[NDArray[np.float64], tuple[Walk, ...]]:
    """Cut walks to the time in which travel is claimed.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Positions in metres.
    walks : sequence of Walk
        Walks on these nodes.

    Returns
    -------
    nodes : float64 array, shape (V + new, d)
        The nodes, and new ones where walks are cut.
    walks : tuple of Walk
        The first and the last knot of each piece is at the time of its first and last sample.

    Examples
    --------
    >>> walk = Walk(
    ...     "0", np.array([0, 0]), np.array([0.0, 10.0]), np.array([False]), np.array([[0.0, 4.0]])
    ... )
    >>> walks_to_their_ends(np.zeros((1, 2)), [walk])[1][0].times.tolist()
    [0.0, 4.0]
    """
    # Where a piece moves at its end, the cut has a node of its own; where it rests, only the time
    # of the knot changes.
    nodes, cut = trim_walks(nodes, walks, tolerance=0.0)
    return nodes, tuple(_clip_times(walk) for walk in cut)


def _clip_times(walk: Walk) -> Walk:
    """Move the first and the last knot of each piece to the time range of its samples."""
    if walk.times is None or walk.time_ranges is None:
        return walk
    first = np.flatnonzero(np.append(True, walk.gaps))
    last = np.flatnonzero(np.append(walk.gaps, True))
    times = walk.times.copy()
    times[first] = np.maximum(times[first], walk.time_ranges[:, 0])
    times[last] = np.minimum(times[last], walk.time_ranges[:, 1])
    return replace(walk, times=times)
