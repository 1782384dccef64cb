"""Merging archives: what fits together, which tracks are the same, and what the result promises (thesis, 2.4, figure 8-6)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, open_archive, with_error_bound, with_sampling
from gpszip.codec.walks import number_by_visit
from gpszip.container.attributes import KeptColumns, encode_attributes, read_attributes
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.errors import BoundError, OptionError
from gpszip.merging.deviation import (
    Curve,
    build_curve,
    measure_deviation,
    natural_sort_key,
    share_at_knots,
    split_at_gaps,
)
from gpszip.merging.search import ArchiveCurves, DeviationLimit, MergedMap, merge_archives
from gpszip.model import Listener, Plane, Progress, QuantisationGrid, Track, Walk
from gpszip.model.error_bound import ErrorBound, extended_bound
from gpszip.model.grid import step_size
from gpszip.model.merge_options import MergeOptions
from gpszip.model.merge_report import Deviation, MergeReport
from gpszip.pipeline.continue_tracks import claimed
from gpszip.run.executor import Executor
from gpszip.walks.shapes import assign_times_by_distance, drop_time_steps

__all__ = ["merge"]

#: Space steps that tracks of usual speed go in a cell.
_STEPS_IN_A_CELL = 2.0

#: A line on one plane that is laid on another may bend by this share of the deviation allowed.
_BEND = 0.02

#: Limits that tracks may be moved by in any number of merges; each takes as large a share of one as is left of those, at least this.
_IN_ALL, _LEAST_ROOM = 4.0, 0.5

#: Shares of the limit that are tried where there are shapes: what moves them changes their ways, and so what lies at equal shares.
_SHAPE_SHARES = (1.0, 0.6, 0.3, 0.1)

#: Seconds between tracks that are joined where their ends were rounded over each other.
_SEAM = 5e-4

#: What was measured again may differ by so little.
_ROUNDING = 1e-6


#: What to do about tracks of one name.
_SAME_ID = "--same-id prefix keeps both apart, --same-id join makes them one (same_id in Python)"


@dataclass(frozen=True, eq=False)
class _Source:
    """One archive on the common plane."""

    name: str
    archive: Archive
    ids: tuple[str, ...]
    curves: tuple[Curve, ...]
    stretch: float = 1.0
    bend: float = 0.0

    @property
    def untimed(self) -> frozenset[str]:
        """Names of the tracks that have no times."""
        own = set(self.archive.untimed)
        return frozenset(
            name for name, before in zip(self.ids, self.archive.ids, strict=True) if before in own
        )

    @property
    def at_knots(self) -> float:
        return share_at_knots(self.curves, self.archive.sampling)


def merge(
    archives: Sequence[Archive],
    options: MergeOptions | None = None,
    *,
    names: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, MergeReport]:
    """Unite archives on one map, without their logs (thesis, 2.4).

    Parameters
    ----------
    archives : sequence of Archive
        Two or more, all in degrees or all on one plane of x and y.
    options : MergeOptions, optional
        How far tracks may be moved, and what becomes of those of one name.
    names : sequence of str, optional
        What messages and prefixes call the archives; by default they are numbered from 1.
    executor, progress : optional
        As for :func:`gpszip.pipeline.compress.compress`.

    Returns
    -------
    Archive
        With the tracks of all archives, in the order of their starts or of their names, whichever takes fewer bytes.
    MergeReport
        What was done; how far each archive's tracks were moved is measured on the bytes.

    Raises
    ------
    OptionError
        If archives don't go together.
    BoundError
        If tracks would be moved farther than they may.
    """
    from gpszip.run import resolve_executor

    start = time.perf_counter()
    options = options or MergeOptions()
    names = [str(number) for number in range(1, len(archives) + 1)] if names is None else names
    executor = resolve_executor(executor)
    _check(archives, names)
    limit, notes = _limit(archives, names, options)
    turn = _turn(archives)
    sources = _on_one_plane(_sources(archives, names, options, turn), limit)
    frames = [_frame_on(source) for source in sources]
    parts = [
        replace(
            _part(source.curves, grid, source.archive.sampling),
            limit_share=_room(source.archive, limit),
        )
        for source, grid in zip(sources, frames, strict=True)
    ]
    if len({name for source in sources for name in source.ids}) < sum(
        len(source.ids) for source in sources
    ):
        parts = [
            replace(_joined(sources, frames), limit_share=min(part.limit_share for part in parts))
        ]

    def tell(done: int, whole: int) -> None:
        if progress is not None:
            progress(Progress("merge", done / whole))

    layers = {archive.contents.layer for archive in archives}
    layer = layers.pop() if len(layers) == 1 else None
    untimed = any(source.untimed for source in sources)
    for share in _SHAPE_SHARES if untimed else (1.0,):
        merged = merge_archives(
            parts, replace(limit, metres=share * limit.metres), executor=executor, progress=tell
        )
        if merged is None:
            continue
        made, more = _smaller(merged, sources, layer)
        moved = _measured(sources, made)
        if (
            len(parts) == 1
            or (limit.excess(moved) / [part.limit_share for part in parts] <= 1 + _ROUNDING).all()
        ):
            break
    else:
        raise BoundError(f"a deviation of {limit.metres:g} m can't be held; allow a larger one")
    made = with_sampling(with_error_bound(made, _error_bound(sources, moved)), _step(archives))
    as_given = tuple(moved[turn.index(number)] for number in range(len(turn)))
    return made, _report(
        archives, made, limit, as_given, time.perf_counter() - start, (*notes, *more)
    )


def _room(archive: Archive, limit: DeviationLimit) -> float:
    """Share of the limit by which an archive's tracks may be moved: less where earlier merges have moved them."""
    moved = (
        0.0
        if archive.error_bound is None
        else archive.error_bound.metres - archive.error_bound.before
    )
    return max(1 - moved / (_IN_ALL * limit.metres), _LEAST_ROOM)


