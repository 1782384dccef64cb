"""Compressing tracks: learn, write, read back and measure, until the bound is held."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, open_archive, with_error_bound, with_sampling
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import BoundError, OptionError
from gpszip.model import (
    GridWalk,
    GridWalks,
    Listener,
    Options,
    Progress,
    QuantisationGrid,
    Report,
    Track,
)
from gpszip.model.error_bound import ErrorBound, rounded_bound, rounded_bounds
from gpszip.model.grid import refined_grid, step_size
from gpszip.pipeline.validate import check_names, checked, laid_on
from gpszip.run.executor import Executor, local_executor

if TYPE_CHECKING:
    from gpszip.pipeline.size_search import Try
    from gpszip.walks.error import ErrorSummary

__all__ = [
    "MAXIMUM_OF_RMSE",
    "NO_TIMES",
    "asked",
    "compress",
    "estimated",
    "gaps_of",
    "holds",
    "in_bytes",
    "kept",
    "measure",
    "off_map",
    "promised",
    "report_on",
    "sampling_of",
    "without_times",
]

#: What is to be said of an archive without times.
NO_TIMES = "times were left out after measuring: positions at a time can't be had from the archive"

#: Without any bound, no sample is farther away than so many times the RMSE: an RMSE alone says nothing of the worst sample.
MAXIMUM_OF_RMSE = 4.0

#: Space steps by which a shape may go on beyond the end of its track.
_BEYOND = 2.0

#: So many tracks without times are named.
_NAMED = 5

#: Share of the bound below which no target is tried.
_LEAST_AIM = 0.1

#: Where a target was missed, the next one lies this much below what should do.
_TIGHTER = 0.98

#: How often learning may come to nothing before every sample is kept instead.
_FAILURES = 3

#: Shares of the bound to which every sample is kept: rounding adds to the ways of shapes, and so shifts what lies at equal shares.
_VERBATIM_SHARES = (1.0, 0.25, 0.05, 0.01)

#: A bound counts as held up to the rounding of its own measurement.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class _Job:
    """What is compressed, and how."""

    tracks: tuple[Track, ...]
    gaps: tuple[NDArray[np.bool_], ...]
    options: Options
    executor: Executor
    listener: Listener | None
    extras: tuple[Section, ...] = ()
    map: Archive | None = None
    sampling: float | None = None

    @property
    def spans(self) -> list[NDArray[np.float64]]:
        """Times of first and last sample of each run between gaps, for each track."""
        from gpszip.geo.gaps import piece_time_ranges

        return [
            piece_time_ranges(track.times, gap) if track.timed else np.zeros((0, 2))
            for track, gap in zip(self.tracks, self.gaps, strict=True)
        ]

    @property
    def step(self) -> float:
        """Seconds between two samples of the track that has the most; 0 where none has two."""
        timed = [track for track in self.tracks if track.timed and len(track) > 1]
        return min((float(np.median(np.diff(track.times))) for track in timed), default=0.0)

    @property
    def untimed(self) -> frozenset[int]:
        """Numbers of the tracks that have no times."""
        return frozenset(number for number, track in enumerate(self.tracks) if not track.timed)

    @property
    def aim(self) -> Options:
        """The options with the bound that the archive is to hold, a little below the one that was asked for."""
        return self.options.aim(geographic=self.tracks[0].plane is not None)

    @property
    def ids(self) -> list[str]:
        return [track.id for track in self.tracks]

    def tell(self, stage: str, done: float) -> None:
        if self.listener is not None:
            self.listener(Progress(stage, done))


@dataclass(frozen=True, eq=False)
class _Learned:
    """Walks on a lattice, which may be that of a known map with its quanta halved so many times."""

    grid: QuantisationGrid
    grid_walks: GridWalks
    refinements: int = 0


def compress(
    tracks: Sequence[Track] | Track,
    options: Options | None = None,
    *,
    bytes_in: int | None = None,
    map: Archive | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, Report]:
    """Learn the map of tracks and store them as walks on it.

    The archive's bytes are decoded again and measured at every sample. Where they don't hold the bound, learning is
    repeated with a tighter target; an archive that breaks its bound is never returned.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On one plane, with different ids; they are not modified.
    options : Options, optional
        How. Without a bound, a sensible RMSE is estimated from the log.
    bytes_in : int, optional
        Size of the log, to which ``options.ratio`` refers; by default 8 bytes for each time and coordinate.
    map : Archive, optional
        A map that is there already: the tracks become walks on it, and only what lies off it is learned and stored.
    executor : Executor, optional
        Spreads the work, by default over a thread for each core; the archive is the same for any number of workers.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        What was learned; everything that it answers comes from its bytes.
    Report
        What was done and measured.

    Raises
    ------
    InputError
        If there are no tracks.
    OptionError
        If tracks don't go together, or the options don't fit them.
    BoundError
        If the bound can't be held, or no archive is as small as it should be.
    """
    from gpszip.run import resolve_executor

    start = time.perf_counter()
    options = options or Options()
    whole = checked(tracks) if map is None else laid_on(map, checked(tracks), options)
    gap, gaps = gaps_of(whole, options.gap)
    numbers = sum(8 * (1 + track.dimension) * len(track) for track in whole)
    options, notes = _bounded(
        whole, gaps, in_bytes(options, numbers if bytes_in is None else bytes_in)
    )
    job = _Job(
        whole,
        gaps,
        options,
        resolve_executor(executor),
        progress,
        kept(whole, options),
        map,
        sampling_of(whole, gaps),
    )
    archive, fit = (
        _within_size(job, options.size)
        if options.size is not None
        else _finished(options, *_within_bound(job))
    )
    notes += off_map(archive, map) + shapes_named(whole)
    if not options.times and any(track.timed for track in whole):
        notes += (NO_TIMES,)
    return archive, report_on(archive, fit, options, notes, gap, time.perf_counter() - start)


def shapes_named(tracks: Sequence[Track]) -> tuple[str, ...]:
    """What is to be said of tracks without times."""
    names = [repr(track.id) for track in tracks if not track.timed]
    if not names:
        return ()
    if len(names) == len(tracks):
        return (
            "no times in the log: shapes are kept, and errors are distances at equal shares of the way",
        )
    shown = ", ".join(names[:_NAMED]) + (
        f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
    )
    return (f"without times, kept as shapes: {shown}",)


def off_map(archive: Archive, map: Archive | None) -> tuple[str, ...]:
    """What is to be said of stretches that the map lacks."""
    if map is None:
        return ()
    if archive.map is None:
        return (
            "the map's lattice is too coarse for the bound: the archive holds a map of its own",
        )
    ways = archive.off_map_lines
    length = sum(float(np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1)).sum()) for way in ways)
    return (f"{len(ways):,} stretches lie off the map, {length:,.0f} m in all",) if ways else ()


def gaps_of(
    tracks: Sequence[Track], gap: float | None
) -> tuple[float, tuple[NDArray[np.bool_], ...]]:
    """Seconds above which a step is a gap, and the steps of each track that are."""
    from gpszip.geo.gaps import estimate_gap, find_gaps

    length = estimate_gap([track for track in tracks if track.timed]) if gap is None else gap
    return length, tuple(find_gaps(track, length if track.timed else math.inf) for track in tracks)


def sampling_of(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float | None:
    """About the seconds between two samples of the tracks that have times."""
    from gpszip.geo.sampling import sampling_interval

    timed = [(track, gap) for track, gap in zip(tracks, gaps, strict=True) if track.timed]
    return (
        sampling_interval([track for track, _ in timed], [gap for _, gap in timed])
        if timed
        else None
    )


def _bounded(
    tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]], options: Options
) -> tuple[Options, tuple[str, ...]]:
    """Options that have a bound, unless the number of parts stands for one."""
    from gpszip.mapping.noise import suggest_rmse

    if options.bounded or options.sized or options.thesis:
        return options, ()
    return estimated(options, suggest_rmse(tracks, gaps), "the log")


def estimated(options: Options, rmse: float, source: str) -> tuple[Options, tuple[str, ...]]:
    """Options with a bound on RMSE and maximum, and what is to be said of it."""
    maximum = MAXIMUM_OF_RMSE * rmse
    note = f"no bound was given: RMSE {rmse:g} m and maximum {maximum:g} m were estimated from {source}"
    return replace(options, rmse=rmse, max_error=maximum), (note,)


def kept(tracks: Sequence[Track], options: Options) -> tuple[Section, ...]:
    """Sections of what is to be kept besides the walks, which the tracks must have."""
    if not (options.keep or options.keep_times):
        return ()
    check_names(options.keep, geographic=tracks[0].plane is not None)
    shape = next((track for track in tracks if not track.timed), None)
    if shape is not None:
        raise OptionError(
            f"track {shape.id!r} has no times, by which columns are kept; leave out --keep and --keep-times (keep)"
        )
    for name in options.keep:
        lacking = next((track for track in tracks if name not in track.attributes), None)
        if lacking is not None:
            there = ", ".join(lacking.attributes) or "none; name it when reading: keep"
            raise OptionError(
                f"track {lacking.id!r} has no column {name!r} to keep; it has {there}"
            )
    columns = {
        name: np.concatenate([track.attributes[name] for track in tracks]) for name in options.keep
    }
    kept = KeptColumns(
        tuple(map(len, tracks)), np.concatenate([track.times for track in tracks]), columns
    )
    return (Section(SectionKind.ATTRIBUTES, encode_attributes(kept)),)


def without_times(archive: Archive) -> Archive:
    """Return an archive of the shapes alone, once their error has been measured."""
    from gpszip.codec.walks import number_by_visit
    from gpszip.walks.cut_ends import trim_walks
    from gpszip.walks.quantised import node_positions

    # shapes end where their tracks do, not at a knot well behind
    grid, step = archive.grid, step_size(archive.grid.space)
    nodes, cut = trim_walks(node_positions(archive.grid_walks, grid), archive.walks, _BEYOND * step)
    new = np.rint(
        (nodes[len(archive.grid_walks.nodes) :] - np.array(grid.origin) / 1000) / step
    ).astype(np.int64)

    walks = tuple(
        GridWalk(walk.nodes, np.zeros(len(walk.nodes), np.int64), walk.gaps) for walk in cut
    )
    grid_walks = number_by_visit(
        GridWalks(np.concatenate([archive.grid_walks.nodes, new]), walks, timed=False)
    )
    return new_archive(grid, archive.ids, grid_walks, layer=archive.contents.layer)


def in_bytes(options: Options, whole: int) -> Options:
    """Options that say in bytes what they said as a ratio to so many bytes."""
    return (
        options
        if options.ratio is None
        else replace(options, ratio=None, size=max(int(whole / options.ratio), 1))
    )


def _within_size(job: _Job, size: int) -> tuple[Archive, ErrorSummary]:
    """Look for the smallest RMSE whose archive takes at most so many bytes."""
    from gpszip.mapping.noise import extent_rmse, suggest_rmse
    from gpszip.pipeline.size_search import Try, smallest_error

    def attempt(rmse: float, effort: int) -> Try[tuple[Archive, ErrorSummary]] | None:
        aim = replace(job.options, size=None, rmse=rmse, effort=effort)
        try:
            archive, fit = _finished(aim, *_within_bound(replace(job, options=aim)))
        except BoundError:
            return None
        return Try(len(archive.to_bytes()), fit.rmse, (archive, fit))

    first, coarsest = suggest_rmse(job.tracks, job.gaps), 2 * extent_rmse(job.tracks)
    found, smallest = smallest_error(
        attempt, size, first=first, coarsest=coarsest, effort=job.options.effort
    )
    if found is None:
        raise BoundError(
            f"{size:,} bytes are too few for this log: the smallest archive takes {smallest:,}; allow as many"
        )
    return found.made


def _finished(
    options: Options, archive: Archive, fit: ErrorSummary
) -> tuple[Archive, ErrorSummary]:
    """Leave out of a measured archive what is not to be kept."""
    return (archive if options.times or not archive.timed else without_times(archive)), fit


def _within_bound(job: _Job) -> tuple[Archive, ErrorSummary]:
    """Learn, write, read back and measure, until the bound is held."""
    target: Options | None = job.aim
    failures = 0
    while target is not None:
        learned = _learned(job, target)
        if learned is None:
            failures += 1
            target = (
                _tightened(target, 1.0 + 0.1 * failures, job.options)
                if failures < _FAILURES
                else None
            )
            continue
        archive, fit = _written(job, learned)
        if holds(fit, job.aim):
            return archive, fit
        if fit.uncovered:
            break
        target = _tightened(target, _excess(fit, job.aim), job.options)
    return _last_resort(job)


def _last_resort(job: _Job) -> tuple[Archive, ErrorSummary]:
    """Keep every sample, unless the user has said how many parts there are to be."""
    from gpszip.mapping.verbatim import keep_samples
    from gpszip.walks.shapes import with_synthetic_times

    if job.map is not None:
        return _within_bound(replace(job, map=None))
    aim = job.aim
    bounds = [bound for bound in (aim.rmse, aim.max_error) if bound is not None]
    if job.options.k is None and bounds:
        for share in _VERBATIM_SHARES if job.untimed else (1.0,):
            archive, fit = _written(
                job,
                _Learned(
                    *keep_samples(
                        with_synthetic_times(job.tracks, job.gaps), job.gaps, share * min(bounds)
                    )
                ),
            )
            if holds(fit, aim):
                return archive, fit
    raise BoundError(
        f"{_bound(job.options)} can't be held; allow a larger error"
        + (", or more parts" if job.options.k else "")
    )


def _written(job: _Job, learned: _Learned) -> tuple[Archive, ErrorSummary]:
    from gpszip.walks.shapes import drop_time_steps

    others = job.map is not None or len(job.untimed) < len(job.tracks)
    grid_walks = drop_time_steps(learned.grid_walks, job.untimed, others=others)
    made = new_archive(
        learned.grid, job.ids, grid_walks, layer=job.options.layer, extras=job.extras, known_map=job.map, refinements=learned.refinements,
        executor=local_executor(job.executor), spans=job.spans, step=job.step,
    )  # fmt: skip
    job.tell("measure", 0.0)
    archive = open_archive(made.to_bytes(), job.map)
    fit = _measured(job.tracks, archive)
    job.tell("measure", 1.0)
    return with_sampling(with_error_bound(archive, promised(job.options, fit)), job.sampling), fit


def promised(options: Options, fit: ErrorSummary) -> ErrorBound | None:
    """The bound that was asked for; where none was, the error that was reached. Nothing where that is not (yet) kept."""
    if options.bounded and not holds(fit, options):
        return None
    return asked(options) if options.bounded else rounded_bound(fit.rmse, maximum=False)


def asked(options: Options) -> ErrorBound | None:
    """The bound that was asked for, as a promise."""
    if options.rmse is not None and options.max_error is not None:
        return rounded_bounds(options.rmse, options.max_error)
    return rounded_bound(
        options.max_error or options.rmse or 0.0, maximum=options.max_error is not None
    )


def _learned(job: _Job, target: Options) -> _Learned | None:
    tracks, gaps = _samples(job)
    if target.thesis:
        from gpszip.mapping import independent

        return _Learned(
            *independent.learn_map(
                tracks, gaps, target, executor=job.executor, progress=job.listener
            )
        )
    from gpszip.mapping import on_known_map as known
    from gpszip.mapping import search as connected

    def tell(done: int, whole: int) -> None:
        job.tell("learn", done / whole)

    if target.rmse is None and target.max_error is None:
        return None
    how: dict[str, Any] = {
        "rmse": target.rmse, "max_error": target.max_error, "effort": target.effort, "executor": job.executor, "progress": tell,
    }  # fmt: skip
    if job.map is None:
        found = _mended(job, connected.learn_map(tracks, gaps, **how), target)
        return None if found is None else _Learned(*found)
    refinements = known.needed_refinements(job.map.grid, target.rmse, target.max_error)
    grid = refined_grid(job.map.grid, refinements)
    grid_walks = known.learn_on(job.map.prior(refinements), grid, tracks, gaps, **how)
    return None if grid_walks is None else _Learned(grid, grid_walks, refinements)


def _samples(job: _Job) -> tuple[tuple[Track, ...], tuple[NDArray[np.bool_], ...]]:
    """What is learnt from: all samples, or few with weights."""
    from gpszip.walks.shapes import with_synthetic_times

    tracks = with_synthetic_times(job.tracks, job.gaps)
    if job.options.coreset is None:
        return tracks, job.gaps
    from gpszip.mapping.thinning import reduce_to_coreset

    return reduce_to_coreset(tracks, job.gaps, job.options.coreset)


def _mended(
    job: _Job, found: tuple[QuantisationGrid, GridWalks] | None, target: Options
) -> tuple[QuantisationGrid, GridWalks] | None:
    """What was learnt from a coreset, so that the samples that it lacks keep the maximum, too."""
    if found is None or job.options.coreset is None or target.max_error is None:
        return found
    from gpszip.mapping.max_error import enforce_max_error
    from gpszip.walks.shapes import with_synthetic_times

    return enforce_max_error(with_synthetic_times(job.tracks, job.gaps), *found, target.max_error)


def measure(tracks: Sequence[Track], archive: Archive) -> ErrorSummary:
    """Decode an archive's bytes and compare the walks of these tracks with every sample."""
    return _measured(tracks, open_archive(archive.to_bytes(), archive.map))


