"""Appending a log to an archive: its map grows, its walks stay as they are."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import (
    Archive,
    new_archive,
    open_archive,
    with_error_bound,
    with_sampling,
    with_sections,
)
from gpszip.codec.numbering import number_by_visit
from gpszip.errors import BoundError, OptionError
from gpszip.mapping.trials import suggest_time_step
from gpszip.model import GridWalk, GridWalks, Listener, Options, Plane, Report, Track
from gpszip.model.error_bound import ErrorBound, rounded_bounds
from gpszip.model.grid import step_size
from gpszip.model.grid_walks import refined
from gpszip.model.log import Log, LogTrack, MemoryLog
from gpszip.model.read_result import ReadResult
from gpszip.pipeline.bounds import holds, requested_bound
from gpszip.pipeline.compress import off_map_notes, report_on, within_bound
from gpszip.pipeline.continue_tracks import piece_time_ranges_of, ready_to_continue, track_end
from gpszip.pipeline.exact_logs import without_guides
from gpszip.pipeline.job import Job, on_tracks, prepare
from gpszip.pipeline.kept_columns import extended_sections
from gpszip.pipeline.kept_curves import curve_notes, extended_curves
from gpszip.pipeline.measure import measure
from gpszip.pipeline.validate import as_log, on_plane_of
from gpszip.run.executor import Executor
from gpszip.walks.error import TIME_SLACK, ErrorSummary
from gpszip.walks.quantised import knot_times, merge_grid_walks, node_positions
from gpszip.walks.shapes import with_synthetic_times

__all__ = ["append", "completed_options"]

#: Shares of the bound that are tried: where a track is continued, the end of the older walk stays
#: as it is, with whatever error it has. Beside one or two new samples, the knot at that end is a
#: large part of what is learned from, and has no error: then only small shares help.
_SHARES = (1.0, 0.97, 0.9, 0.75, 0.5, 0.3)

#: How often the time step of an archive is halved at most, so that the bound can be held.
_MAX_REFINEMENTS = 4

#: Samples among which the first one after the end of a walk is looked for.
_SAMPLES_NEAR_START = 10_000


def append(
    archive: Archive,
    tracks: Sequence[Track] | Track | Log,
    options: Options | None = None,
    *,
    memory: int | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, Report]:
    """Add tracks to an archive as walks on its map, which grows where they leave it.

    The walks of the archive keep all their knots. A track whose id is in the archive continues
    the walk there.

    Parameters
    ----------
    archive : Archive
        With times and a map of its own; it is not modified.
    tracks : sequence of Track, Track or Log
        Those whose id is in the archive begin where that walk ends, or later.
    options : Options, optional
        Without a bound, the new walks hold the bound that the archive states.
    memory : int, optional
        Bytes that the process may take; needed for a log on disk.
    executor : Executor, optional
        Spreads the work.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        The old walks and the new ones.
    Report
        On the new tracks; nodes, edges and bytes are those of the archive.

    Raises
    ------
    OptionError
        If tracks and archive don't go together.
    BoundError
        If the bound can't be held on the archive's grid.

    Examples
    --------
    >>> from gpszip.pipeline.compress import compress
    >>> first = Track("a", range(9), [[float(t)] for t in range(9)])
    >>> back = Track("a", range(10, 19), [[18.0 - t] for t in range(10, 19)])
    >>> archive, _ = append(compress(first, Options(max_error=0.1))[0], back)
    >>> archive.ids, len(archive.road_map.nodes)
    (('a',), 2)
    """
    # Take the time of the whole call, for the report.
    start = time.perf_counter()

    # What the archive states and keeps goes on; walks that change must not predict its logs.
    archive = without_guides(archive)
    options = completed_options(options or Options(), archive)
    log = on_plane_of(archive, as_log(tracks), options)
    _check_times(archive, log)
    extras = (
        *extended_sections(archive, log, options),
        *extended_curves(archive, log, options, memory),
    )
    job = prepare(
        log,
        replace(options, keep=(), keep_times=False, curves=()),
        memory=memory,
        executor=executor,
        progress=progress,
    )

    # Try the archive's own time step first. Where a track ends between two of its steps, the line
    # up to the next one may be far from the new samples: then smaller steps help.
    sample = with_synthetic_times(job.sample, job.gaps)
    time_step = suggest_time_step(sample, job.gaps, archive.grid.space)
    spans = _spans(archive, log)
    tried = None
    for refinements in range(_MAX_REFINEMENTS + 1):
        ready = ready_to_continue(archive, spans, time_step, refinements)
        if tried is not None and ready.grid == tried.grid:
            break
        tried = ready
        found = _append_within(ready, job)
        if found is not None:
            on_map, extended, errors = found
            extended = with_sections(extended, extras)
            seconds = time.perf_counter() - start
            report = _report(job, ready, on_map, extended, errors, seconds)
            return extended, replace(report, notes=report.notes + curve_notes(extended, log))
    raise BoundError(
        "the archive's grid is too coarse for this bound",
        remedy="allow a larger error, or compress all logs together",
    )


def _append_within(archive: Archive, job: Job) -> tuple[Archive, Archive, ErrorSummary] | None:
    """Return new walks on the map, the longer archive and its errors; None if none is good enough.

    Targets become tighter and tighter until the whole holds the bound.
    """
    # New walks on the map of the archive.
    continued = _continued_job(archive, job)
    for share in _SHARES:
        target = replace(continued, options=job.options.tightened(share))
        try:
            on_map, _ = within_bound(target)
        except BoundError:
            return None
        if on_map.map is None:
            return None
        on_map = with_error_bound(on_map, requested_bound(job.options))

        # A new walk begins where the old one ends, or moves there first from its own first knot.
        for keep_starts in (False, True):
            extended = _extend(archive, on_map, job, keep_starts=keep_starts)
            errors = _measure(job, extended)
            if holds(errors, job.aim):
                return on_map, extended, errors
    return None


def completed_options(options: Options, archive: Archive) -> Options:
    """Add the bound that the archive states and the columns that it keeps."""
    # Refuse a size: walks are appended for an error bound alone.
    if options.sized:
        raise OptionError(
            "a size can't be asked of what is appended", remedy="give rmse or max_error"
        )

    # The bound.
    bound = archive.error_bound
    if not options.bounded and bound is not None:
        if bound.maximum:
            options = replace(options, max_error=bound.metres)
        else:
            options = replace(options, rmse=bound.metres, max_error=bound.max_error)

    # The columns within an error: those of the archive, and others that are asked for.
    known = {name: limit for name, (limit, _) in archive.curve_sizes.items()}
    for name, limit in options.curves:
        if name in known and limit < known[name]:
            raise OptionError(
                f"the archive keeps {name!r} within {known[name]:g}, so that {limit:g} can't be "
                "held for all of it",
                remedy=f"leave it out of --keep (keep_within), or give {known[name]:g}",
            )
    curves = tuple({**dict(options.curves), **known}.items())
    options = replace(options, curves=curves, heights=False)

    # The columns that are exact.
    if archive.kept_columns is not None:
        return replace(options, keep=archive.kept_columns, keep_times=True)
    if options.keep or options.keep_times:
        raise OptionError(
            "the archive keeps no columns, so that none can be appended", remedy="leave out keep"
        )
    return options


def _check_times(archive: Archive, log: Log) -> None:
    """Refuse to continue a track without times, or one by a track without times."""
    for track in log.tracks:
        if track.id in archive.ids and (not track.timed or track.id in archive.untimed):
            raise OptionError(
                f"track {track.id!r} is in the archive, and one of both has no times",
                remedy="give it another name",
            )


def _spans(archive: Archive, log: Log) -> dict[str, tuple[float, float]]:
    """Times of the first and last new sample of each track that the archive has."""
    known = set(archive.ids)
    return {
        track.id: (
            float(log.read(track, 0, 1).times[0]),
            float(log.read(track, len(track) - 1, len(track)).times[0]),
        )
        for track in log.tracks
        if track.timed and track.id in known
    }


def _continued_job(archive: Archive, job: Job) -> Job:
    """The job with tracks that begin where the walks of their ids end in the archive."""
    if isinstance(job.log, MemoryLog):
        known = set(archive.ids)
        tracks = tuple(
            _continue_track(archive, track, job.gap) if track.id in known else track
            for track in job.log.tracks
        )
        return replace(on_tracks(job, tracks), map=archive)
    return replace(job, log=_ContinuedLog(archive, job.log, job.gap), map=archive)


def _continue_track(archive: Archive, track: Track, gap: float) -> Track:
    """Begin a track at the last knot of the archive's walk, unless a gap lies between them."""
    lead = _lead_of(archive, track, gap)
    if lead is None:
        return track
    after, (end, position) = lead
    times = np.append(end, track.times[after:])
    positions = np.concatenate([position, track.positions[after:]])
    return Track(track.id, times, positions, plane=track.plane)