def _step(archives: Sequence[Archive]) -> float | None:
    """Seconds between two samples of the log that has the fewest, if that is known of all."""
    steps = [archive.sampling for archive in archives if archive.sampling is not None]
    return max(steps) if len(steps) == len(archives) else None


def _turn(archives: Sequence[Archive]) -> list[int]:
    """Numbers of the archives, the largest first, in an order that does not depend on how they were given."""
    return sorted(
        range(len(archives)),
        key=lambda i: (
            -sum(len(walk.nodes) for walk in archives[i].grid_walks.walks),
            archives[i].to_bytes(),
        ),
    )


def _smaller(
    merged: MergedMap, sources: Sequence[_Source], layer: str | None
) -> tuple[Archive, tuple[str, ...]]:
    """The archive with its tracks in the order of their starts, or in that of their names if that takes fewer bytes; and remarks."""
    by_name = sorted(range(len(merged.ids)), key=lambda i: natural_sort_key(merged.ids[i]))
    orders = [
        list(range(len(merged.ids))),
        *([by_name] if by_name != list(range(len(by_name))) else []),
    ]
    made = [_in_order(merged, order, sources, layer) for order in orders]
    return min(made, key=lambda one: len(one[0].to_bytes()))


def _in_order(
    merged: MergedMap, order: Sequence[int], sources: Sequence[_Source], layer: str | None
) -> tuple[Archive, tuple[str, ...]]:
    ids = [merged.ids[i] for i in order]
    walks = number_by_visit(
        replace(merged.grid_walks, walks=tuple(merged.grid_walks.walks[i] for i in order))
    )
    names = frozenset[str]().union(*(source.untimed for source in sources))
    untimed = frozenset(number for number, name in enumerate(ids) if name in names)
    walks = drop_time_steps(walks, untimed, others=len(untimed) < len(ids))
    extras, remarks = _kept(sources, ids)
    return new_archive(
        merged.grid, ids, walks, layer=layer, extras=extras, spans=_spans(sources, ids)
    ), remarks


def _spans(sources: Sequence[_Source], ids: Sequence[str]) -> list[NDArray[np.float64]]:
    """Seconds at which the pieces of each track begin and end, in the order of time."""
    runs: dict[str, list[NDArray[np.float64]]] = {name: [] for name in ids}
    for source in sources:
        for name, spans in zip(source.ids, claimed(source.archive), strict=True):
            runs[name].append(spans)
    whole = (np.concatenate(runs[name]) for name in ids)
    return [spans[np.argsort(spans[:, 0], kind="stable")] for spans in whole]


