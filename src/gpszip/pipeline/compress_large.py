"""Logs larger than memory: a map is learnt from an excerpt, then batch after batch of all samples becomes walks on it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, with_error_bound, with_sampling, with_sections
from gpszip.codec.prior import Prior
from gpszip.codec.walks import number_by_visit
from gpszip.container.contents import Section
from gpszip.errors import BoundError, OptionError
from gpszip.geo.gaps import estimate_gap, find_gaps, piece_time_ranges
from gpszip.geo.sampling import sampling_interval
from gpszip.io.large.store import StoredLog, StoredTrack, count_rows, store_logs
from gpszip.mapping.search import RMSE_PER_MAX_ERROR
from gpszip.model import GridWalks, Listener, Options, Progress, ReadResult, Report, Track
from gpszip.model.grid import refined_grid
from gpszip.pipeline.compress import (
    NO_TIMES,
    estimated,
    holds,
    in_bytes,
    off_map,
    promised,
    report_on,
    without_times,
)
from gpszip.pipeline.encode_batches import SHARES, Ground, Samples, lay
from gpszip.pipeline.kept_columns import kept_of
from gpszip.pipeline.measure import measured
from gpszip.pipeline.slices import Stretch, cut_stretches, gather
from gpszip.pipeline.time_step import coarsened
from gpszip.pipeline.validate import check_map
from gpszip.run.executor import Executor, local_executor
from gpszip.run.threads import Threads
from gpszip.walks.error import ErrorSummary

__all__ = ["Job", "check_memory", "compress_large", "fits", "ground_on", "stored"]

#: Bytes that one sample takes at most while a whole log is compressed in memory, and those that the program takes by itself.
_IN_MEMORY, _PROGRAM = 700, 300 << 20

#: Bytes for a row that is being sorted, for each of its further columns, for a sample of the excerpt, and for one of a batch.
_SORTED, _SORTED_COLUMN, _LEARNT, _LAID = 150, 120, 700, 1200

#: Samples of a batch, of which several are in work at once, and of an excerpt at most.
_BATCH, _AT_ONCE, _EXCERPT = 100_000, 4, 2_000_000

#: Samples of a track that are read at a time to find its gaps.
_BLOCK = 1 << 20

#: A log is dense if blocks of so many samples, on average, have lines whose RMSE is at most this share of the bound.
_DENSE, _LINES = 40, 0.8

#: Shares of the bound for which a map is learnt, until one is found; else so many samples are the map as they are. Walks on a map
#: whose nodes stay need some room for error; on one that was learnt without any, some batches can't hold the bound.
_EXCERPT_SHARES, _VERBATIM = (0.95, 0.85, 0.75), 1000


@dataclass(frozen=True, eq=False)
class Job:
    """A log in a temporary file, what an excerpt tells of it, and how it is to be compressed."""

    log: StoredLog
    excerpt: Sequence[Track]
    gap: float
    sampling: float | None
    options: Options
    notes: tuple[str, ...]
    batch: int
    executor: Executor
    tell: Listener
    map: Archive | None = None

    @property
    def share(self) -> float:
        """Share of a batch in the log."""
        return 1 / max(len(self._batches(self.log)), 1)

    @property
    def aim(self) -> Options:
        """The options with the bound that the archive is to hold, a little below the one that was asked for."""
        return self.options.aim(geographic=self.log.plane is not None)

    @cached_property
    def spans(self) -> list[NDArray[np.float64]]:
        """Times of first and last sample of each run between gaps, for each track."""
        return [_spans(self.log, track, self.gap) for track in self.log.tracks]

    @cached_property
    def step(self) -> float:
        """Seconds between two samples of the part of the excerpt that has the most; 0 where none has two."""
        return min(
            (float(np.median(np.diff(track.times))) for track in self.excerpt if len(track) > 1),
            default=0.0,
        )

    def lay(self, log: Samples, ground: Ground) -> GridWalks:
        """Walks of all tracks, over the nodes that are known and then others."""
        return lay(
            log,
            ground,
            self._batches(log),
            self.executor,
            lambda done: self.tell(Progress("encode", done)),
        )

    def coarsened(self, ground: Ground) -> Ground:
        """The ground with the lattice of times that suits the whole log."""
        return coarsened(self.log, ground, self._batches(self.log), self.executor)

    def measure(self, archive: Archive) -> ErrorSummary:
        """Error of an archive at all samples."""
        return measured(
            self.log,
            archive,
            self._batches(self.log),
            self.executor,
            lambda done: self.tell(Progress("measure", done)),
        )

    def _batches(self, log: Samples) -> list[list[Stretch]]:
        return gather(cut_stretches([track.count for track in log.tracks], self.batch), self.batch)


def _spans(log: StoredLog, track: StoredTrack, gap: float) -> NDArray[np.float64]:
    """Times of first and last sample of each run of a track, read block by block."""
    runs: list[NDArray[np.float64]] = []
    for first in range(0, track.count, _BLOCK):
        # the last sample of the block before tells whether the step between the blocks is a gap
        block = log.read(track, max(first - 1, 0), min(first + _BLOCK, track.count))
        own = piece_time_ranges(block.times, find_gaps(block, gap))
        if runs:
            runs[-1][-1, 1] = own[0, 1]
            own = own[1:]
        runs.append(own)
    return np.concatenate([run for run in runs if len(run)])


def fits(sources: Any, memory: int, *, format: str | None = None, columns: Any = None) -> bool:
    """Whether logs can be compressed as a whole within so many bytes of memory."""
    return _PROGRAM + _IN_MEMORY * count_rows(sources, format=format, columns=columns) <= memory


def compress_large(
    sources: Any,
    options: Options,
    *,
    memory: int,
    map: Archive | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
    **reading: Any,
) -> tuple[Archive, Report, ReadResult]:
    """Compress logs of any size in bounded memory.

    The first pass sorts all samples by track and time into a temporary file. From an excerpt of whole stretches, evenly
    spread over the log, frame and map are learnt as usual. The second pass lays batches of tracks, long ones cut in stretches,
    as walks on that map, each by itself, so that the result does not depend on the executor. A last pass measures what the
    archive's bytes decode to at every sample.

    Parameters
    ----------
    sources : path, str or sequence of them
        CSV or Parquet of any size, folders of Parquet; other formats file by file.
    options : Options
        k and m are refused: their segments are sought for a whole track at once. For a size, batches are laid several times.
    memory : int
        Bytes that the process should take at most, at least 400 MiB; other processes that work for it take no more each.
    map : Archive, optional
        A map that is there already, on which batches are laid instead of one that is learnt from an excerpt.
    executor : Executor, optional
        Where batches are worked on; the log stays with the process that asks. Of threads, as many work as there is memory for.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.
    **reading
        What :func:`gpszip.io.large.store.store_logs` takes.

    Returns
    -------
    Archive, Report, Reading
        The reading is without its tracks.

    Raises
    ------
    OptionError
        If an option needs the whole log at once, or memory is too small.
    BoundError
        If the bound can't be held.
    """
    start = time.perf_counter()
    check_memory(memory)
    _check(options)
    with stored(
        sources, options, memory, map, executor, progress or (lambda _event: None), **reading
    ) as job:
        kept = kept_of(job.log, options)
        archive, found = (
            _within_bound(job, kept)
            if job.options.size is None
            else _within_size(job, kept, job.options.size)
        )
        notes = (*job.notes, *off_map(archive, map), *(() if options.times else (NO_TIMES,)))
        return (
            archive,
            report_on(archive, found, job.options, notes, job.gap, time.perf_counter() - start),
            job.log.read_result,
        )


@contextmanager
def stored(
    sources: Any,
    options: Options,
    memory: int,
    map: Archive | None,
    executor: Executor | None,
    tell: Listener,
    **reading: Any,
) -> Iterator[Job]:
    """Sort a log into a temporary file, on the plane of a map if there is one, and see what kind of log it is."""
    room = memory - _PROGRAM
    rows = room // (_SORTED + _SORTED_COLUMN * len(options.keep))
    tell(Progress("read", 0.0))
    with store_logs(
        sources,
        rows=rows,
        keep=options.keep,
        plane=None if map is None else map.grid.plane,
        **reading,
    ) as log:
        tell(Progress("read", 1.0))
        if map is not None:
            check_map(map, log.dimension, log.plane, options)
        excerpt = _excerpt(log, min(room // _LEARNT, _EXCERPT))
        gap = estimate_gap(excerpt) if options.gap is None else options.gap
        sampling = sampling_interval(excerpt, [find_gaps(track, gap) for track in excerpt])
        options, notes = _bounded(excerpt, gap, in_bytes(options, log.read_result.bytes))
        batch = max(min(_BATCH, room // (_LAID * _AT_ONCE)), 5000)
        workers = executor or Threads()
        if isinstance(workers, Threads):
            workers = Threads(max(min(workers.workers, room // (_LAID * batch)), 1))
        yield Job(log, excerpt, gap, sampling, options, notes, batch, workers, tell, map)


def _within_size(job: Job, kept: Sequence[Section], size: int) -> tuple[Archive, ErrorSummary]:
    """Look for the smallest RMSE whose archive takes at most so many bytes; the log stays sorted between one try and the next."""
    from gpszip.mapping.noise import extent_rmse, suggest_rmse
    from gpszip.pipeline.size_search import Try, smallest_error

    beside = sum(len(section.body) for section in kept)
    if size <= beside:
        raise BoundError(
            f"{size:,} bytes are too few for this log: the columns kept alone take {beside:,}; allow more, or keep less"
        )

    def attempt(rmse: float, effort: int) -> Try[tuple[Archive, ErrorSummary]] | None:
        aim = replace(job, options=replace(job.options, size=None, rmse=rmse, effort=effort))
        try:
            archive, found = _within_bound(aim, kept)
        except BoundError:
            return None
        return Try(archive.size - beside, found.rmse, (archive, found))

    first = suggest_rmse(job.excerpt, [find_gaps(track, job.gap) for track in job.excerpt])
    best, smallest = smallest_error(
        attempt,
        size - beside,
        first=first,
        coarsest=2 * extent_rmse(job.excerpt),
        effort=job.options.effort,
    )
    if best is None:
        raise BoundError(
            f"{size:,} bytes are too few for this log: the smallest archive takes {smallest + beside:,}; allow as many"
        )
    return best.made


def _within_bound(job: Job, kept: Sequence[Section]) -> tuple[Archive, ErrorSummary]:
    """Lay, write and measure, until the bound is held."""
    failure = BoundError(
        "the bound can't be held batch by batch; allow a larger error, or more memory"
    )
    for ground in _grounds(job):
        try:
            archive, found = _laid(job, ground)
        except BoundError as error:
            failure = error
            if job.map is not None:
                break
            continue
        if holds(found, job.aim):
            return _finished(job, archive, found, kept), found
    if job.map is not None:
        return _within_bound(replace(job, map=None), kept)
    raise failure


def _grounds(job: Job) -> Iterator[Ground]:
    """What batches may be laid on: ever finer, until they hold the bound."""
    for share in SHARES:
        target = job.aim.tightened(share)
        if job.map is not None:
            yield ground_on(job.map, job, target)
            continue
        learned = _learned(job, target)
        yield (coarse := job.coarsened(learned))
        if coarse is not learned:
            yield learned


def _finished(job: Job, archive: Archive, found: ErrorSummary, kept: Sequence[Section]) -> Archive:
    """The archive with what belongs into it besides walks, or without times."""
    if not job.options.times:
        return without_times(archive)
    return with_sampling(
        with_error_bound(with_sections(archive, kept), promised(job.options, found)), job.sampling
    )


def ground_on(map: Archive, job: Job, options: Options) -> Ground:
    """The walks of a map, on which a log is laid."""
    from gpszip.mapping.on_known_map import needed_refinements

    times = needed_refinements(map.grid, options.rmse, options.max_error)
    return Ground(
        refined_grid(map.grid, times), map.prior(times), job.gap, options, times, job.share
    )


def _check(options: Options) -> None:
    if options.thesis:
        raise OptionError(
            "k and m segment a track that is in memory as a whole, and the logs are larger than the memory given; "
            "allow more with --memory, leave it out, or give --rmse instead of k and m"
        )


def check_memory(memory: int) -> None:
    """Refuse to work in next to nothing."""
    if memory < _PROGRAM + (100 << 20):
        raise OptionError(
            f"{memory / 2**20:.0f} MiB are too little memory to work in; give at least {(_PROGRAM >> 20) + 100} MiB"
        )


def _excerpt(log: StoredLog, samples: int) -> list[Track]:
    """Stretches evenly spread over the log, and the one that begins first, of about so many samples in all."""
    stretches = cut_stretches(
        [track.count for track in log.tracks], max(min(_BATCH, samples // 4), 1000)
    )
    earliest = min(range(len(log.tracks)), key=lambda i: log.read(log.tracks[i], 0, 1).times[0])
    first = next(one for one in stretches if one.track == earliest)
    total = sum(one.end - one.begin for one in stretches)
    chosen, reached, taken = [], 0, 0
    for one in stretches:
        reached += one.end - one.begin
        # as much of the samples so far as the budget is of all samples
        if one is first or taken + (one.end - one.begin) / 2 <= min(samples / total, 1.0) * reached:
            chosen.append(one)
            taken += one.end - one.begin
    return [
        replace(log.read(log.tracks[one.track], one.begin, one.end), id=f"{one.track}/{one.begin}")
        for one in chosen
    ]


def _bounded(
    excerpt: Sequence[Track], gap: float, options: Options
) -> tuple[Options, tuple[str, ...]]:
    from gpszip.mapping.noise import suggest_rmse

    if options.bounded or options.sized:
        return options, ()
    return estimated(
        options, suggest_rmse(excerpt, [find_gaps(track, gap) for track in excerpt]), "an excerpt"
    )


def _learned(job: Job, options: Options) -> Ground:
    """A map of the excerpt."""
    from gpszip.mapping.search import learn_map
    from gpszip.mapping.verbatim import keep_samples

    gaps = [find_gaps(track, job.gap) for track in job.excerpt]
    few, few_gaps = _thinned(job.excerpt, gaps, options)
    found = None
    for share in _EXCERPT_SHARES:
        aim = options.tightened(share)
        found = found or learn_map(
            few, few_gaps, rmse=aim.rmse, max_error=aim.max_error, effort=aim.effort, executor=job.executor,
            progress=lambda done, whole: job.tell(Progress("learn", done / whole)),
        )  # fmt: skip
    if found is None:
        start = job.log.read(job.log.tracks[0], 0, min(_VERBATIM, job.log.tracks[0].count))
        found = keep_samples(
            [start], [find_gaps(start, job.gap)], options.max_error or options.rmse or 0.0
        )
    known = Prior(found[1])
    known.model(0)  # learnt once, before several batches ask for it
    return Ground(found[0], known, job.gap, options, share=job.share)


def _thinned(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], options: Options
) -> tuple[Sequence[Track], Sequence[NDArray[np.bool_]]]:
    """The coreset that was asked for, or few weighted samples of a log that is sampled far more densely than its error asks for."""
    from gpszip.mapping.thinning import reduce_to_coreset
    from gpszip.sketches.partition import build_coreset

    if options.coreset is not None:
        return reduce_to_coreset(tracks, gaps, options.coreset)
    size = sum(map(len, tracks)) // _DENSE
    bound = (
        options.rmse
        if options.rmse is not None
        else RMSE_PER_MAX_ERROR * (options.max_error or 0.0)
    )
    if size < len(tracks) or build_coreset(tracks, size=size).rmse > _LINES * bound:
        return tracks, gaps
    return reduce_to_coreset(tracks, gaps, size)


def _laid(job: Job, ground: Ground) -> tuple[Archive, ErrorSummary]:
    """Lay all batches, write the archive and measure it."""
    grid_walks = job.lay(job.log, ground)
    if job.map is None:
        grid_walks = number_by_visit(grid_walks)
    archive = new_archive(
        ground.grid, [track.id for track in job.log.tracks], grid_walks, layer=job.options.layer, known_map=job.map, refinements=ground.refinements,
        executor=local_executor(job.executor), spans=job.spans, step=job.step,
    )  # fmt: skip
    return archive, job.measure(archive)
