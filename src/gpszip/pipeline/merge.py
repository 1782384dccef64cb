"""Merging archives on one map, without their logs (thesis, 2.4 and figure 8-6)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, open_archive, with_error_bound, with_sampling
from gpszip.codec.numbering import number_by_visit
from gpszip.errors import BoundError, OptionError
from gpszip.merging.deviation import measure_deviation, natural_sort_key
from gpszip.merging.search import DeviationLimit, MergedMap, merge_archives
from gpszip.model import Listener, Progress
from gpszip.model.error_bound import ErrorBound, extended_bound
from gpszip.model.grid import step_size
from gpszip.model.merge_options import MergeOptions
from gpszip.model.merge_report import Deviation, MergeReport
from gpszip.pipeline.continue_tracks import piece_time_ranges_of
from gpszip.pipeline.merge_columns import merge_columns, merge_curves
from gpszip.pipeline.merge_sources import (
    MergeSource,
    curves_of_archives,
    on_common_plane,
    read_sources,
    sampling_of,
)
from gpszip.run.executor import Executor
from gpszip.walks.shapes import assign_times_by_distance, drop_time_steps

__all__ = ["MergePlan", "merge", "plan_merge"]

#: Multiple of the limit by which tracks may be moved in any number of merges.
_TOTAL_LIMITS = 4.0

#: Share of the limit that a merge may use at least, however far earlier ones have moved tracks.
_MIN_LIMIT_SHARE = 0.5

#: Shares of the limit that are tried where there are shapes: what moves them changes their
#: lengths, and so the positions at equal shares of the length.
_SHAPE_SHARES = (1.0, 0.6, 0.3, 0.1)

#: Relative excess up to which a limit counts as held: the rounding of the measurement.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class MergePlan:
    """How far a merge may move tracks, and what it would state.

    Parameters
    ----------
    limit : float
        Metres by which tracks may be moved.
    maximum : bool
        Whether that holds at any time, rather than for the root mean square.
    bound : float or None
        Metres of the error bound afterwards, at most; None if an archive states none, or if it
        can't be told before.
    bound_is_maximum : bool
        Whether that bound holds for every sample.
    notes : tuple of str
        What the user should know.
    """

    limit: float
    maximum: bool
    bound: float | None
    bound_is_maximum: bool
    notes: tuple[str, ...]


def plan_merge(
    archives: Sequence[Archive],
    options: MergeOptions | None = None,
    *,
    names: Sequence[str] | None = None,
) -> MergePlan:
    """Say how far a merge may move tracks, and what it would state.

    Parameters and exceptions are those of :func:`merge`.
    """
    # What is allowed, and whether tracks can be joined at all.
    names = [str(number) for number in range(1, len(archives) + 1)] if names is None else names
    options = options or MergeOptions()
    _check(archives, names)
    limit, notes = _limit(archives, names, options)
    read_sources(archives, names, options, range(len(archives)))

    # Only a limit of the maximum adds to bounds of the maximum.
    bounds = [archive.error_bound for archive in archives if archive.error_bound is not None]
    maximum = len(bounds) == len(archives) and all(bound.maximum for bound in bounds)
    known = len(bounds) == len(archives) and (limit.maximum or not maximum)
    largest = max((bound.metres for bound in bounds), default=0.0) + limit.metres
    return MergePlan(limit.metres, limit.maximum, largest if known else None, maximum, notes)


def merge(
    archives: Sequence[Archive],
    options: MergeOptions | None = None,
    *,
    names: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, MergeReport]:
    """Merge archives on one map, without their logs.

    1. Check that the archives go together, and how far their tracks may be moved.
    2. Read their tracks as curves on one plane.
    3. Search a map, and walks on it, that stay within the limit.
    4. Write the archive, read it back and measure how far each archive's tracks were moved.

    Parameters
    ----------
    archives : sequence of Archive
        Two or more, all in degrees or all on one plane of x and y.
    options : MergeOptions, optional
        How far tracks may be moved, and what becomes of tracks of one id.
    names : sequence of str, optional
        What messages and prefixes call the archives; by default their numbers from 1.
    executor, progress : optional
        As for :func:`gpszip.pipeline.compress.compress`.

    Returns
    -------
    Archive
        With the tracks of all archives, in the order of their starts or of their ids, whichever
        takes fewer bytes.
    MergeReport
        How far each archive's tracks were moved is measured on the bytes.

    Raises
    ------
    OptionError
        If archives don't go together.
    BoundError
        If tracks would be moved farther than they may.
    """
    from gpszip.run import resolve_executor

    # Take the time of the whole call; archives without names are called by number.
    start = time.perf_counter()
    options = options or MergeOptions()
    names = [str(number) for number in range(1, len(archives) + 1)] if names is None else names

    # What goes together, and how far tracks may be moved.
    _check(archives, names)
    limit, notes = _limit(archives, names, options)

    # Curves on one plane, the largest archive first.
    order = _largest_first(archives)
    sources = on_common_plane(read_sources(archives, names, options, order), limit)
    limit_shares = [_limit_share(source.archive, limit) for source in sources]
    curves = curves_of_archives(sources, limit_shares)

    # One map; for shapes with less and less of the limit.
    untimed = any(source.untimed for source in sources)
    report = _reporter(progress)
    report(0, 1)
    for share in _SHAPE_SHARES if untimed else _SHAPE_SHARES[:1]:
        merged = merge_archives(
            curves,
            replace(limit, metres=share * limit.metres),
            executor=resolve_executor(executor),
            progress=report,
        )
        if merged is None:
            continue
        archive, column_notes = _smallest_order(merged, sources, _common_layer(archives))
        moved = _measure(sources, archive)
        excess = limit.excess(moved) / [each.limit_share for each in curves]
        if len(curves) == 1 or (excess <= 1 + _ROUNDING).all():
            break
    else:
        raise BoundError(
            f"a deviation of {limit.metres:g} m can't be held", remedy="allow a larger one"
        )

    # What the archive states, and the deviations in the order of the archives.
    archive = with_error_bound(archive, _error_bound(sources, moved))
    archive = with_sampling(archive, sampling_of(archives))
    deviations = tuple(moved[order.index(number)] for number in range(len(order)))
    seconds = time.perf_counter() - start
    return archive, _report(archives, archive, limit, deviations, seconds, (*notes, *column_notes))


def _reporter(progress: Listener | None) -> Callable[[int, int], None]:
    """Return a function that tells the listener how many steps are done."""

    def report(done: int, steps: int) -> None:
        if progress is not None:
            progress(Progress("merge", done / steps))

    return report


def _check(archives: Sequence[Archive], names: Sequence[str]) -> None:
    """Refuse archives that don't go together, by name."""
    # Refuse a single archive, which has nothing to be merged with.
    if len(archives) < 2:
        raise OptionError("one archive alone can't be merged", remedy="name two or more")

    # Check each archive by itself, and its coordinates against those of the first.
    first = archives[0]
    for name, archive in zip(names, archives, strict=True):
        # Tracks on a map of their own.
        if not archive.ids:
            raise OptionError("holds no tracks", path=name, remedy="leave it out")
        if archive.contents.map is not None:
            raise OptionError(
                "lies on a map kept elsewhere",
                path=name,
                remedy="merge archives that hold their own maps",
            )

        # Coordinates like those of the first.
        if (archive.grid.plane is None) != (first.grid.plane is None):
            both = (name, names[0]) if archive.grid.plane is None else (names[0], name)
            raise OptionError(
                f"{both[0]} is in x and y, {both[1]} in latitude and longitude: "
                "where the one lies on the other is not known"
            )
        if archive.grid.dimension != first.grid.dimension:
            raise OptionError(
                f"{name} has {archive.grid.dimension} coordinates, {names[0]} "
                f"{first.grid.dimension}",
                remedy="merge them apart",
            )