def _check(archives: Sequence[Archive], names: Sequence[str]) -> None:
    """Refuse what doesn't go together, by name."""
    if len(archives) < 2:
        raise OptionError("one archive alone can't be merged; name two or more")
    first = archives[0]
    for name, archive in zip(names, archives, strict=True):
        if not archive.ids:
            raise OptionError(f"{name}: holds no tracks; leave it out")
        if archive.contents.map is not None:
            raise OptionError(
                f"{name}: lies on a map kept elsewhere; merge archives that hold their own maps"
            )
        if (archive.grid.plane is None) != (first.grid.plane is None):
            flat, round_ = (name, names[0]) if archive.grid.plane is None else (names[0], name)
            raise OptionError(
                f"{flat} is in x and y, {round_} in latitude and longitude: where the one lies on the other is not known"
            )
        if archive.grid.dimension != first.grid.dimension:
            raise OptionError(
                f"{name} has {archive.grid.dimension} coordinates, {names[0]} {first.grid.dimension}; merge them apart"
            )


def _limit(
    archives: Sequence[Archive], names: Sequence[str], options: MergeOptions
) -> tuple[DeviationLimit, tuple[str, ...]]:
    """What is asked for, or the least that any archive promised before any merge."""
    given = options.max_deviation or options.deviation
    if given is not None:
        return DeviationLimit(given, options.max_deviation is not None), ()
    silent = [
        name for name, archive in zip(names, archives, strict=True) if archive.error_bound is None
    ]
    metres = min(
        step_size(one.grid.space) if one.error_bound is None else one.error_bound.before
        for one in archives
    )
    notes = (
        (f"{', '.join(silent)} promised nothing: the step of the lattice was allowed as deviation",)
        if silent
        else ()
    )
    return DeviationLimit(
        metres, any(one.error_bound is not None and one.error_bound.maximum for one in archives)
    ), notes


def _sources(
    archives: Sequence[Archive], names: Sequence[str], options: MergeOptions, turn: Sequence[int]
) -> list[_Source]:
    """Curves of all archives, in turn, with the names that their tracks get."""
    sources, seen = [], dict[str, str]()
    for name, archive in zip(names, archives, strict=True):
        ids = (
            tuple(f"{name}:{one}" for one in archive.ids)
            if options.same_id == "prefix"
            else archive.ids
        )
        for one in ids:
            if one in seen and options.same_id != "join":
                cure = "name the archives differently" if options.same_id == "prefix" else _SAME_ID
                raise OptionError(f"track {one!r} is in {seen[one]} and in {name}; {cure}")
            seen.setdefault(one, name)
        nodes = archive.road_map.nodes
        walks = (_timed(walk, nodes, archive.grid) for walk in archive.walks)
        curves = tuple(
            build_curve(replace(walk, id=one), nodes) for one, walk in zip(ids, walks, strict=True)
        )
        sources.append(_Source(name, archive, ids, curves))
    return [sources[i] for i in turn]


def _timed(walk: Walk, nodes: NDArray[np.float64], grid: QuantisationGrid) -> Walk:
    """A walk with times; that of a shape goes at the speed that suits the steps of the frame."""
    if walk.times is not None:
        return walk
    way = float(np.sqrt((np.diff(nodes[walk.nodes], axis=0) ** 2).sum(axis=1)).sum())
    start, speed = (
        grid.epoch / 1000,
        _STEPS_IN_A_CELL * step_size(grid.space) / step_size(grid.time),
    )
    return assign_times_by_distance(walk, nodes, start, start + way / speed)


