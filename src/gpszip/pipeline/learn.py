"""Learning map and walks of a log for one target, in memory or batch by batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.codec.prior import Prior
from gpszip.codec.walks import number_by_visit
from gpszip.errors import BoundError
from gpszip.mapping.max_error import enforce_max_error
from gpszip.mapping.on_known_map import learn_on, needed_refinements
from gpszip.mapping.search import RMSE_PER_MAX_ERROR, learn_map
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.mapping.verbatim import keep_samples
from gpszip.model import GridWalks, Options, QuantisationGrid, Track
from gpszip.model.grid import refined_grid
from gpszip.model.log import MemoryLog
from gpszip.pipeline.encode_batches import BaseMap, encode_batches
from gpszip.pipeline.job import Job
from gpszip.pipeline.time_step import with_best_time_step
from gpszip.walks.shapes import with_synthetic_times

__all__ = ["Learned", "keep_all_samples", "learn"]

#: Shares of the bound for which the map of a subsample is learned, until one is found. Walks on
#: nodes that stay need some slack; on a map without any, some batches can't hold the bound.
_SUBSAMPLE_SHARES = (0.95, 0.85, 0.75)

#: Samples that are a map by themselves where none can be learned from a subsample.
_VERBATIM_SAMPLES = 1000

#: A log is dense if blocks of so many samples, on average, lie close to a line...
_DENSE_BLOCK = 40

#: ...with an RMSE of at most this share of the bound.
_DENSE_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class Learned:
    """Nodes and walks on a grid.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid; of a map kept elsewhere, its own with both steps halved ``refinements`` times.
    grid_walks : GridWalks
        A walk for each track.
    refinements : int
        See ``grid``.
    """

    grid: QuantisationGrid
    grid_walks: GridWalks
    refinements: int = 0


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
    return _learn_in_batches(job, target)


def keep_all_samples(job: Job, limit: float) -> Learned:
    """Make each sample of a log in memory a knot, rounded by ``limit`` metres at most."""
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
    tracks, gaps = _samples_to_learn(job)

    def report(done: int, steps: int) -> None:
        job.report("learn", done / steps)

    # on a map of its own
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

    # on a map kept elsewhere, with finer steps where the bound needs them
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


def _learn_in_batches(job: Job, target: Options) -> Learned | None:
    """Learn a map from a subsample, and encode all batches on it."""

    def report(done: float) -> None:
        job.report("encode", done)

    batches = job.batches
    for base in _base_maps(job, target):
        try:
            grid_walks = encode_batches(job.log, base, batches, job.executor, report)
        except BoundError:
            continue
        if job.map is None:
            grid_walks = number_by_visit(grid_walks)
        return Learned(base.grid, grid_walks, base.refinements)
    return None


def _base_maps(job: Job, target: Options) -> Iterator[BaseMap]:
    """What batches may be encoded on: coarse times first, which take fewer bytes."""
    if job.map is not None:
        yield _known_base(job, job.map, target)
        return
    learned = _learned_base(job, target)
    coarse = with_best_time_step(job.log, learned, job.batches, job.executor)
    yield coarse
    if coarse is not learned:
        yield learned


def _known_base(job: Job, map: Archive, target: Options) -> BaseMap:
    """The walks of a map kept elsewhere."""
    refinements = needed_refinements(map.grid, target.rmse, target.max_error)
    grid = refined_grid(map.grid, refinements)
    share = 1 / max(len(job.batches), 1)
    return BaseMap(grid, map.prior(refinements), job.gap, target, refinements, share)


def _learned_base(job: Job, target: Options) -> BaseMap:
    """A map that is learned from a subsample."""

    def report(done: int, steps: int) -> None:
        job.report("learn", done / steps)

    # few weighted samples of the subsample, where they do
    tracks, gaps = _thin_out(job, target)
    learned = None
    for share in _SUBSAMPLE_SHARES:
        tighter = target.tightened(share)
        learned = learned or learn_map(
            tracks,
            gaps,
            rmse=tighter.rmse,
            max_error=tighter.max_error,
            effort=tighter.effort,
            executor=job.executor,
            progress=report,
        )

    # else the first samples as they are
    if learned is None:
        track = job.log.tracks[0]
        first = job.log.read(track, 0, min(_VERBATIM_SAMPLES, len(track)))
        limit = target.max_error or target.rmse or 0.0
        learned = keep_samples([first], [_gaps_of(job, first)], limit)

    # the coder's model is primed once, before several batches ask for it
    grid, grid_walks = learned
    prior = Prior(grid_walks)
    prior.model(0)
    return BaseMap(grid, prior, job.gap, target, share=1 / max(len(job.batches), 1))


def _gaps_of(job: Job, track: Track) -> NDArray[np.bool_]:
    from gpszip.geo.gaps import find_gaps

    return find_gaps(track, job.gap)


def _thin_out(job: Job, target: Options) -> tuple[Sequence[Track], Sequence[NDArray[np.bool_]]]:
    """The coreset that was asked for, or weighted samples of a log denser than its bound needs."""
    from gpszip.sketches.partition import build_coreset

    if target.coreset is not None:
        return reduce_to_coreset(job.sample, job.gaps, target.coreset)
    blocks = sum(map(len, job.sample)) // _DENSE_BLOCK
    bound = target.rmse
    if bound is None:
        bound = RMSE_PER_MAX_ERROR * (target.max_error or 0.0)
    if blocks < len(job.sample):
        return job.sample, job.gaps
    if build_coreset(job.sample, size=blocks).rmse > _DENSE_SHARE * bound:
        return job.sample, job.gaps
    return reduce_to_coreset(job.sample, job.gaps, blocks)


def _samples_to_learn(
    job: Job,
) -> tuple[Sequence[Track], Sequence[NDArray[np.bool_]]]:
    """All samples of a log in memory, or the weighted ones of the coreset that was asked for."""
    tracks = with_synthetic_times(_tracks(job), job.gaps)
    if job.options.coreset is None:
        return tracks, job.gaps
    return reduce_to_coreset(tracks, job.gaps, job.options.coreset)


def _with_max_error(job: Job, learned: Learned, max_error: float) -> Learned | None:
    """Insert knots until the samples that a coreset lacks hold the maximum, too."""
    tracks = with_synthetic_times(_tracks(job), job.gaps)
    result = enforce_max_error(tracks, learned.grid, learned.grid_walks, max_error)
    return None if result is None else replace(learned, grid=result[0], grid_walks=result[1])


def _tracks(job: Job) -> tuple[Track, ...]:
    assert isinstance(job.log, MemoryLog)
    return job.log.tracks