def _lead_of(
    archive: Archive, first_samples: Track, gap: float
) -> tuple[int, tuple[float, NDArray[np.float64]]] | None:
    """Number of the first sample after the archive's walk, and the walk's last knot.

    None where a gap lies between them.
    """
    times = first_samples.times
    end, position = _last_knot(archive, first_samples.id)
    if times[0] - end > gap:
        return None
    after = int(np.searchsorted(times, end, side="right"))
    if times[0] < track_end(archive, first_samples.id) - TIME_SLACK or after == len(times):
        raise _overlap_error(first_samples.id)
    return after, (end, position)


class _ContinuedLog:
    """A log on disk whose tracks begin at the last knots of an archive's walks."""

    def __init__(self, archive: Archive, log: Log, gap: float) -> None:
        self._log = log
        self._leads: dict[str, tuple[Track, int]] = {}
        self._sources = {track.id: track for track in log.tracks}
        known = set(archive.ids)
        self.tracks = [
            self._continued(archive, track, gap) if track.id in known else track
            for track in log.tracks
        ]

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return self._log.dimension

    @property
    def plane(self) -> Plane | None:
        """Where the positions lie on the earth."""
        return self._log.plane

    @property
    def read_result(self) -> ReadResult | None:
        """What was read, repaired and dropped."""
        return self._log.read_result

    def read(self, track: LogTrack, first: int = 0, last: int | None = None) -> Track:
        """Read samples of a track, of which the first may be the last knot in the archive."""
        source = self._sources[track.id]
        last = len(track) if last is None else last
        if track.id not in self._leads:
            return self._log.read(source, first, last)

        # The knot stands where the last sample before it was.
        knot, skipped = self._leads[track.id]
        begin, end = max(first, 1) + skipped, last + skipped
        samples = self._log.read(source, begin, end) if last > 1 else None
        if first > 0 and samples is not None:
            return samples
        fragments = [knot] if samples is None else [knot, samples]
        times = np.concatenate([fragment.times for fragment in fragments])
        positions = np.concatenate([fragment.positions for fragment in fragments])
        return Track(track.id, times, positions, plane=self._log.plane)

    def _continued(self, archive: Archive, track: LogTrack, gap: float) -> LogTrack:
        near = self._log.read(track, 0, min(_SAMPLES_NEAR_START, len(track)))
        lead = _lead_of(archive, near, gap)
        if lead is None:
            return track
        after, (end, position) = lead
        knot = Track(track.id, np.array([end]), position, plane=self._log.plane)
        self._leads[track.id] = knot, after - 1
        return _ShorterTrack(track.id, len(track) - after + 1)


