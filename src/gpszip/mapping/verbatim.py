"""Walks with a knot at every sample: large, and within any bound. The last resort where no map can be learned."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import GridWalks, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_index
from gpszip.walks.quantised import choose_grid, merge_grid_walks, quantise_walks

__all__ = ["keep_samples"]


def keep_samples(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], error: float
) -> tuple[QuantisationGrid, GridWalks]:
    """Round every sample to a lattice so fine that none lies farther than ``error`` from its walk, as far as quanta go.

    Parameters
    ----------
    tracks : sequence of Track
        At least one, on one plane.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.
    error : float
        Largest synchronised distance in metres.

    Returns
    -------
    Frame, LatticeWalks
        The lattice, and one node for each place that a sample rounds to.

    Examples
    --------
    >>> grid, grid_walks = keep_samples([Track("a", [0, 1, 2], [[0.0], [5.0], [0.2]])], [np.zeros(2, bool)], 1.0)
    >>> grid_walks.nodes.tolist(), grid_walks.walks[0].nodes.tolist()
    ([[0], [5]], [0, 1, 0])
    """
    positions = np.concatenate([track.positions for track in tracks])
    bounds = np.cumsum([0] + [len(track) for track in tracks])
    knots = np.arange(len(positions), dtype=np.int32)
    walks = [
        Walk(track.id, knots[first : first + len(track)], track.times, gap)
        for track, gap, first in zip(tracks, gaps, bounds.tolist(), strict=False)
    ]
    # Half a quantum of each axis, and half a quantum of time at full speed, stay within the error together.
    space = step_index(error / math.sqrt(positions.shape[1]))
    grid = choose_grid(
        positions,
        walks,
        space=space,
        time=step_index(_time_step(tracks, gaps, error)),
        plane=tracks[0].plane,
    )
    return grid, merge_grid_walks([quantise_walks(positions, walks, grid)])


def _time_step(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], error: float) -> float:
    """A third of the error at the highest speed, and no more than a sixth of the shortest step, so that no part gets much shorter."""
    longest = math.inf
    for track, gap in zip(tracks, gaps, strict=True):
        steps = np.diff(track.times)
        way = np.linalg.norm(np.diff(track.positions, axis=0), axis=1)
        moving = (way > 0) & ~gap
        longest = min(
            longest,
            float(steps.min(initial=2.0)) / 6,
            float((error / 3 * steps[moving] / way[moving]).min(initial=math.inf)),
        )
    return longest
