"""A log made ready for compression: its gaps, its bound, and what a map is learned from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.container.contents import Section
from gpszip.geo.gaps import estimate_gap, find_gaps, find_gaps_of_all, piece_time_ranges
from gpszip.geo.sampling import sampling_interval
from gpszip.geo.steps import group_medians, steps_between
from gpszip.model import Listener, Options, Progress, Track
from gpszip.model.log import Log, LogTrack, MemoryLog
from gpszip.pipeline.bounds import size_in_bytes, with_bound
from gpszip.pipeline.kept_columns import kept_sections
from gpszip.pipeline.kept_curves import curve_sections
from gpszip.pipeline.memory import batch_samples, subsample_size, workers_within
from gpszip.pipeline.slices import Slice, batch_slices, slice_tracks
from gpszip.pipeline.validate import check_thesis_in_memory
from gpszip.run import resolve_executor
from gpszip.run.executor import Executor
from gpszip.walks.shapes import SyntheticTimes, synthetic_times

__all__ = ["Job", "batches_of", "choose_slices", "on_tracks", "prepare"]

#: Samples of a track that are read at once to find its gaps: 16 MiB for two coordinates.
_BLOCK_SAMPLES = 1 << 20

#: Fewest samples of a slice of the subsample; shorter ones repeat too little of the map.
_MIN_SLICE = 1000

#: A subsample has at least four slices, so that it shows more than one place and time.
_MIN_SLICES = 4


@dataclass(frozen=True, eq=False)
class Job:
    """A log and how it is to be compressed.

    Parameters
    ----------
    log : Log
        In memory or on disk.
    sample : tuple of Track
        What a map is learned from: the tracks of a log in memory, slices of one on disk.
    gaps : tuple of bool array
        For each track of the sample, the intervals that are gaps.
    gap : float
        Seconds above which an interval is a gap; may be infinite.
    sampling : float or None
        Typical interval between two samples in seconds; None without times.
    options : Options
        With a bound, unless a size, k or m stands for it.
    notes : tuple of str
        What the user should know so far.
    executor : Executor
        Where the work runs.
    listener : callable, optional
        Called with progress events.
    map : Archive, optional
        Known map, on which the tracks become walks.
    batch : int, optional
        Samples that are encoded at once; None where the log is in memory and encoded as a whole.
    extras : tuple of Section
        Sections of the archive besides its walks.
    """

    log: Log
    sample: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    gap: float
    sampling: float | None
    options: Options
    notes: tuple[str, ...]
    executor: Executor
    listener: Listener | None
    map: Archive | None = None
    batch: int | None = None
    extras: tuple[Section, ...] = ()

    @property
    def ids(self) -> list[str]:
        """Names of the tracks."""
        return [track.id for track in self.log.tracks]

    @property
    def untimed(self) -> frozenset[int]:
        """Numbers of the tracks without times."""
        tracks = enumerate(self.log.tracks)
        return frozenset(number for number, track in tracks if not track.timed)

    @property
    def aim(self) -> Options:
        """Options with a slightly smaller bound, so that files written from the archive hold it."""
        return self.options.aim(geographic=self.log.plane is not None)

    @property
    def step(self) -> float:
        """Seconds between two samples of the most densely sampled track; 0 without any."""
        times = [track.times for track in self.sample if track.timed and len(track) > 1]
        if not times:
            return 0.0
        counts = [len(of_track) - 1 for of_track in times]
        return float(group_medians(steps_between(times), counts).min())

    @cached_property
    def shape_times(self) -> SyntheticTimes:
        """The times with which tracks without any are learned."""
        return synthetic_times(self.sample, self.gaps)

    @cached_property
    def time_ranges(self) -> list[NDArray[np.float64]]:
        """For each track, the times of the first and last sample of each piece, in seconds."""
        if isinstance(self.log, MemoryLog):
            return [
                piece_time_ranges(track.times, gaps) if track.timed else np.zeros((0, 2))
                for track, gaps in zip(self.log.tracks, self.gaps, strict=True)
            ]
        return [_time_ranges(self.log, track, self.gap) for track in self.log.tracks]

    @property
    def batches(self) -> list[list[Slice]]:
        """All samples in batches; a single one for a log in memory."""
        return batches_of(self.log, self.batch)

    def report(self, stage: str, done: float) -> None:
        """Tell the listener which share of a stage is done."""
        if self.listener is not None:
            # A map is learned from the sample; all other stages work on all of the log.
            tracks = self.sample if stage == "learn" else self.log.tracks
            self.listener(Progress(stage, done, sum(len(track) for track in tracks)))


def prepare(
    log: Log,
    options: Options,
    *,
    memory: int | None = None,
    map: Archive | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
    exact: bool = False,
) -> Job:
    """Find gaps, sampling and bound of a log, and choose what a map is learned from.

    Parameters
    ----------
    log : Log
        In memory or on disk; its tracks are on the plane of the map.
    options : Options
        What the user asked for.
    memory : int, optional
        Bytes that the process may take; needed for a log on disk.
    map : Archive, optional
        Known map.
    executor, progress : optional
        As for :func:`gpszip.pipeline.compress.compress`.
    exact : bool, default False
        Whether the log is kept exactly, too.

    Raises
    ------
    OptionError
        If the log is on disk and k or m is given.
    """
    # Tell a log in memory from one on disk, which needs a subsample and batches.
    in_memory = isinstance(log, MemoryLog)
    check_thesis_in_memory(thesis=options.thesis, in_memory=in_memory)

    # What a map is learned from.
    sample = log.tracks if in_memory else _subsample(log, subsample_size(memory))
    timed = [track for track in sample if track.timed]

    # Gaps: intervals in which nothing is known of the path.
    gap = estimate_gap(timed) if options.gap is None else options.gap
    gaps = tuple(find_gaps_of_all(sample, gap))
    timed_gaps = [gap for track, gap in zip(sample, gaps, strict=True) if track.timed]
    sampling = sampling_interval(timed, timed_gaps) if timed else None

    # The bound, and the columns.
    curves, curve_notes = curve_sections(log, options, memory)
    options = size_in_bytes(options, _bytes_of(log))
    source = "the log" if in_memory else "a subsample"
    options, notes = with_bound(options, sample, gaps, source, exact=exact)

    # Batches and workers that fit the memory.
    batch = None if in_memory else batch_samples(memory)
    workers = (
        resolve_executor(executor) if batch is None else workers_within(memory, batch, executor)
    )
    return Job(
        log=log,
        sample=tuple(sample),
        gaps=gaps,
        gap=gap,
        sampling=sampling,
        options=options,
        notes=notes + curve_notes,
        executor=workers,
        listener=progress,
        map=map,
        batch=batch,
        extras=(*kept_sections(log, options), *curves),
    )


def on_tracks(job: Job, tracks: tuple[Track, ...]) -> Job:
    """Return the job for other tracks in memory, with the same gap."""
    gaps = tuple(find_gaps_of_all(tracks, job.gap))
    return replace(job, log=MemoryLog(tracks), sample=tracks, gaps=gaps)


def batches_of(log: Log, batch: int | None) -> list[list[Slice]]:
    """Slices of all tracks, gathered in batches of about ``batch`` samples."""
    counts = [len(track) for track in log.tracks]
    if batch is None:
        return [[Slice(number, 0, 0, count, count) for number, count in enumerate(counts)]]
    return batch_slices(slice_tracks(counts, batch), batch)


def choose_slices(log: Log, samples: int) -> list[Slice]:
    """Slices evenly spread over the log, and the earliest one, of about so many samples in all."""
    # Cut slices long enough to repeat the map, four or more to a subsample.
    length = max(min(batch_samples(None), samples // _MIN_SLICES), _MIN_SLICE)
    slices = slice_tracks([len(track) for track in log.tracks], length)
    total = sum(each.end - each.begin for each in slices)

    # The earliest slice sets the epoch of the grid; shapes start with it.
    starts = [log.read(track, 0, 1).times[0] if track.timed else math.inf for track in log.tracks]
    earliest = min(range(len(starts)), key=starts.__getitem__)
    first = next(each for each in slices if each.track == earliest)

    # Take a slice wherever the samples taken fall behind their share of the samples passed.
    chosen: list[Slice] = []
    passed, taken = 0, 0
    for each in slices:
        count = each.end - each.begin
        passed += count
        if each is first or taken + count / 2 <= min(samples / total, 1.0) * passed:
            chosen.append(each)
            taken += count
    return chosen


def _subsample(log: Log, samples: int) -> tuple[Track, ...]:
    """Read the slices of :func:`choose_slices` as tracks of their own."""
    return tuple(
        replace(log.read(log.tracks[each.track], each.begin, each.end), id=each.name)
        for each in choose_slices(log, samples)
    )


def _time_ranges(log: Log, track: LogTrack, gap: float) -> NDArray[np.float64]:
    """Times of the first and last sample of each piece of a track, read block by block."""
    if not track.timed:
        return np.zeros((0, 2))
    ranges: list[NDArray[np.float64]] = []
    for first in range(0, len(track), _BLOCK_SAMPLES):
        # The last sample before the block tells whether a gap lies between the two blocks.
        block = log.read(track, max(first - 1, 0), min(first + _BLOCK_SAMPLES, len(track)))
        in_block = piece_time_ranges(block.times, find_gaps(block, gap))
        if ranges:
            ranges[-1][-1, 1] = in_block[0, 1]
            in_block = in_block[1:]
        if len(in_block):
            ranges.append(in_block)
    return np.concatenate(ranges)


def _bytes_of(log: Log) -> int:
    """Size of the files read, else of times and coordinates as float64."""
    if log.read_result is not None:
        return log.read_result.bytes
    return sum(8 * (1 + log.dimension) * len(track) for track in log.tracks)