class _ShorterTrack:
    """A track without the samples that the archive has already."""

    timed = True

    def __init__(self, name: str, count: int) -> None:
        self.id = name
        self._count = count

    def __len__(self) -> int:
        return self._count


def _last_knot(archive: Archive, name: str) -> tuple[float, NDArray[np.float64]]:
    """Time and position, shape (1, d), of the last knot of a track."""
    walk = archive.grid_walks.walks[archive.ids.index(name)]
    positions = node_positions(archive.grid_walks, archive.grid)
    return float(knot_times(walk.time_steps[-1:], archive.grid)[0]), positions[walk.nodes[-1:]]


def _overlap_error(name: str) -> OptionError:
    return OptionError(
        f"track {name!r} overlaps in time with the one in the archive",
        remedy="give it another name, or append in order of time",
    )


def _extend(archive: Archive, on_map: Archive, job: Job, *, keep_starts: bool) -> Archive:
    """Join an archive with walks on its map; see :func:`_continue_walk` for ``keep_starts``."""
    # All walks on the finer of the two grids.
    reference = on_map.contents.map
    refinements = 0 if reference is None else reference.refinements
    merged = merge_grid_walks([refined(archive.grid_walks, refinements), on_map.grid_walks])
    old, new = merged.walks[: len(archive.ids)], merged.walks[len(archive.ids) :]

    # Walks of one id become one.
    max_steps = job.gap / step_size(on_map.grid.time)
    walks = dict(zip(archive.ids, old, strict=True))
    for name, walk in zip(on_map.ids, new, strict=True):
        known = walks.get(name)
        if known is not None:
            walks[name] = _continue_walk(name, known, walk, max_steps, keep_start=keep_starts)
        else:
            walks[name] = walk

    # Number the nodes by their first visit anew; tracks without times stay shapes.
    shapes = {*archive.untimed, *on_map.untimed}
    untimed = frozenset(number for number, name in enumerate(walks) if name in shapes)
    extended = new_archive(
        on_map.grid,
        tuple(walks),
        number_by_visit(GridWalks(merged.nodes, tuple(walks.values()), untimed=untimed)),
        layer=archive.contents.layer,
        time_ranges=_time_ranges(archive, on_map, tuple(walks)),
    )

    # What is stated of both.
    bound = _weaker_bound(archive.error_bound, on_map.error_bound)
    sampling = None
    if archive.sampling is not None and job.sampling is not None:
        sampling = max(archive.sampling, job.sampling)
    return with_sampling(with_error_bound(extended, bound), sampling)


