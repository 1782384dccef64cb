"""Learning map and walks of a log on disk: a map of a subsample, then batch after batch on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.codec.numbering import number_by_visit
from gpszip.codec.prior import Prior
from gpszip.errors import BoundError
from gpszip.geo.gaps import find_gaps
from gpszip.mapping.on_known_map import needed_refinements
from gpszip.mapping.search import RMSE_PER_MAX_ERROR, learn_map
from gpszip.mapping.thinning import reduce_to_coreset
from gpszip.mapping.verbatim import keep_samples
from gpszip.model import Options, Track
from gpszip.model.grid import refined_grid
from gpszip.pipeline.encode_batches import BaseMap, encode_batches
from gpszip.pipeline.job import Job
from gpszip.pipeline.learned import Learned
from gpszip.pipeline.time_step import with_best_time_step
from gpszip.sketches.partition import build_coreset

__all__ = ["learn_in_batches"]

#: Shares of the bound for which the map of a subsample is learned, until one is found. Walks on
#: nodes that stay need some slack; on a map without any, some batches can't hold the bound.
_SUBSAMPLE_SHARES = (0.95, 0.85, 0.75)

#: Samples that are a map by themselves where none can be learned from a subsample.
_VERBATIM_SAMPLES = 1000

#: A log is dense if blocks of so many samples, on average, lie close to a line...
_DENSE_BLOCK = 40

#: ...with an RMSE of at most this share of the bound.
_DENSE_SHARE = 0.8


def learn_in_batches(job: Job, target: Options) -> Learned | None:
    """Learn a map from a subsample, and encode all batches on it."""

    def report(done: float) -> None:
        job.report("encode", done)

    batches = job.batches
    for base in _base_maps(job, target):
        report(0.0)
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
    """The walks of a known map."""
    refinements = needed_refinements(map.grid, target.rmse, target.max_error)
    grid = refined_grid(map.grid, refinements)
    share = 1 / max(len(job.batches), 1)
    prior, times = map.prior(refinements), job.shape_times
    return BaseMap(grid, prior, job.gap, target, refinements, share, times)


def _learned_base(job: Job, target: Options) -> BaseMap:
    """A map that is learned from a subsample."""

    # Report learning of the base map as a share of its steps.
    def report(done: int, steps: int) -> None:
        job.report("learn", done / steps)

    # Few weighted samples of the subsample, where they do.
    job.report("learn", 0.0)
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

    # Else the first samples as they are.
    if learned is None:
        track = job.log.tracks[0]
        first = job.log.read(track, 0, min(_VERBATIM_SAMPLES, len(track)))
        limit = target.max_error or target.rmse or 0.0
        gaps = [find_gaps(first, job.gap)]
        learned = keep_samples([job.shape_times.assign_to(first)], gaps, limit)

    # The coder's model is primed once, before several batches ask for it.
    grid, grid_walks = learned
    prior = Prior(grid_walks)
    prior.model(0)
    share = 1 / max(len(job.batches), 1)
    return BaseMap(grid, prior, job.gap, target, share=share, shape_times=job.shape_times)


def _thin_out(job: Job, target: Options) -> tuple[Sequence[Track], Sequence[NDArray[np.bool_]]]:
    """The coreset that was asked for, or weighted samples of a log denser than its bound needs."""
    sample = [job.shape_times.assign_to(track) for track in job.sample]
    if target.coreset is not None:
        return reduce_to_coreset(sample, job.gaps, target.coreset)
    blocks = sum(map(len, sample)) // _DENSE_BLOCK
    bound = target.rmse
    if bound is None:
        bound = RMSE_PER_MAX_ERROR * (target.max_error or 0.0)
    if blocks < len(sample):
        return sample, job.gaps
    if build_coreset(sample, size=blocks).rmse > _DENSE_SHARE * bound:
        return sample, job.gaps
    return reduce_to_coreset(sample, job.gaps, blocks)