def _on_one_plane(sources: list[_Source], limit: DeviationLimit) -> list[_Source]:
    """The same curves on planes that all archives share."""
    planes = [source.archive.grid.plane for source in sources]
    if len(set(planes)) == 1:
        return sources
    from gpszip.geo.common_plane import max_scale_factor, to_common_plane

    known = [plane for plane in planes if plane is not None]
    sources = [
        replace(source, curves=tuple(_halved(curve, limit) for curve in source.curves))
        for source in sources
    ]
    starts = [_starts(source.curves) for source in sources]
    shared, laid, moved = to_common_plane(known, [_positions(source) for source in sources], starts)
    return [
        replace(
            source,
            curves=_placed(source.curves, positions, shared),
            stretch=max_scale_factor(positions[rows], shared) if rows.any() else 1.0,
            bend=_BEND * limit.metres if rows.any() else 0.0,
        )
        for source, positions, rows in zip(sources, laid, moved, strict=True)
    ]


def _halved(curve: Curve, limit: DeviationLimit) -> Curve:
    """Cut long parts, so that none bends by more than is tolerated where it is laid on another plane."""
    # on transverse Mercator planes within reach, a line of length l bends by less than l^2 / (60 R)
    longest = (60 * 6.371e6 * _BEND * limit.metres) ** 0.5
    way = np.linalg.norm(np.diff(curve.track.positions, axis=0), axis=1)
    pieces = np.where(curve.gaps, 1, np.ceil(way / longest)).astype(np.int64)
    if (pieces <= 1).all():
        return curve
    knots = np.arange(len(curve.track))
    shares = [
        first + np.arange(count) / count
        for first, count in enumerate(np.maximum(pieces, 1).tolist())
    ]
    at = np.append(np.concatenate(shares), knots[-1])
    positions = np.stack([np.interp(at, knots, axis) for axis in curve.track.positions.T], axis=1)
    times = np.interp(at, knots, curve.track.times)
    kept = np.append(True, np.diff(times) > 0)
    gaps = curve.gaps[at[:-1].astype(np.int64)]
    return Curve(Track(curve.track.id, times[kept], positions[kept]), gaps[kept[1:]])


def _starts(curves: Sequence[Curve]) -> NDArray[np.int64]:
    bounds = np.cumsum([0] + [len(curve.track) for curve in curves])
    return np.array(
        [
            bound + first
            for curve, bound in zip(curves, bounds, strict=False)
            for first, _ in split_at_gaps(curve.gaps)
        ]
    )


def _positions(source: _Source) -> NDArray[np.float64]:
    return np.concatenate([curve.track.positions for curve in source.curves])


def _placed(
    curves: Sequence[Curve], positions: NDArray[np.float64], plane: Plane
) -> tuple[Curve, ...]:
    bounds = np.cumsum([0] + [len(curve.track) for curve in curves]).tolist()
    return tuple(
        Curve(
            Track(
                curve.track.id,
                curve.track.times,
                positions[first : first + len(curve.track)],
                plane=plane,
            ),
            curve.gaps,
        )
        for curve, first in zip(curves, bounds, strict=False)
    )


def _frame_on(source: _Source) -> QuantisationGrid:
    """The archive's lattice; on other planes, one through its first knot."""
    grid, plane = source.archive.grid, source.curves[0].track.plane
    if plane is None or grid.plane == plane:
        return grid
    origin = tuple(1000 * int(np.floor(x)) for x in source.curves[0].track.positions[0])
    return replace(grid, origin=origin, plane=plane)


def _part(curves: Sequence[Curve], grid: QuantisationGrid, step: float | None) -> ArchiveCurves:
    places = np.concatenate([curve.track.positions for curve in curves])
    nodes, visits = np.unique(places, axis=0, return_inverse=True)
    cuts = np.cumsum([len(curve.track) for curve in curves])[:-1]
    return ArchiveCurves(
        tuple(curves), nodes, tuple(np.split(visits.reshape(-1).astype(np.int32), cuts)), grid, step
    )


def _joined(sources: Sequence[_Source], frames: Sequence[QuantisationGrid]) -> ArchiveCurves:
    """All curves as one part, those of one name as one curve."""
    curves = dict[str, list[tuple[Curve, _Source]]]()
    for source in sources:
        for name, curve in zip(source.ids, source.curves, strict=True):
            curves.setdefault(name, []).append((curve, source))
    largest = max(
        range(len(sources)), key=lambda i: sum(len(curve.track) for curve in sources[i].curves)
    )
    return _part(
        [_chain(name, pairs) for name, pairs in curves.items()],
        frames[largest],
        _step([source.archive for source in sources]),
    )


