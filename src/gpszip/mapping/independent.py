"""The thesis's own model as an archive: a (k,m)-segment mean, its map by Algorithm 5, and the track as a walk on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.mapping.segment_map import build_walk, make_map
from gpszip.model import (
    GridWalks,
    Listener,
    Options,
    Progress,
    QuantisationGrid,
    SegmentMean,
    Track,
    Walk,
)
from gpszip.model.grid import step_index
from gpszip.run.executor import Executor
from gpszip.segmentation.bound import segment_mean_within
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.search import find_parameters
from gpszip.walks.error import ErrorSummary, measure_errors
from gpszip.walks.quantised import choose_grid, dequantise_walks, node_positions, quantise_walks

__all__ = ["learn_map"]

#: Rounding nodes and times to the lattice may add this share to the RMSE.
_ADDED = 0.05

#: Below this many metres an RMSE is as good as none.
_SMALLEST = 1e-3

#: m is searched up to here.
_MOST_SEGMENTS = 100

#: How often the quanta are made finer by half an octave.
_REFINEMENTS = 48


def learn_map(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    options: Options,
    *,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[QuantisationGrid, GridWalks]:
    """Learn the segment mean of one track, and round its walk to the coarsest lattice that keeps the error.

    Where k is given and m is not, m is at the elbow of the cost (Algorithm 3). Where a bound is given and k is not, k is
    the smallest that holds it, with m as given. Gaps are marked between parts; one inside a part is travelled through.

    Parameters
    ----------
    tracks : sequence of one Track
        The thesis's model has no others.
    gaps : sequence of one bool array, shape (n - 1,)
        The steps that are gaps.
    options : Options
        With k, m or both.
    executor : Executor, optional
        Spreads the work.
    progress : callable, optional
        Called with events.

    Returns
    -------
    Frame, LatticeWalks
        The lattice, and map and walk on it.

    Raises
    ------
    OptionError
        If there are several tracks, or k or m don't fit the track.
    BoundError
        If no k holds the bound.
    """
    if len(tracks) != 1:
        raise OptionError(
            f"k and m describe the thesis's model, which has one track; there are {len(tracks)}: compress each alone"
        )
    if progress is not None:
        progress(Progress("segment mean", 0.0))
    mean = _learn_segment_mean(tracks[0], options, executor)
    walk = _mark_gaps(build_walk(mean, tracks[0]), tracks[0], gaps[0])
    return _round_to_grid(tracks[0], make_map(mean).road_map.nodes, walk, options)


def _learn_segment_mean(track: Track, options: Options, executor: Executor | None) -> SegmentMean:
    if options.k is None:
        spare = 1 + _ADDED / 2
        rmse, max_error = (
            None if bound is None else bound / spare for bound in (options.rmse, options.max_error)
        )
        return segment_mean_within(
            track, rmse=rmse, max_error=max_error, m=options.m, executor=executor
        )
    if options.m is None:
        return find_parameters(
            track, (options.k, options.k), (1, min(options.k, _MOST_SEGMENTS)), executor=executor
        ).mean
    return segment_mean(track, options.k, options.m, executor=executor)


def _mark_gaps(walk: Walk, track: Track, gaps: NDArray[np.bool_]) -> Walk:
    """Mark the hops between parts that end where a gap of the track ends."""
    if walk.times is None or not gaps.any():
        return walk
    before = np.searchsorted(track.times, walk.times[:-1], side="right") - 1
    after = np.minimum(before + 1, len(track) - 1)
    silent = np.append(gaps, False)[before] & (walk.times[1:] == track.times[after])
    return Walk(walk.id, walk.nodes, walk.times, walk.gaps | silent)


def _round_to_grid(
    track: Track, nodes: NDArray[np.float64], walk: Walk, options: Options
) -> tuple[QuantisationGrid, GridWalks]:
    """Start with quanta as large as the error (theory: their error is a third of it) and refine until they add little."""
    exact = measure_errors([track], [walk], nodes)
    size = max(exact.rmse, _SMALLEST)
    pace = _seconds_per_metre(nodes, walk)
    for step in range(_REFINEMENTS):
        finer = size * 2.0 ** (-step / 2)
        grid = choose_grid(
            nodes, [walk], space=step_index(finer), time=step_index(finer * pace), plane=track.plane
        )
        grid_walks = quantise_walks(nodes, [walk], grid)
        found = measure_errors(
            [track],
            dequantise_walks(grid_walks, grid, [track.id]),
            node_positions(grid_walks, grid),
        )
        if _is_close_enough(found, exact, options):
            break
    return grid, grid_walks


def _is_close_enough(found: ErrorSummary, exact: ErrorSummary, options: Options) -> bool:
    if found.rmse > max(exact.rmse * (1 + _ADDED), _SMALLEST):
        return False
    held = exact.rmse <= (options.rmse or np.inf) and exact.max_error <= (
        options.max_error or np.inf
    )
    return not held or (
        found.rmse <= (options.rmse or np.inf) and found.max_error <= (options.max_error or np.inf)
    )


def _seconds_per_metre(nodes: NDArray[np.float64], walk: Walk) -> float:
    """Seconds for each metre of the walk."""
    assert walk.times is not None
    length = float(np.linalg.norm(np.diff(nodes[walk.nodes], axis=0), axis=1)[~walk.gaps].sum())
    duration = float(np.diff(walk.times)[~walk.gaps].sum())
    return duration / length if length > 0 and duration > 0 else 1.0