def _limit(
    archives: Sequence[Archive], names: Sequence[str], options: MergeOptions
) -> tuple[DeviationLimit, tuple[str, ...]]:
    """The limit asked for, or the least bound that any archive stated before its first merge."""
    # Take what the user gave: a maximum, or else an RMSE.
    given = options.max_deviation or options.deviation
    if given is not None:
        return DeviationLimit(given, options.max_deviation is not None), ()

    # Else allow the least bound in metres, a maximum where any is one. Archives that state none
    # are taken to be as exact as the step of their grid.
    bounds = [archive.error_bound for archive in archives]
    metres = min(
        step_size(archive.grid.space) if bound is None else bound.before
        for archive, bound in zip(archives, bounds, strict=True)
    )
    unbounded = [name for name, bound in zip(names, bounds, strict=True) if bound is None]
    notes: tuple[str, ...] = ()
    if unbounded:
        listed = ", ".join(unbounded)
        notes = (f"{listed} states no error bound: the step of its grid is allowed as deviation",)
    maximum = any(bound is not None and bound.maximum for bound in bounds)
    return DeviationLimit(metres, maximum), notes


def _limit_share(archive: Archive, limit: DeviationLimit) -> float:
    """Share of the limit by which tracks may be moved: less where earlier merges moved them."""
    bound = archive.error_bound
    moved = 0.0 if bound is None else bound.metres - bound.before
    return max(1 - moved / (_TOTAL_LIMITS * limit.metres), _MIN_LIMIT_SHARE)


def _largest_first(archives: Sequence[Archive]) -> list[int]:
    """Numbers of the archives in an order that doesn't depend on how they were given."""
    knots = [sum(len(walk.nodes) for walk in archive.grid_walks.walks) for archive in archives]
    return sorted(range(len(archives)), key=lambda i: (-knots[i], archives[i].to_bytes()))


def _common_layer(archives: Sequence[Archive]) -> str | None:
    layers = {archive.contents.layer for archive in archives}
    return layers.pop() if len(layers) == 1 else None