def _chain(name: str, pairs: list[tuple[Curve, _Source]]) -> Curve:
    """Join the curves of one agent, in the order of time, with gaps between them."""
    if len(pairs) > 1 and any(name in source.untimed for _, source in pairs):
        raise OptionError(
            f"track {name!r} has no times, so that nobody knows how it goes on; --same-id prefix keeps both apart (same_id in Python)"
        )
    pairs = sorted(pairs, key=lambda pair: float(pair[0].track.times[0]))
    whole, source = pairs[0]
    for later, other in pairs[1:]:
        curve = later
        ends, begins = float(whole.track.times[-1]), float(curve.track.times[0])
        blur = step_size(source.archive.grid.time) + step_size(other.archive.grid.time)
        if ends - begins > blur:
            raise OptionError(
                f"track {name!r} is in {source.name} until {ends:.3f} s and in {other.name} from {begins:.3f} s: "
                "one agent can't be at two places; --same-id prefix keeps both apart (in Python: same_id)"
            )
        if ends >= begins:
            seam = (ends + begins) / 2
            whole, curve = (
                _cut(whole, float(whole.track.times[0]), seam),
                _cut(curve, seam + _SEAM, float(curve.track.times[-1])),
            )
        times = np.concatenate([whole.track.times, curve.track.times])
        positions = np.concatenate([whole.track.positions, curve.track.positions])
        gaps = np.concatenate([whole.gaps, [True], curve.gaps])
        whole, source = Curve(Track(name, times, positions, plane=whole.track.plane), gaps), other
    return whole


def _cut(curve: Curve, first: float, last: float) -> Curve:
    """The part of a curve between two instants, which it covers."""
    times = curve.track.times
    inside = times[(times > first) & (times < last)]
    when = np.unique(
        np.concatenate([[max(first, float(times[0]))], inside, [min(last, float(times[-1]))]])
    )
    positions = np.stack([np.interp(when, times, axis) for axis in curve.track.positions.T], axis=1)
    part = np.clip(
        np.searchsorted(times, (when[1:] + when[:-1]) / 2) - 1, 0, max(len(curve.gaps) - 1, 0)
    )
    gaps = curve.gaps[part] if len(curve.gaps) else np.zeros(len(part), np.bool_)
    return Curve(Track(curve.track.id, when, positions, plane=curve.track.plane), gaps)


def _measured(sources: Sequence[_Source], made: Archive) -> tuple[Deviation, ...]:
    """How far each archive's curves were moved, by what the bytes decode to."""
    back = open_archive(made.to_bytes())
    nodes = back.road_map.nodes
    # curves are compared from knot to knot, whatever of them is claimed; shapes at equal shares of the way
    walks = {walk.id: replace(walk, spans=None) for walk in back.walks}
    for source in sources:
        for name, curve in zip(source.ids, source.curves, strict=True):
            if name in source.untimed:
                walks[name] = assign_times_by_distance(
                    walks[name], nodes, float(curve.track.times[0]), float(curve.track.times[-1])
                )
    return tuple(
        measure_deviation(one.curves, [walks[name] for name in one.ids], nodes, one.at_knots)
        for one in sources
    )


def _error_bound(sources: Sequence[_Source], moved: Sequence[Deviation]) -> ErrorBound | None:
    """The sum of what was promised and of what was added, for the archive for which it is most, beside the least that was at first."""
    promises = [source.archive.error_bound for source in sources]
    maximum = all(error_bound is not None and error_bound.maximum for error_bound in promises)
    total = 0.0
    for source, error_bound, one in zip(sources, promises, moved, strict=True):
        if error_bound is None:
            return None
        total = max(
            total,
            error_bound.metres * source.stretch
            + source.bend
            + (one.maximum if maximum else one.rms),
        )
    return extended_bound(
        min(error_bound.before for error_bound in promises if error_bound is not None),
        total,
        maximum=maximum,
    )


