"""The thesis's own model as an archive: a (k,m)-segment mean and its map by algorithm 5."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

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
from gpszip.segmentation.bound import Report, segment_mean_within
from gpszip.segmentation.em import segment_mean
from gpszip.segmentation.runs import join_tracks
from gpszip.segmentation.search import find_parameters
from gpszip.walks.error import ErrorSummary, measure_errors
from gpszip.walks.quantised import choose_grid, dequantise_walks, node_positions, quantise_walks

__all__ = ["learn_map"]

#: Share of the RMSE that rounding nodes and times to the grid may add.
_ROUNDING_SHARE = 0.05

#: Metres below which an RMSE counts as none.
_MIN_RMSE = 1e-3

#: Refinements of the grid by half an octave each that are tried.
_REFINEMENTS = 48


def learn_map(
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    options: Options,
    *,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[QuantisationGrid, GridWalks]:
    """Learn the segment mean of tracks, and round their walks to the coarsest suitable grid.

    Where k is given and m is not, m is at the elbow of the cost (algorithm 3). Where a bound is
    given, k is the smallest that keeps it, with m as given; or with k as given, m is. Parts don't
    go on from track to track. Gaps between pieces of the segment mean are marked; a gap inside a
    piece is travelled through.

    Parameters
    ----------
    tracks : sequence of Track
        All share the segments.
    gaps : sequence of bool arrays, shape (n - 1,)
        The steps that are gaps.
    options : Options
        With k, m or both.
    executor : Executor, optional
        Spreads the work.
    progress : callable, optional
        Called with events.

    Returns
    -------
    QuantisationGrid, GridWalks
        The grid, and map and walks on it.

    Raises
    ------
    OptionError
        If k or m don't fit the tracks.
    BoundError
        If no k keeps the bound.
    """

    # Tell the listener that the one stage begins, and what share is done.
    def report(done: float) -> None:
        if progress is not None:
            progress(Progress("segment mean", done, sum(map(len, tracks))))

    report(0.0)
    joined, begins = join_tracks(tracks)
    mean = _learn_segment_mean(joined, begins, options, executor, report)

    # Each track as a walk on the map of all.
    walks = [
        _mark_gaps(build_walk(part, track), track, gap)
        for part, track, gap in zip(_split_mean(mean), tracks, gaps, strict=True)
    ]
    return _round_to_grid(tracks, make_map(mean).road_map.nodes, walks, options)


def _learn_segment_mean(
    joined: Track,
    begins: NDArray[np.int64],
    options: Options,
    executor: Executor | None,
    report: Report,
) -> SegmentMean:
    """Learn the segment mean, with whichever of k and m are given."""
    k, m = options.k, options.m
    if k is not None and m is not None:
        return segment_mean(joined, k, m, begins, executor=executor)

    # A bound leaves half of what rounding may add.
    if options.bounded:
        margin = 1 + _ROUNDING_SHARE / 2
        rmse, max_error = (
            None if bound is None else bound / margin for bound in (options.rmse, options.max_error)
        )
        return segment_mean_within(
            joined, rmse=rmse, max_error=max_error, k=k, m=m, begins=begins, executor=executor
        )
    assert k is not None
    return find_parameters(
        joined, (k, k), (1, k), begins=begins, executor=executor, report=report
    ).mean


def _split_mean(mean: SegmentMean) -> Iterator[SegmentMean]:
    """Yield the parts of each track, with the segments of all; their costs are not known."""
    for head, after in pairwise([*mean.heads.tolist(), mean.k]):
        boundaries = mean.boundaries[head : after + 1] - mean.boundaries[head]
        yield SegmentMean(boundaries, mean.labels[head:after], mean.starts, mean.ends, math.nan)


def _mark_gaps(walk: Walk, track: Track, gaps: NDArray[np.bool_]) -> Walk:
    """Mark the steps between pieces that end where a gap of the track ends."""
    if walk.times is None or not gaps.any():
        return walk
    before = np.searchsorted(track.times, walk.times[:-1], side="right") - 1
    after = np.minimum(before + 1, len(track) - 1)
    is_gap = np.append(gaps, False)[before] & (walk.times[1:] == track.times[after])
    return Walk(walk.id, walk.nodes, walk.times, walk.gaps | is_gap)


def _round_to_grid(
    tracks: Sequence[Track], nodes: NDArray[np.float64], walks: list[Walk], options: Options
) -> tuple[QuantisationGrid, GridWalks]:
    """Start with steps as large as the error, and refine the grid until rounding adds little.

    In theory, rounding to such steps has a third of the error.
    """
    # Take the error as the coarsest space step; the walk's pace gives the time step.
    exact = measure_errors(tracks, walks, nodes)
    size = max(exact.rmse, _MIN_RMSE)
    pace = _seconds_per_metre(nodes, walks)
    for refinement in range(_REFINEMENTS):
        # Both steps shrink by half an octave, and keep the ratio of the walk's pace.
        finer = size * 2.0 ** (-refinement / 2)
        grid = choose_grid(
            nodes,
            walks,
            space=step_index(finer),
            time=step_index(finer * pace),
            plane=tracks[0].plane,
        )
        grid_walks = quantise_walks(nodes, walks, grid)

        # Stop at the first grid whose rounding adds little error.
        rounded = measure_errors(
            tracks,
            dequantise_walks(grid_walks, grid, [track.id for track in tracks]),
            node_positions(grid_walks, grid),
        )
        if _is_close_enough(rounded, exact, options):
            break
    return grid, grid_walks


def _is_close_enough(rounded: ErrorSummary, exact: ErrorSummary, options: Options) -> bool:
    """Whether rounding adds little error, and breaks no bound that the exact walk keeps."""
    if rounded.rmse > max(exact.rmse * (1 + _ROUNDING_SHARE), _MIN_RMSE):
        return False
    return not _keeps_bounds(exact, options) or _keeps_bounds(rounded, options)


def _keeps_bounds(errors: ErrorSummary, options: Options) -> bool:
    return errors.rmse <= (options.rmse or np.inf) and errors.max_error <= (
        options.max_error or np.inf
    )


def _seconds_per_metre(nodes: NDArray[np.float64], walks: list[Walk]) -> float:
    """Pace of the walks in seconds per metre, without gaps; 1 where they do not move."""
    length, duration = 0.0, 0.0
    for walk in walks:
        assert walk.times is not None
        steps = np.linalg.norm(np.diff(nodes[walk.nodes], axis=0), axis=1)
        length += float(steps[~walk.gaps].sum())
        duration += float(np.diff(walk.times)[~walk.gaps].sum())
    return duration / length if length > 0 and duration > 0 else 1.0