def _measured(tracks: Sequence[Track], archive: Archive) -> ErrorSummary:
    from gpszip.walks.error import measure_errors
    from gpszip.walks.quantised import node_positions

    return measure_errors(
        tracks,
        [archive.walk(track.id) for track in tracks],
        node_positions(archive.grid_walks, archive.grid),
    )


def holds(fit: ErrorSummary, options: Options) -> bool:
    """Whether what was measured is within the bound, and every sample has a position."""
    return _excess(fit, options) <= 1 + _ROUNDING


def _excess(fit: ErrorSummary, options: Options) -> float:
    """What was reached as a multiple of what was asked for; 0 where nothing was, infinite where a sample has no position."""
    if fit.uncovered:
        return math.inf
    rmse = fit.rmse / options.rmse if options.rmse is not None else 0.0
    return max(rmse, fit.max_error / options.max_error if options.max_error is not None else 0.0)


def _tightened(target: Options, over: float, asked: Options) -> Options | None:
    """Aim lower by what was missed; None where that is of no more use."""
    tighter = target.tightened(max(_TIGHTER / over, 0.5))
    aim = (tighter.rmse or tighter.max_error or 0.0) / (asked.rmse or asked.max_error or 1.0)
    return None if aim < _LEAST_AIM or asked.k is not None else tighter


def _bound(options: Options) -> str:
    if options.size is not None:
        return f"size <= {options.size} bytes"
    bounds = {"RMSE": options.rmse, "maximum": options.max_error}
    return ", ".join(
        f"{name} <= {bound:g} m" for name, bound in bounds.items() if bound is not None
    )


def report_on(
    archive: Archive,
    fit: ErrorSummary,
    options: Options,
    notes: tuple[str, ...],
    gap: float,
    seconds: float,
) -> Report:
    """What was done, found and measured."""
    return Report(
        points=fit.points,
        tracks=len(archive.ids),
        segments=sum(len(walk.gaps) for walk in archive.grid_walks.walks),
        nodes=len(archive.road_map.nodes),
        edges=len(archive.road_map.edges),
        bytes_out=archive.size,
        rmse=fit.rmse,
        max_error=fit.max_error,
        seconds=seconds,
        gap=gap,
        bound=_bound(options),
        notes=notes,
    )
