"""Compressing a log: learn, write, read back and measure, until the bound holds."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gpszip.archive import (
    Archive,
    new_archive,
    open_archive,
    with_error_bound,
    with_sampling,
    with_sections,
)
from gpszip.codec.numbering import number_by_visit
from gpszip.container.contents import Section
from gpszip.errors import BoundError
from gpszip.model import GridWalk, GridWalks, Listener, Options, Report, Track
from gpszip.model.grid import step_size
from gpszip.model.log import Log
from gpszip.pipeline.bounds import describe_bound, excess, holds, stated_bound
from gpszip.pipeline.job import Job, prepare
from gpszip.pipeline.kept_curves import curve_notes
from gpszip.pipeline.learn import Learned, keep_all_samples, learn
from gpszip.pipeline.measure import measure
from gpszip.pipeline.size_search import Try, smallest_error
from gpszip.pipeline.validate import as_log, on_plane_of
from gpszip.run.executor import Executor, local_executor
from gpszip.walks.cut_ends import trim_walks
from gpszip.walks.quantised import node_positions
from gpszip.walks.shapes import drop_time_steps

if TYPE_CHECKING:
    from gpszip.walks.error import ErrorSummary

#: Makes the section of logs that are kept exactly, predicted by the walks of an archive.
LogKeeper = Callable[[Archive | None], Section]

__all__ = ["LogKeeper", "compress", "off_map_notes", "report_on", "within_bound"]

#: Space steps by which a shape may go on beyond the end of its track.
_MAX_SHAPE_EXCESS = 2.0

#: Tracks without times that a note names.
_MAX_NAMED = 5

#: Share of the bound below which no target is tried.
_MIN_TARGET = 0.1

#: First target of a log encoded in batches, as a share of the bound: rounding, and the knots where
#: slices of a track are joined, add to the error.
_FIRST_TARGET_IN_BATCHES = 0.998

#: Where a target was missed, the next one lies this much below what should do.
_TIGHTENING = 0.98

#: Targets for which learning may find nothing before every sample is kept instead.
_MAX_FAILURES = 3

#: Where nothing else holds the bound, every sample becomes a knot, rounded by at most these shares
#: of the bound, one after the other. Rounding lengthens tracks without times, and so shifts their
#: positions at equal shares of the length: only they need shares below 1.
_VERBATIM_SHARES = (1.0, 0.25, 0.05, 0.01)


def compress(
    tracks: Sequence[Track] | Track | Log,
    options: Options | None = None,
    *,
    memory: int | None = None,
    map: Archive | None = None,
    logs: LogKeeper | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, Report]:
    """Learn the map of a log and store its tracks as walks on the map.

    1. Check the tracks, find their gaps, and estimate a bound where none is given.
    2. Learn nodes and walks for a target error. A log on disk is learned from a subsample and
       encoded in batches.
    3. Write the archive, read it back and measure the error at every sample. Repeat with a
       tighter target until the bound holds: an archive that breaks it is never returned.

    Parameters
    ----------
    tracks : sequence of Track, Track or Log
        On one plane, with different ids; they are not modified.
    options : Options, optional
        Without a bound, RMSE and maximum are estimated from the log.
    memory : int, optional
        Bytes that the process may take, at least 400 MiB; needed for a log on disk. Other
        processes that work for it take no more each.
    map : Archive, optional
        Known map: tracks become walks on it, and only what it lacks is learned.
    logs : callable, optional
        Keeps the logs exactly: makes a section of them, of an archive whose walks predict them, or
        of None. Bounds that are estimated are then twice as large.
    executor : Executor, optional
        Spreads the work, by default over a thread for each core. The archive is the same for
        any number of workers.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        Everything that it answers comes from its bytes.
    Report
        What was done and measured.

    Raises
    ------
    InputError
        If there are no tracks.
    OptionError
        If tracks or options don't go together.
    BoundError
        If the bound can't be held, or no archive is small enough.
    """
    # Take the time of the whole call; without options, the bound is estimated.
    start = time.perf_counter()
    options = options or Options()

    # Check the tracks, and prepare what is learned from.
    log = as_log(tracks)
    if map is not None:
        log = on_plane_of(map, log, options)
    job = prepare(
        log,
        options,
        memory=memory,
        map=map,
        executor=executor,
        progress=progress,
        exact=logs is not None,
    )

    # Logs that no walks predict come first: a size counts them, and walks on a known map need that.
    if logs is not None and (map is not None or job.options.size is not None):
        job, logs = replace(job, extras=(*job.extras, logs(None))), None

    # Learn and measure until the bound, or the size, is reached.
    if job.options.size is None:
        archive, errors = _finish(job, *within_bound(job))
    else:
        archive, errors = _within_size(job, job.options.size)
    if logs is not None:
        archive = with_sections(archive, (logs(archive),))

    # Say in the report which tracks have no times, and what lies off the known map.
    notes = job.notes + off_map_notes(archive, map) + _notes_on_times(job)
    notes += curve_notes(archive, job.log)
    seconds = time.perf_counter() - start
    return archive, report_on(job, archive, errors, notes, seconds)


def within_bound(job: Job) -> tuple[Archive, ErrorSummary]:
    """Learn, write, read back and measure, until the bound holds."""
    # Aim a little below the bound in batches: rounding, and the knots where slices of a track are
    # joined, add to the error.
    target: Options | None = job.aim
    if job.batch is not None:
        target = job.aim.tightened(_FIRST_TARGET_IN_BATCHES)

    # Lower the target until what the bytes decode to holds the bound.
    failures = 0
    while target is not None:
        # Nothing learned: aim lower, a few times.
        learned = learn(job, target)
        if learned is None:
            failures += 1
            if failures == _MAX_FAILURES:
                break
            target = _tightened(target, 1.0 + 0.1 * failures, job.options)
            continue

        # Learned and measured: aim lower by what was missed.
        archive, errors = _write_and_measure(job, learned)
        if holds(errors, job.aim):
            return archive, errors
        if errors.uncovered:
            break
        target = _tightened(target, excess(errors, job.aim), job.options)
    return _last_resort(job)


def _within_size(job: Job, size: int) -> tuple[Archive, ErrorSummary]:
    """Search the smallest RMSE whose archive takes at most ``size`` bytes."""
    from gpszip.mapping.noise import extent_rmse, suggest_rmse

    # What is kept exactly takes the same bytes at any error.
    columns = sum(len(section.body) for section in job.extras)
    if size <= columns:
        raise BoundError(
            f"{size:,} bytes are too few for this log: what is kept exactly takes {columns:,}",
            remedy="allow more, or keep less",
        )

    # Hold one RMSE in metres, and compare the bytes of map and walks without the columns.
    def attempt(rmse: float, effort: int) -> Try[tuple[Archive, ErrorSummary]] | None:
        options = replace(job.options, size=None, rmse=rmse, effort=effort)
        try:
            archive, errors = _finish(job, *within_bound(replace(job, options=options)))
        except BoundError:
            return None
        return Try(archive.size - columns, errors.rmse, (archive, errors))

    # A secant search between the noise of the log and its extent
    best, smallest = smallest_error(
        attempt,
        size - columns,
        first=suggest_rmse(job.sample, job.gaps),
        coarsest=2 * extent_rmse(job.sample),
        effort=job.options.effort,
    )
    if best is None:
        raise BoundError(
            f"{size:,} bytes are too few for this log: the smallest archive takes "
            f"{smallest + columns:,}",
            remedy="allow as many",
        )
    return best.result


def _write_and_measure(job: Job, learned: Learned) -> tuple[Archive, ErrorSummary]:
    """Write an archive, and measure the error of what its bytes decode to."""
    # Shapes have no times.
    others_timed = job.map is not None or len(job.untimed) < len(job.log.tracks)
    grid_walks = drop_time_steps(learned.grid_walks, job.untimed, others=others_timed)
    archive = new_archive(
        learned.grid,
        job.ids,
        grid_walks,
        layer=job.options.layer,
        extras=job.extras,
        known_map=job.map,
        refinements=learned.refinements,
        executor=local_executor(job.executor),
        time_ranges=job.time_ranges,
        step=job.step,
    )

    # Columns are kept exactly, and may be large: they are not read back.
    bare = replace(archive, contents=replace(archive.contents, extras=()))
    decoded = open_archive(bare.to_bytes(), job.map)

    # Report the share of the samples that are measured.
    def report(done: float) -> None:
        job.report("measure", done)

    # Measure at every sample, then state the bound and the sampling interval in the archive.
    errors = measure(job.log, decoded, job.batches, job.executor, report)
    decoded = with_sections(decoded, job.extras)
    stated = with_error_bound(decoded, stated_bound(job.options, errors))
    return with_sampling(stated, job.sampling), errors


def _last_resort(job: Job) -> tuple[Archive, ErrorSummary]:
    """Do without the known map, then keep every sample of a log in memory."""
    # Learn a map of the log's own where the known map doesn't do. A log on disk can't keep every
    # sample as a knot, which memory doesn't allow.
    if job.map is not None:
        return within_bound(replace(job, map=None))
    if job.batch is not None:
        raise BoundError(
            f"{describe_bound(job.options)} can't be held batch by batch",
            remedy="allow a larger error, or more memory",
        )

    # Make every sample a knot, on finer and finer grids for shapes: rounding lengthens them.
    aim = job.aim
    bounds = [bound for bound in (aim.rmse, aim.max_error) if bound is not None]
    if job.options.k is None and bounds:
        for share in _VERBATIM_SHARES if job.untimed else _VERBATIM_SHARES[:1]:
            learned = keep_all_samples(job, share * min(bounds))
            archive, errors = _write_and_measure(job, learned)
            if holds(errors, aim):
                return archive, errors
    remedy = "allow a larger error" + (", or more segments (k)" if job.options.k else "")
    raise BoundError(f"{describe_bound(job.options)} can't be held", remedy=remedy)


def _tightened(target: Options, ratio: float, asked: Options) -> Options | None:
    """Lower a target whose error was ``ratio`` times the bound; None where that is of no use."""
    tighter = target.tightened(max(_TIGHTENING / ratio, 0.5))
    bound = asked.rmse or asked.max_error or 1.0
    share = (tighter.rmse or tighter.max_error or 0.0) / bound
    return None if share < _MIN_TARGET or asked.k is not None else tighter


def _finish(job: Job, archive: Archive, errors: ErrorSummary) -> tuple[Archive, ErrorSummary]:
    """Drop the times of a measured archive where they are not to be kept."""
    if job.options.times or not archive.timed:
        return archive, errors
    return _without_times(archive), errors


def _without_times(archive: Archive) -> Archive:
    """Return an archive of the shapes alone."""
    # Shapes end where their tracks do, not at a knot well behind.
    grid, step = archive.grid, step_size(archive.grid.space)
    known = archive.grid_walks.nodes
    nodes, trimmed = trim_walks(
        node_positions(archive.grid_walks, grid), archive.walks, _MAX_SHAPE_EXCESS * step
    )
    offsets = nodes[len(known) :] - np.array(grid.origin) / 1000
    new = np.rint(offsets / step).astype(np.int64)

    walks = tuple(
        GridWalk(walk.nodes, np.zeros(len(walk.nodes), np.int64), walk.gaps) for walk in trimmed
    )
    shapes = GridWalks(np.concatenate([known, new]), walks, timed=False)
    return new_archive(grid, archive.ids, number_by_visit(shapes), layer=archive.contents.layer)


def off_map_notes(archive: Archive, map: Archive | None) -> tuple[str, ...]:
    """Say how much of the log a known map lacks."""
    if map is None:
        return ()
    if archive.map is None:
        return ("the map's grid is too coarse for the bound: the archive holds a map of its own",)
    lines = archive.off_map_lines
    length = sum(float(np.sqrt((np.diff(line, axis=0) ** 2).sum(axis=1)).sum()) for line in lines)
    if not lines:
        return ()
    paths = "1 path lies" if len(lines) == 1 else f"{len(lines):,} paths lie"
    return (f"{paths} off the map, {length:,.0f} m in all",)


def _notes_on_times(job: Job) -> tuple[str, ...]:
    """Say which tracks have no times, and that times were left out."""
    # Name the tracks kept as shapes, and say where measured times aren't in the archive.
    notes: tuple[str, ...] = ()
    names = [repr(track.id) for track in job.log.tracks if not track.timed]
    if len(names) == len(job.log.tracks):
        notes = (
            "no times in the log: shapes are kept, and errors are distances at equal shares "
            "of the length",
        )
    elif names:
        more = f" and {len(names) - _MAX_NAMED:,} more" if len(names) > _MAX_NAMED else ""
        notes = (f"without times, kept as shapes: {', '.join(names[:_MAX_NAMED])}{more}",)
    if not job.options.times and len(names) < len(job.log.tracks):
        notes += (
            "times were left out after measuring: "
            "positions at a time can't be had from the archive",
        )
    return notes


def report_on(
    job: Job,
    archive: Archive,
    errors: ErrorSummary,
    notes: tuple[str, ...],
    seconds: float,
) -> Report:
    """Summarise what was done, learned and measured."""
    return Report(
        points=errors.points,
        tracks=len(archive.ids),
        segments=sum(len(walk.gaps) for walk in archive.grid_walks.walks),
        nodes=len(archive.road_map.nodes),
        edges=len(archive.road_map.edges),
        bytes_out=archive.size,
        rmse=errors.rmse,
        max_error=errors.max_error,
        seconds=seconds,
        gap=job.gap,
        bound=describe_bound(job.options),
        notes=notes,
    )