def _smallest_order(
    merged: MergedMap, sources: Sequence[MergeSource], layer: str | None
) -> tuple[Archive, tuple[str, ...]]:
    """The smaller archive of two: tracks in the order of their starts, or of their ids."""
    by_start = list(range(len(merged.ids)))
    by_id = sorted(by_start, key=lambda i: natural_sort_key(merged.ids[i]))
    orders = [by_start] if by_id == by_start else [by_start, by_id]
    built = [_build_archive(merged, order, sources, layer) for order in orders]
    return min(built, key=lambda result: len(result[0].to_bytes()))


def _build_archive(
    merged: MergedMap, order: Sequence[int], sources: Sequence[MergeSource], layer: str | None
) -> tuple[Archive, tuple[str, ...]]:
    """The archive with its tracks in an order, and notes on its columns."""
    ids = [merged.ids[i] for i in order]
    walks = tuple(merged.grid_walks.walks[i] for i in order)
    grid_walks = number_by_visit(replace(merged.grid_walks, walks=walks))

    # Shapes lose the times that they were given.
    without_times = frozenset[str]().union(*(source.untimed for source in sources))
    untimed = frozenset(number for number, id in enumerate(ids) if id in without_times)
    grid_walks = drop_time_steps(grid_walks, untimed, others=len(untimed) < len(ids))

    columns, notes = merge_columns(sources, ids)
    curves, curve_notes = merge_curves(sources, ids)
    archive = new_archive(
        merged.grid,
        ids,
        grid_walks,
        layer=layer,
        extras=(*columns, *curves),
        time_ranges=_time_ranges(sources, ids),
    )
    return archive, (*notes, *curve_notes)


def _time_ranges(sources: Sequence[MergeSource], ids: Sequence[str]) -> list[NDArray[np.float64]]:
    """Times at which the pieces of each track begin and end, in order."""
    ranges: dict[str, list[NDArray[np.float64]]] = {id: [] for id in ids}
    for source in sources:
        for id, pieces in zip(source.ids, piece_time_ranges_of(source.archive), strict=True):
            ranges[id].append(pieces)
    joined = [np.concatenate(ranges[id]) for id in ids]
    return [pieces[np.argsort(pieces[:, 0], kind="stable")] for pieces in joined]


def _measure(sources: Sequence[MergeSource], archive: Archive) -> tuple[Deviation, ...]:
    """How far each archive's curves were moved, by what the bytes decode to.

    Curves are compared from knot to knot, whether travel is claimed there or not; shapes at equal
    shares of their lengths.
    """
    decoded = open_archive(archive.to_bytes())
    nodes = decoded.road_map.nodes
    walks = {walk.id: replace(walk, time_ranges=None) for walk in decoded.walks}
    for source in sources:
        for id, curve in zip(source.ids, source.curves, strict=True):
            if id in source.untimed:
                first, last = float(curve.track.times[0]), float(curve.track.times[-1])
                walks[id] = assign_times_by_distance(walks[id], nodes, first, last)
    return tuple(
        measure_deviation(source.curves, [walks[id] for id in source.ids], nodes, source.at_knots)
        for source in sources
    )


def _error_bound(sources: Sequence[MergeSource], moved: Sequence[Deviation]) -> ErrorBound | None:
    """The largest sum of what an archive stated and how far its tracks were moved.

    The least that any archive stated before its first merge is kept beside it. None unless all
    archives state a bound.
    """
    bounds = [
        source.archive.error_bound for source in sources if source.archive.error_bound is not None
    ]
    if len(bounds) < len(sources):
        return None
    maximum = all(bound.maximum for bound in bounds)
    total = 0.0
    for source, bound, deviation in zip(sources, bounds, moved, strict=True):
        added = deviation.maximum if maximum else deviation.rms
        total = max(total, bound.metres * source.scale + source.bend + added)
    return extended_bound(min(bound.before for bound in bounds), total, maximum=maximum)


def _report(
    archives: Sequence[Archive],
    merged: Archive,
    limit: DeviationLimit,
    deviations: tuple[Deviation, ...],
    seconds: float,
    notes: tuple[str, ...],
) -> MergeReport:
    """Summarise what was merged, and how far tracks were moved."""
    # Sizes; a merge may save nothing.
    bytes_in = sum(len(archive.to_bytes()) for archive in archives)
    bytes_out = len(merged.to_bytes())
    if bytes_out >= bytes_in:
        apart = "the archives apart take no more bytes; allow a larger deviation for fewer"
        notes = (*notes, apart)

    # Nodes and edges before and after.
    return MergeReport(
        archives=len(archives),
        tracks=len(merged.ids),
        segments=sum(len(walk.gaps) for walk in merged.grid_walks.walks),
        nodes=len(merged.road_map.nodes),
        edges=len(merged.road_map.edges),
        nodes_in=sum(len(archive.road_map.nodes) for archive in archives),
        edges_in=sum(len(archive.road_map.edges) for archive in archives),
        bytes_in=bytes_in,
        bytes_out=bytes_out,
        limit=limit.metres,
        limits_maximum=limit.maximum,
        deviations=deviations,
        seconds=seconds,
        notes=notes,
    )