def _kept(
    sources: Sequence[_Source], order: Sequence[str]
) -> tuple[tuple[Section, ...], tuple[str, ...]]:
    """Times of samples and columns of all archives; where some keep none, of no use to their tracks."""
    bodies = [
        [
            extra.body
            for extra in source.archive.contents.extras
            if extra.kind == SectionKind.ATTRIBUTES
        ]
        for source in sources
    ]
    if not any(bodies):
        return (), ()
    tables = [
        read_attributes(bytes(body[0]), len(source.ids))
        if body
        else KeptColumns((0,) * len(source.ids), np.zeros(0))
        for source, body in zip(sources, bodies, strict=True)
    ]
    names = list(dict.fromkeys(name for table in tables for name in table.columns))
    rows: dict[str, list[tuple[float, KeptColumns, slice]]] = {name: [] for name in order}
    for source, table in zip(sources, tables, strict=True):
        for number, name in enumerate(source.ids):
            where = table.rows(number)
            if where.stop > where.start:
                rows[name].append((float(table.times[where.start]), table, where))
    chosen = [
        (table, where)
        for name in order
        for _, table, where in sorted(rows[name], key=lambda row: row[0])
    ]
    counts = tuple(sum(where.stop - where.start for _, _, where in rows[name]) for name in order)
    times = (
        np.concatenate([table.times[where] for table, where in chosen]) if chosen else np.zeros(0)
    )
    columns = {
        name: np.concatenate([_column(table, name, where, tables) for table, where in chosen])
        for name in names
    }
    partial = sorted({name for name in names for table in tables if name not in table.columns})
    notes = (
        [f"only some archives keep {', '.join(partial)}: the others' samples have none"]
        if partial
        else []
    )
    notes += [] if all(bodies) else ["only some archives keep the times of samples"]
    return (
        Section(SectionKind.ATTRIBUTES, encode_attributes(KeptColumns(counts, times, columns))),
    ), tuple(notes)


def _column(
    table: KeptColumns, name: str, rows: slice, tables: Sequence[KeptColumns]
) -> NDArray[np.generic]:
    """Some rows of a column, as numbers with holes, or as texts, if the archives differ."""
    kinds = {
        one.columns[name].dtype.kind if name in one.columns else "-"
        for one in tables
        if len(one.times)
    }
    if kinds & set("OSU"):
        if kinds & set("biuf"):
            raise OptionError(
                f"column {name!r} holds texts in one archive and numbers in another; compress them under different names"
            )
        return (
            table.columns[name][rows]
            if name in table.columns
            else np.full(rows.stop - rows.start, "", dtype=object)
        )
    if kinds <= set("biu"):
        return table.columns[name][rows]
    values = (
        table.columns[name][rows]
        if name in table.columns
        else np.full(rows.stop - rows.start, np.nan)
    )
    numbers = values.astype(np.float64)
    if values.dtype.kind in "iu" and (numbers.astype(values.dtype) != values).any():
        raise OptionError(
            f"column {name!r} holds integers in one archive that can't be numbers with a fraction, as another has it"
        )
    return numbers


def _report(
    archives: Sequence[Archive],
    made: Archive,
    limit: DeviationLimit,
    moved: tuple[Deviation, ...],
    seconds: float,
    notes: tuple[str, ...],
) -> MergeReport:
    bytes_in = sum(len(archive.to_bytes()) for archive in archives)
    bytes_out = len(made.to_bytes())
    if bytes_out >= bytes_in:
        notes = (
            *notes,
            "the archives apart take no more bytes; allow a larger deviation for fewer",
        )
    return MergeReport(
        archives=len(archives),
        tracks=len(made.ids),
        parts=sum(len(walk.gaps) for walk in made.grid_walks.walks),
        nodes=len(made.road_map.nodes),
        edges=len(made.road_map.edges),
        nodes_in=sum(len(archive.road_map.nodes) for archive in archives),
        edges_in=sum(len(archive.road_map.edges) for archive in archives),
        bytes_in=bytes_in,
        bytes_out=bytes_out,
        limit=limit.metres,
        limits_maximum=limit.maximum,
        deviations=moved,
        seconds=seconds,
        notes=notes,
    )
