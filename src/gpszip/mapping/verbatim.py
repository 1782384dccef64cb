"""Walks with a knot at every sample: large, and within any bound, where no map can be learned."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import GridWalks, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_index
from gpszip.walks.quantised import choose_grid, merge_grid_walks, quantise_walks

__all__ = ["keep_samples"]

#: The error, divided by the distance that the highest speed covers in a time step.
_ERROR_PER_TIME_STEP = 3

#: Sample intervals per time step at least, so that no segment gets much shorter.
_STEPS_PER_INTERVAL = 6

#: Seconds above which a sample interval is not needed to choose the time step.
_MAX_INTERVAL = 2.0


def keep_samples(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], error: float
) -> tuple[QuantisationGrid, GridWalks]:
    """Round every sample to a quantisation grid fine enough for a maximum error.

    Parameters
    ----------
    tracks : sequence of Track
        At least one, on one plane.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.
    error : float
        Largest synchronised distance in metres, as far as the smallest steps allow it.

    Returns
    -------
    QuantisationGrid, GridWalks
        The grid, and walks with one node for each grid position that samples round to.

    Examples
    --------
    >>> track = Track("a", [0, 1, 2], [[0.0], [5.0], [0.2]])
    >>> grid, grid_walks = keep_samples([track], [np.zeros(2, bool)], 1.0)
    >>> grid_walks.nodes.tolist(), grid_walks.walks[0].nodes.tolist()
    ([[0], [5]], [0, 1, 0])
    """
    # Each sample is a node of its own, until nodes at one grid position are merged.
    positions = np.concatenate([track.positions for track in tracks])
    bounds = np.cumsum([0] + [len(track) for track in tracks])
    knots = np.arange(len(positions), dtype=np.int32)
    walks = [
        Walk(track.id, knots[first : first + len(track)], track.times, gap)
        for track, gap, first in zip(tracks, gaps, bounds.tolist(), strict=False)
    ]

    # Half a step along each axis, and half a time step at full speed, stay within the error
    # together.
    space = step_index(error / math.sqrt(positions.shape[1]))
    grid = choose_grid(
        positions,
        walks,
        space=space,
        time=step_index(_choose_time_step(tracks, gaps, error)),
        plane=tracks[0].plane,
    )
    return grid, merge_grid_walks([quantise_walks(positions, walks, grid)])


def _choose_time_step(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], error: float
) -> float:
    """Seconds in which the highest speed covers a third of the error.

    At most a sixth of the shortest sample interval.
    """
    time_step = math.inf
    reach = error / _ERROR_PER_TIME_STEP
    for track, gap in zip(tracks, gaps, strict=True):
        intervals = np.diff(track.times)
        distances = np.linalg.norm(np.diff(track.positions, axis=0), axis=1)
        is_moving = (distances > 0) & ~gap
        time_step = min(
            time_step,
            float(intervals.min(initial=_MAX_INTERVAL)) / _STEPS_PER_INTERVAL,
            float((reach * intervals[is_moving] / distances[is_moving]).min(initial=math.inf)),
        )
    return time_step
