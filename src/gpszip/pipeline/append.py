"""Further logs for an archive that is there already: its map grows, its walks stay as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, with_error_bound, with_sampling
from gpszip.codec.walks import number_by_visit
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import BoundError, OptionError
from gpszip.mapping.search import suggest_time_step
from gpszip.model import GridWalk, GridWalks, Listener, Options, Report, Track
from gpszip.model.error_bound import ErrorBound
from gpszip.model.grid import step_size
from gpszip.model.grid_walks import refined
from gpszip.pipeline.compress import compress, gaps_of, holds, kept, measure, sampling_of
from gpszip.pipeline.continue_tracks import claimed, end_of, ready_to_continue
from gpszip.pipeline.validate import checked, laid_on
from gpszip.run.executor import Executor
from gpszip.walks.error import TIME_SLACK
from gpszip.walks.quantised import knot_times, merge_grid_walks, node_positions
from gpszip.walks.shapes import with_synthetic_times

if TYPE_CHECKING:
    from gpszip.walks.error import ErrorSummary

__all__ = ["SHARES", "append", "completed", "grown", "last_knot", "overlapping"]

#: Shares of the bound that are tried: where a walk goes on, the end of the older one stays as it is.
SHARES = (1.0, 0.97, 0.9, 0.75)


def append(
    archive: Archive,
    tracks: Sequence[Track] | Track,
    options: Options | None = None,
    *,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, Report]:
    """Add tracks to an archive as walks on its map, which grows where they leave it.

    The walks that are there stay what they are, knot by knot. A track whose name is in the archive goes on there.

    Parameters
    ----------
    archive : Archive
        With times and a map of its own; it is not modified.
    tracks : sequence of Track, or one Track
        Those of a name that is in the archive begin where that one ends, or later.
    options : Options, optional
        How. Without a bound, the new walks keep what the archive promises.
    executor : Executor, optional
        Spreads the work.
    progress : callable, optional
        Called with :class:`~gpszip.model.report.Progress` events.

    Returns
    -------
    Archive
        The old walks and the new ones.
    Report
        What was done for the new tracks.

    Raises
    ------
    OptionError
        If tracks and archive don't go together.
    BoundError
        If the bound can't be held on the archive's lattice.

    Examples
    --------
    >>> from gpszip.pipeline.compress import compress
    >>> there = Track("a", range(9), [[float(t)] for t in range(9)])
    >>> back = Track("a", range(10, 19), [[18.0 - t] for t in range(10, 19)])
    >>> archive, _ = append(compress(there, Options(max_error=0.1))[0], back)
    >>> archive.ids, len(archive.road_map.nodes), bool(abs(archive.position("a", 14.0)[0] - 4) <= 0.1)
    (('a',), 2, True)
    """
    options = completed(options or Options(), archive)
    whole = laid_on(archive, checked(tracks), options)
    kept(whole, options)
    gap, silent = gaps_of(whole, options.gap)
    sampling = sampling_of(whole, silent)
    check_goes_on(archive, whole)
    starts = {track.id: float(track.times[0]) for track in whole if track.timed}
    suited = suggest_time_step(with_synthetic_times(whole, silent), silent, archive.grid.space)
    archive = ready_to_continue(archive, starts, suited)
    led = tuple(
        _led_on(archive, track, gap) if track.id in archive.ids else track for track in whole
    )
    for share in SHARES:
        aim = replace(options.tightened(share), gap=gap, keep=(), keep_times=False)
        on_map, report = compress(led, aim, map=archive, executor=executor, progress=progress)
        if on_map.map is None:
            break
        extras = _united_extras(archive, whole if options.keep_times else (), on_map.ids)
        both = grown(archive, on_map, gap, sampling, extras)
        found = measure(whole, both)
        if holds(found, options.aim(geographic=archive.grid.plane is not None)):
            return both, _report(report, both, found)
    raise BoundError(
        "the archive's lattice is too coarse for this bound; allow a larger error, or compress all logs together"
    )


def check_goes_on(archive: Archive, tracks: Sequence[Track]) -> None:
    """Refuse tracks that would go on with, or as, one that has no times."""
    for track in tracks:
        if track.id in archive.ids and (not track.timed or track.id in archive.untimed):
            raise OptionError(
                f"track {track.id!r} is in the archive, and one of both has no times; give it another name"
            )


def _led_on(archive: Archive, track: Track, gap: float) -> Track:
    """A track that begins where the archive's walk of that name ends, unless there is a gap between them."""
    end, there = last_knot(archive, track.id)
    if track.times[0] - end > gap:
        return track
    after = int(np.searchsorted(track.times, end, side="right"))
    if track.times[0] < end_of(archive, track.id) - TIME_SLACK or after == len(track):
        raise overlapping(track.id)
    times, positions = (
        np.append(end, track.times[after:]),
        np.concatenate([there, track.positions[after:]]),
    )
    return Track(track.id, times, positions, plane=track.plane)


def last_knot(archive: Archive, name: str) -> tuple[float, NDArray[np.float64]]:
    """Time and place, shape (1, d), of the last knot of a track."""
    grid_walks, grid = archive.grid_walks, archive.grid
    walk = grid_walks.walks[archive.ids.index(name)]
    return float(knot_times(walk.time_steps[-1:], grid)[0]), node_positions(grid_walks, grid)[
        walk.nodes[-1:]
    ]


def overlapping(name: str) -> OptionError:
    """Error of a track that begins before the one in the archive ends."""
    return OptionError(
        f"track {name!r} overlaps in time with the one in the archive; give it another name, or append in order of time"
    )


