"""Walks as a map shows them: cut where tracks start and end, where that is well before the node at the end of the part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model.walk import Walk

__all__ = ["trim_walks"]


def trim_walks(
    nodes: NDArray[np.float64], walks: Sequence[Walk], tolerance: float
) -> tuple[NDArray[np.float64], tuple[Walk, ...]]:
    """Let walks begin and end where their tracks do.

    The first and the last knot of a piece lie up to a time step outside of its samples, and the node there may be far from the
    first or the last of them. A map that draws the whole part shows travel that nobody has seen.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Metres.
    walks : sequence of Walk
        Over these nodes.
    tolerance : float
        Metres; a node this near to where a piece begins or ends stands for that place.

    Returns
    -------
    nodes : float64 array, shape (V + new, d)
        The nodes, and new ones where pieces begin and end.
    walks : tuple of Walk
        Over all nodes.

    Examples
    --------
    >>> walk = Walk("0", np.array([0, 1], np.int32), np.array([0.0, 10.0]), np.array([False]), np.array([[0.0, 4.0]]))
    >>> nodes, walks = trim_walks(np.array([[0.0, 0.0], [500.0, 0.0]]), [walk], tolerance=20.0)
    >>> nodes[2].tolist(), walks[0].nodes.tolist(), walks[0].times.tolist()
    ([200.0, 0.0], [0, 2], [0.0, 4.0])
    """
    new: list[NDArray[np.float64]] = []
    count, cut = len(nodes), []
    for walk in walks:
        knots, times, places = _find_ends_to_trim(walk, nodes, tolerance)
        if not len(knots):
            cut.append(walk)
            continue
        own, clock = walk.nodes.copy(), np.array(walk.times)
        own[knots], clock[knots] = count + np.arange(len(knots)), times
        count += len(knots)
        new.append(places)
        cut.append(replace(walk, nodes=own, times=clock))
    return np.concatenate([nodes, *new]), tuple(cut)


def _find_ends_to_trim(
    walk: Walk, nodes: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Knots that lie too far outside, and time and place of the start or end that they stand for."""
    if walk.times is None or walk.spans is None or len(walk.nodes) < 2:
        return np.zeros(0, np.intp), np.zeros(0), np.zeros((0, nodes.shape[1]))
    first, last = (
        np.flatnonzero(np.append(True, walk.gaps)),
        np.flatnonzero(np.append(walk.gaps, True)),
    )
    several = first < last

    # the first knot of a piece with the one after it, and the last with the one before it
    knots = np.concatenate([first[several], last[several]])
    inner = np.concatenate([first[several] + 1, last[several] - 1])
    times = np.concatenate([walk.spans[several, 0], walk.spans[several, 1]])

    # where the part is at the start or the end
    share = ((times - walk.times[inner]) / (walk.times[knots] - walk.times[inner]))[:, None]
    here, there = nodes[walk.nodes[knots]], nodes[walk.nodes[inner]]
    places = there + share * (here - there)

    # a part that lies outside as a whole is no travel at all
    far = (np.sqrt(((places - here) ** 2).sum(axis=1)) > tolerance) & (share[:, 0] > 0)

    # a piece of one part that is cut at both ends keeps its knots in order
    return knots[far], times[far], places[far]
