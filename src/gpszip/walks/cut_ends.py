"""Walks trimmed to where their tracks start and end, for maps that show observed travel only."""

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
    """Make walks start and end where their tracks do.

    The first and the last knot of a piece lie up to a time step outside of its samples, and the
    node there may be far from the first or the last sample. A map that draws the full segment would
    show travel that nobody observed.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Positions in metres.
    walks : sequence of Walk
        Walks on these nodes.
    tolerance : float
        Metres. Pieces that start or end this near to their node are not trimmed there.

    Returns
    -------
    nodes : float64 array, shape (V + new, d)
        The nodes, followed by new ones where trimmed pieces start and end.
    walks : tuple of Walk
        Walks on all these nodes.

    Examples
    --------
    >>> walk = Walk(
    ...     "0", np.array([0, 1]), np.array([0.0, 10.0]), np.array([False]), np.array([[0.0, 4.0]])
    ... )
    >>> nodes, walks = trim_walks(np.array([[0.0, 0.0], [500.0, 0.0]]), [walk], tolerance=20.0)
    >>> nodes[2].tolist(), walks[0].nodes.tolist(), walks[0].times.tolist()
    ([200.0, 0.0], [0, 2], [0.0, 4.0])
    """
    new_nodes: list[NDArray[np.float64]] = []
    count, trimmed = len(nodes), []
    for walk in walks:
        knots, times, positions = _find_ends_to_trim(walk, nodes, tolerance)
        if not len(knots):
            trimmed.append(walk)
            continue

        # Replace the knots by new nodes.
        walk_nodes, walk_times = walk.nodes.copy(), np.array(walk.times)
        walk_nodes[knots], walk_times[knots] = count + np.arange(len(knots)), times
        count += len(knots)
        new_nodes.append(positions)
        trimmed.append(replace(walk, nodes=walk_nodes, times=walk_times))
    return np.concatenate([nodes, *new_nodes]), tuple(trimmed)


def _find_ends_to_trim(
    walk: Walk, nodes: NDArray[np.float64], tolerance: float
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Knots beyond the start or end of their piece, with the time and position of that end."""
    # Without times, time ranges or segments, nothing can be trimmed.
    if walk.times is None or walk.time_ranges is None or len(walk.nodes) < 2:
        return np.zeros(0, np.intp), np.zeros(0), np.zeros((0, nodes.shape[1]))

    # The first knot of a piece with the one after it, and the last with the one before it.
    first = np.flatnonzero(np.append(True, walk.gaps))
    last = np.flatnonzero(np.append(walk.gaps, True))
    has_segments = first < last
    knots = np.concatenate([first[has_segments], last[has_segments]])
    inner = np.concatenate([first[has_segments] + 1, last[has_segments] - 1])
    times = np.concatenate([walk.time_ranges[has_segments, 0], walk.time_ranges[has_segments, 1]])

    # Where the segment is at the start or the end of the piece.
    # 0 at the inner knot and 1 at the outer one, so that starts and ends are computed alike.
    fraction = ((times - walk.times[inner]) / (walk.times[knots] - walk.times[inner]))[:, None]
    outer_positions, inner_positions = nodes[walk.nodes[knots]], nodes[walk.nodes[inner]]
    positions = inner_positions + fraction * (outer_positions - inner_positions)

    # A segment entirely outside is no travel, and stays. A piece of one segment that is trimmed at
    # both ends keeps its knots in order.
    distance = np.sqrt(((positions - outer_positions) ** 2).sum(axis=1))
    is_far = (distance > tolerance) & (fraction[:, 0] > 0)
    return knots[is_far], times[is_far], positions[is_far]
