"""Estimate the archive of a log and the CPU time that it takes, from parts of the log.

Two samples of the log, one twice as large as the other, are compressed as the log would be. Bytes
and CPU seconds are extrapolated by the line through the two: a map takes bytes once, and each point
of a walk on it takes its share.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from gpszip.archive import Archive, with_sections
from gpszip.kernels.compiling import on_compile
from gpszip.model import Options, Track
from gpszip.model.log import Log
from gpszip.pipeline.append import append, completed_options
from gpszip.pipeline.bounds import describe_bound
from gpszip.pipeline.compress import compress
from gpszip.pipeline.job import Job, choose_slices, prepare
from gpszip.pipeline.kept_columns import extended_sections
from gpszip.pipeline.kept_curves import extended_curves
from gpszip.pipeline.validate import as_log, on_plane_of
from gpszip.run import Threads

__all__ = ["Estimate", "estimate", "extrapolate"]

#: Samples of the larger part, as a share of the log: the estimate takes less than the archive.
_SHARE = 0.25

#: Samples of the larger part at least: below, maps that repeat are hardly shared yet. With 4,000,
#: patrols of 12,000 points were estimated at 2.5 times their size; with 10,000, those of 24,000 to
#: 60,000 points at 1.2 to 1.6 times.
_MIN_SAMPLES = 10_000

#: Samples of the larger part at most: these take 1 to 20 s of CPU.
_MAX_SAMPLES = 16_000

#: Logs up to this many samples are compressed as a whole: two parts of them would take as long. Of
#: a robot's 9,693 points, parts took 3.3 s of CPU, and all of them 2.9 s.
_MAX_WHOLE = 20_000

#: Samples of a first part, which loads the kernels and is not counted.
_WARM_SAMPLES = 200


@dataclass(frozen=True)
class Estimate:
    """What an archive would take, estimated from parts of its log.

    Parameters
    ----------
    points : int
        Samples of the log.
    sampled : int
        Samples of the larger part that was compressed: all of them for a small log, 0 if none was.
    bound : str
        The bound that the archive would hold, such as ``"RMSE <= 5 m"``; empty if there is none.
    gap : float
        Intervals longer than this, in seconds, are gaps; infinite if there are none.
    bytes : int or None
        Size of the archive; None if it is not estimated.
    cpu_seconds : float or None
        CPU time to load kernels, learn, encode and measure; None if it is not estimated.
    notes : tuple of str
        What the user should know, one sentence each.
    """

    points: int
    sampled: int
    bound: str
    gap: float
    bytes: int | None
    cpu_seconds: float | None
    notes: tuple[str, ...] = ()

    @property
    def is_exact(self) -> bool:
        """Whether all of the log was compressed, so that its size is known."""
        return self.sampled == self.points


def estimate(
    log: Log,
    options: Options | None = None,
    *,
    memory: int | None = None,
    map: Archive | None = None,
    extended: Archive | None = None,
    exact: bool = False,
) -> Estimate:
    """Estimate the size of an archive, and the CPU time that it takes to make.

    1. Find gaps and the bound, as :func:`gpszip.pipeline.compress.compress` does.
    2. Compress a sample of the log, slices or tracks evenly spread over it, and one of half as many
       points.
    3. Extrapolate bytes and CPU seconds to all of the log, see :func:`extrapolate`.

    A log of up to 20,000 samples is compressed as a whole. If a size is asked for, it is the
    estimate, and no CPU time is estimated, because the number of tries is unknown. The thesis's
    model (k or m) is not estimated: its time and size depend on k and m, not on the log alone.

    Parameters
    ----------
    log : Log
        In memory or on disk.
    options : Options, optional
        As for :func:`gpszip.pipeline.compress.compress`.
    memory : int, optional
        Bytes that the process may take; needed for a log on disk.
    map : Archive, optional
        Known map.
    extended : Archive, optional
        Archive to which the log would be appended; its bytes count, too.
    exact : bool, default False
        Whether the log would be kept exactly, too; these bytes don't count, but the bound differs.

    Raises
    ------
    InputError
        If a number is too far from zero.
    OptionError
        If log and options don't go together.
    BoundError
        If the bound can't be held on the sample.

    Examples
    --------
    >>> from gpszip.model.log import MemoryLog
    >>> lane = Track("lane", range(100), [[float(t)] for t in range(100)])
    >>> found = estimate(MemoryLog((lane,)), Options(max_error=0.1))
    >>> found.is_exact, found.sampled, found.bound
    (True, 100, 'maximum <= 0.1 m')
    """
    # The bound, the gaps and the kept columns are those of the whole log.
    start = time.process_time()
    job = _prepare(as_log(log), options or Options(), memory, map, extended, exact=exact)
    preparing = time.process_time() - start

    # Without a bound on the error there is nothing to compress a part for.
    found = Estimate(
        points=sum(len(track) for track in log.tracks),
        sampled=0,
        bound=describe_bound(job.options),
        gap=job.gap,
        bytes=job.options.size,
        cpu_seconds=None,
        notes=job.notes,
    )
    if job.options.size is not None or job.options.thesis:
        return found

    # Compress two parts, or all of a small log.
    attempt = _Attempt(job, map, extended, found.points)
    count = min(max(int(_SHARE * found.points), _MIN_SAMPLES), _MAX_SAMPLES)
    if found.points <= _MAX_WHOLE:
        parts = [attempt.compress(found.points)]
        starting = 0.0
    else:
        starting = attempt.measure_start()
        parts = [attempt.compress(count // 2), attempt.compress(count)]

    # Extrapolate what the walks and the map take; kept columns and an older archive stay as long.
    counts = [part.samples for part in parts]
    size = extrapolate(counts, [part.bytes for part in parts], found.points)
    seconds = extrapolate(counts, [part.seconds for part in parts], found.points)
    return replace(
        found,
        sampled=counts[-1],
        bytes=round(size) + parts[-1].fixed_bytes,
        cpu_seconds=preparing + starting + seconds,
    )


def extrapolate(counts: Sequence[int], values: Sequence[float], whole: int) -> float:
    """Extrapolate by the line through the last two points.

    The value at ``n`` is ``v + s (n - c)`` for the last count ``c`` and value ``v``. The slope
    ``s`` is that of the last two points, within 0 and ``v / c``: maps are shared, so that archives
    grow no faster than their logs.

    Parameters
    ----------
    counts, values : sequences of numbers
        One point, which stands for all of the log, or two.
    whole : int
        Count to which the values are extrapolated.

    Examples
    --------
    >>> extrapolate([100, 200], [10.0, 20.0], 1000), extrapolate([100, 200], [10.0, 15.0], 1000)
    (100.0, 55.0)
    >>> extrapolate([100, 200], [10.0, 9.0], 1000), extrapolate([100], [10.0], 100)
    (9.0, 10.0)
    """
    # Two parts may have the same samples, those of few long slices: then growth is even.
    slope = values[-1] / counts[-1]
    if len(counts) > 1 and counts[-1] > counts[-2]:
        growth = (values[-1] - values[-2]) / (counts[-1] - counts[-2])
        slope = min(max(growth, 0.0), slope)
    return float(values[-1] + slope * (whole - counts[-1]))


def _prepare(
    log: Log,
    options: Options,
    memory: int | None,
    map: Archive | None,
    extended: Archive | None,
    *,
    exact: bool,
) -> Job:
    """Find bound, gaps and kept columns of a log, as compressing or appending it does."""
    # On a map, and in an archive, positions are on its plane.
    base = extended or map
    if base is not None:
        log = on_plane_of(base, log, options)
    if extended is None:
        return prepare(log, options, memory=memory, map=map, executor=Threads(), exact=exact)

    # An archive to append to states a bound, and its columns grow.
    options = completed_options(options, extended)
    extras = (
        *extended_sections(extended, log, options),
        *extended_curves(extended, log, options, memory),
    )
    options = replace(options, keep=(), keep_times=False, curves=())
    job = prepare(log, options, memory=memory, executor=Threads())
    return replace(job, extras=extras)


class _Part(NamedTuple):
    """A part of a log that was compressed.

    Parameters
    ----------
    samples : int
        Its samples.
    bytes : int
        What it adds to the archive.
    fixed_bytes : int
        What does not grow with the part: the archive to append to, and all kept columns.
    seconds : float
        CPU time.
    """

    samples: int
    bytes: int
    fixed_bytes: int
    seconds: float


@dataclass(frozen=True, eq=False)
class _Attempt:
    """Compresses parts of a log as the log would be.

    Parameters
    ----------
    job : Job
        The log, with its bound and its gaps.
    map, extended : Archive, optional
        Known map, and archive to which the log would be appended.
    points : int
        Samples of the log.
    """

    job: Job
    map: Archive | None
    extended: Archive | None
    points: int

    @cached_property
    def walks(self) -> Archive | None:
        """The archive to append to, without the columns that it keeps."""
        if self.extended is None:
            return None
        return replace(self.extended, contents=replace(self.extended.contents, extras=()))

    def measure_start(self) -> float:
        """Compress a small part, and return the CPU time, most of which loads kernels.

        It is 0 if kernels had to be compiled: the next run will find them compiled.
        """
        compiled: list[None] = []
        with on_compile(lambda: compiled.append(None)):
            part = self.compress(_WARM_SAMPLES)
        return 0.0 if compiled else part.seconds

    def compress(self, count: int) -> _Part:
        """Compress about ``count`` samples."""
        # Take slices, or all tracks.
        log = self.job.log
        if count >= self.points:
            tracks = tuple(log.read(track) for track in log.tracks)
        else:
            tracks = tuple(_read_slices(log, count))
        samples = sum(map(len, tracks))

        # Use the bound and the gaps of the log, and a share of its coreset; no kept columns.
        options = self.job.options
        coreset = options.coreset
        if coreset is not None:
            coreset = max(round(coreset * samples / self.points), 1)
        options = replace(
            options,
            gap=self.job.gap,
            coreset=coreset,
            keep=(),
            keep_times=False,
            curves=(),
            heights=False,
        )

        # Compress them, or append them.
        start = time.process_time()
        if self.walks is None:
            archive, _ = compress(tracks, options, map=self.map)
            before = 0
        else:
            archive, _ = append(self.walks, tracks, options)
            before = self.walks.size
        seconds = time.process_time() - start

        # Columns are those of all of the log.
        size = archive.size
        columns = with_sections(archive, self.job.extras).size - size if self.job.extras else 0
        return _Part(samples, max(size - before, 1), before + columns, seconds)


def _read_slices(log: Log, count: int) -> Iterator[Track]:
    """Yield slices evenly spread over the log as tracks, about ``count`` samples in all."""
    # The first slice of a track has its name, because names take bytes, too.
    ids = {track.id for track in log.tracks}
    named: set[int] = set()
    for each in choose_slices(log, count):
        source = log.tracks[each.track]
        name = source.id
        if each.track in named:
            name = f"{name} from {each.begin}"
            # No track of the log has the name of a slice.
            while name in ids:
                name += "+"
        named.add(each.track)
        yield replace(log.read(source, each.begin, each.end), id=name)
