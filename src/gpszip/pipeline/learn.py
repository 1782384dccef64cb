"""Learning map and walks of a log for one target.

What a log in memory doesn't need is imported where it is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.mapping.search import learn_map
from gpszip.model import Options, Track
from gpszip.model.grid import refined_grid
from gpszip.model.log import MemoryLog
from gpszip.pipeline.job import Job
from gpszip.pipeline.learned import Learned
from gpszip.walks.shapes import with_synthetic_times

__all__ = ["Learned", "keep_all_samples", "learn"]


def learn(job: Job, target: Options) -> Learned | None:
    """Learn map and walks that hold a target, or come close.

    Parameters
    ----------
    job : Job
        The log.
    target : Options
        With the bound to aim at.

    Returns
    -------
    Learned or None
        None where nothing was found.
    """
    if target.thesis:
        return _learn_segment_mean(job, target)
    if target.rmse is None and target.max_error is None:
        return None
    if job.batch is None:
        return _learn_at_once(job, target)
    from gpszip.pipeline.learn_in_batches import learn_in_batches

    return learn_in_batches(job, target)


def keep_all_samples(job: Job, limit: float) -> Learned:
    """Make each sample of a log in memory a knot, rounded by ``limit`` metres at most."""
    from gpszip.mapping.verbatim import keep_samples

    tracks = with_synthetic_times(_tracks(job), job.gaps)
    return Learned(*keep_samples(tracks, job.gaps, limit))


def _learn_segment_mean(job: Job, target: Options) -> Learned:
    """Learn the thesis's (k,m)-segment mean of one track (algorithm 1)."""
    from gpszip.mapping import independent

    tracks, gaps = _samples_to_learn(job)
    return Learned(
        *independent.learn_map(tracks, gaps, target, executor=job.executor, progress=job.listener)
    )


def _learn_at_once(job: Job, target: Options) -> Learned | None:
    """Learn map and walks of a log in memory."""
    # Take all samples or those of a coreset; shapes get synthetic times.
    tracks, gaps = _samples_to_learn(job)

    # Report learning as a share of its steps.
    def report(done: int, steps: int) -> None:
        job.report("learn", done / steps)

    # On a map of its own.
    job.report("learn", 0.0)
    if job.map is None:
        learned = learn_map(
            tracks,
            gaps,
            rmse=target.rmse,
            max_error=target.max_error,
            effort=target.effort,
            executor=job.executor,
            progress=report,
        )
        if learned is None:
            return None
        if job.options.coreset is not None and target.max_error is not None:
            return _with_max_error(job, Learned(*learned), target.max_error)
        return Learned(*learned)

    # A known map has a grid already, whose steps may be too coarse for the bound.
    from gpszip.mapping.on_known_map import learn_on, needed_refinements

    # Halve the steps of the map's grid as often as the bound needs, and learn the walks on it.
    refinements = needed_refinements(job.map.grid, target.rmse, target.max_error)
    grid = refined_grid(job.map.grid, refinements)
    grid_walks = learn_on(
        job.map.prior(refinements),
        grid,
        tracks,
        gaps,
        rmse=target.rmse,
        max_error=target.max_error,
        effort=target.effort,
        executor=job.executor,
        progress=report,
    )
    return None if grid_walks is None else Learned(grid, grid_walks, refinements)


def _samples_to_learn(
    job: Job,
) -> tuple[Sequence[Track], Sequence[NDArray[np.bool_]]]:
    """All samples of a log in memory, or the weighted ones of the coreset that was asked for."""
    tracks = with_synthetic_times(_tracks(job), job.gaps)
    if job.options.coreset is None:
        return tracks, job.gaps
    from gpszip.mapping.thinning import reduce_to_coreset

    return reduce_to_coreset(tracks, job.gaps, job.options.coreset)


def _with_max_error(job: Job, learned: Learned, max_error: float) -> Learned | None:
    """Insert knots until the samples that a coreset lacks hold the maximum, too."""
    from gpszip.mapping.max_error import enforce_max_error

    tracks = with_synthetic_times(_tracks(job), job.gaps)
    result = enforce_max_error(tracks, learned.grid, learned.grid_walks, max_error)
    return None if result is None else replace(learned, grid=result[0], grid_walks=result[1])


def _tracks(job: Job) -> tuple[Track, ...]:
    assert isinstance(job.log, MemoryLog)
    return job.log.tracks