def _continue_walk(
    name: str, before: GridWalk, after: GridWalk, max_steps: float, *, keep_start: bool
) -> GridWalk:
    """Continue a walk by another one that begins at its last time step or later.

    Between them lies a gap where they are more than ``max_steps`` time steps apart. Where they meet
    in time, but not in position, the walk goes on from its own last knot. With ``keep_start``, it
    goes within one time step to the first knot of the other one, and from there.
    """
    # Move the first knot of the other walk by a time step, if there is space for it.
    last = int(before.time_steps[-1])
    if after.time_steps[0] < last:
        raise _overlap_error(name)
    meets = after.time_steps[0] == last
    is_elsewhere = after.nodes[0] != before.nodes[-1]
    if keep_start and meets and is_elsewhere and (after.time_steps[1:2] > last + 1).all():
        after = replace(after, time_steps=np.append(last + 1, after.time_steps[1:]))
        meets = False

    # Join.
    shared = int(meets)
    between = [] if shared else [bool(after.time_steps[0] - last > max_steps)]
    return GridWalk(
        np.concatenate([before.nodes, after.nodes[shared:]]),
        np.concatenate([before.time_steps, after.time_steps[shared:]]),
        np.concatenate([before.gaps, np.array(between, bool), after.gaps]),
    )


def _time_ranges(
    archive: Archive, on_map: Archive, names: Sequence[str]
) -> list[NDArray[np.float64]]:
    """Times at which the pieces of each track begin and end, in both archives."""
    ranges: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
    for each in (archive, on_map):
        for name, pieces in zip(each.ids, piece_time_ranges_of(each), strict=True):
            ranges[name].append(pieces)
    return [np.concatenate(ranges[name]) for name in names]


def _weaker_bound(one: ErrorBound | None, other: ErrorBound | None) -> ErrorBound | None:
    """The bound that both hold; a maximum bounds the RMSE, too."""
    if one is None or other is None:
        return None
    larger = one if one.metres >= other.metres else other
    if one.maximum and other.maximum:
        return larger

    # The largest distance is bounded by a maximum alone, or by one beside an RMSE.
    maxima = [bound.metres if bound.maximum else bound.max_error for bound in (one, other)]
    known = [maximum for maximum in maxima if maximum is not None]
    if len(known) < len(maxima) or larger.growth:
        return replace(larger, maximum=False, max_digits=0, max_exponent=0)
    return rounded_bounds(larger.metres, max(known))


def _measure(job: Job, extended: Archive) -> ErrorSummary:
    """Read the archive back, and compare the new tracks with it."""
    decoded = open_archive(extended.to_bytes(), extended.map)

    def report(done: float) -> None:
        job.report("measure", done)

    return measure(job.log, decoded, job.batches, job.executor, report)


def _report(
    job: Job,
    archive: Archive,
    on_map: Archive,
    extended: Archive,
    errors: ErrorSummary,
    seconds: float,
) -> Report:
    """Say what was done for the new tracks, and how large the archive has become."""
    notes = job.notes + off_map_notes(on_map, archive)
    report = report_on(job, extended, errors, notes, seconds)
    segments = sum(len(walk.gaps) for walk in on_map.grid_walks.walks)
    return replace(report, tracks=len(job.log.tracks), segments=segments)