def _report(report: Report, grown: Archive, found: ErrorSummary) -> Report:
    """What was done for the new tracks, and how large the archive has become."""
    road_map = grown.road_map
    return replace(
        report, points=found.points, rmse=found.rmse, max_error=found.max_error, bytes_out=len(grown.to_bytes()),
        nodes=len(road_map.nodes), edges=len(road_map.edges),
    )  # fmt: skip


def grown(
    archive: Archive,
    on_map: Archive,
    gap: float,
    sampling: float | None,
    extras: tuple[Section, ...],
) -> Archive:
    """Unite an archive with walks on it; between a walk and what it goes on with, at most ``gap`` seconds are no gap.

    ``extras`` are the further sections of the whole; ``sampling`` is about the seconds between samples of what was added.
    """
    refinements = on_map.contents.map.refinements if on_map.contents.map is not None else 0
    grid_walks = merge_grid_walks([refined(archive.grid_walks, refinements), on_map.grid_walks])
    most = gap / step_size(on_map.grid.time)
    walks = dict(zip(archive.ids, grid_walks.walks[: len(archive.ids)], strict=True))
    for name, walk in zip(on_map.ids, grid_walks.walks[len(archive.ids) :], strict=True):
        walks[name] = _gone_on(name, walks[name], walk, most) if name in walks else walk
    shapes = {*archive.untimed, *on_map.untimed}
    untimed = frozenset(number for number, name in enumerate(walks) if name in shapes)
    united = new_archive(
        on_map.grid,
        tuple(walks),
        number_by_visit(GridWalks(grid_walks.nodes, tuple(walks.values()), untimed=untimed)),
        layer=archive.contents.layer,
        extras=extras,
        spans=_spans_of_both(archive, on_map, tuple(walks)),
    )
    told = None if archive.sampling is None or sampling is None else max(archive.sampling, sampling)
    return with_sampling(
        with_error_bound(united, _weaker(archive.error_bound, on_map.error_bound)), told
    )


def _spans_of_both(
    archive: Archive, on_map: Archive, names: Sequence[str]
) -> list[NDArray[np.float64]]:
    """Seconds at which the pieces of each track begin and end, in the archive and on its map."""
    both: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
    for one in (archive, on_map):
        for name, spans in zip(one.ids, claimed(one), strict=True):
            both[name].append(spans)
    return [np.concatenate(both[name]) for name in names]


def completed(options: Options, archive: Archive) -> Options:
    """Options with the bound that the archive promises and the columns that it keeps, where they say nothing."""
    if options.sized:
        raise OptionError("a size can't be asked of what is appended; give rmse or max_error")
    if not options.bounded and archive.error_bound is not None:
        bound = archive.error_bound.metres
        options = (
            replace(options, max_error=bound)
            if archive.error_bound.maximum
            else replace(options, rmse=bound)
        )
        options = (
            options
            if archive.error_bound.max_error is None
            else replace(options, max_error=archive.error_bound.max_error)
        )
    if archive.kept_columns is None and (options.keep or options.keep_times):
        raise OptionError(
            "the archive keeps no columns, so that none can be appended; leave out keep"
        )
    return (
        options
        if archive.kept_columns is None
        else replace(options, keep=archive.kept_columns, keep_times=True)
    )


def _gone_on(name: str, before: GridWalk, after: GridWalk, most: float) -> GridWalk:
    """One walk that goes on with another, from the same cell or a later one."""
    last = int(before.time_steps[-1])
    if after.time_steps[0] < last:
        raise overlapping(name)
    same = int(after.time_steps[0] == last)
    silent = [] if same else [bool(after.time_steps[0] - last > most)]
    return GridWalk(
        np.concatenate([before.nodes, after.nodes[same:]]),
        np.concatenate([before.time_steps, after.time_steps[same:]]),
        np.concatenate([before.gaps, np.array(silent, bool), after.gaps]),
    )


def _weaker(one: ErrorBound | None, other: ErrorBound | None) -> ErrorBound | None:
    """What both keep; a maximum bounds the root mean square, too."""
    if one is None or other is None:
        return None
    larger = one if one.metres >= other.metres else other
    most = (
        None
        if one.max_error is None or other.max_error is None
        else max(one, other, key=lambda error_bound: error_bound.max_error or 0.0)
    )
    both = (0, 0) if most is None else (most.max_digits, most.max_exponent)
    return replace(
        larger, maximum=one.maximum and other.maximum, max_digits=both[0], max_exponent=both[1]
    )


def _united_extras(
    archive: Archive, tracks: Sequence[Track], added: Sequence[str]
) -> tuple[Section, ...]:
    """Sections of an archive, its kept columns with those of further tracks."""
    ids = tuple(dict.fromkeys([*archive.ids, *added]))
    others = tuple(
        section for section in archive.contents.extras if section.kind != SectionKind.ATTRIBUTES
    )
    if archive.kept_columns is None:
        return others
    number = {name: i for i, name in enumerate(ids)}
    rows = [
        (number[name], archive.sample_times(name), archive.attributes(name)) for name in archive.ids
    ]
    rows += [(number[track.id], track.times, track.attributes) for track in tracks]
    # a stable sort keeps what was there before what goes on
    rows.sort(key=lambda row: row[0])
    counts = np.bincount(
        [owner for owner, _, _ in rows], [len(times) for _, times, _ in rows], len(ids)
    ).astype(int)
    columns = {
        name: np.concatenate([values[name] for _, _, values in rows])
        for name in archive.kept_columns
    }
    body = encode_attributes(
        KeptColumns(
            tuple(counts.tolist()), np.concatenate([times for _, times, _ in rows]), columns
        )
    )
    return (*others, Section(SectionKind.ATTRIBUTES, body))
