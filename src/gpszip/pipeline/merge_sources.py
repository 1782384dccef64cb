"""Archives as curves on one common plane, ready to be merged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.merging.deviation import Curve, build_curve, share_at_knots, split_at_gaps
from gpszip.merging.search import DeviationLimit
from gpszip.merging.tree import ArchiveCurves
from gpszip.model import Plane, QuantisationGrid, Track, Walk
from gpszip.model.grid import step_size
from gpszip.model.merge_options import MergeOptions
from gpszip.walks.shapes import assign_times_by_distance

__all__ = ["MergeSource", "curves_of_archives", "on_common_plane", "read_sources", "sampling_of"]

#: Space steps that a shape is made to travel in a time step: about the usual speed of tracks.
_STEPS_PER_TIME_STEP = 2.0

#: Share of the deviation allowed by which a line may bend when it is moved to another plane.
_MAX_BEND = 0.02

#: Mean radius of the earth in metres.
_EARTH_RADIUS = 6.371e6

#: Seconds between tracks that are joined where their ends were rounded over each other.
_JOINT = 5e-4

#: What to do about tracks of one id ...
_SAME_ID = "--same-id prefix keeps both apart, --same-id join makes them one (in Python: same_id)"

#: ... that can't be joined.
_KEEP_APART = "--same-id prefix keeps both apart (in Python: same_id)"


@dataclass(frozen=True, eq=False)
class MergeSource:
    """One archive on the common plane.

    Parameters
    ----------
    name : str
        What messages call it.
    archive : Archive
        The archive.
    ids : tuple of str
        Ids that its tracks get.
    curves : tuple of Curve
        One for each track.
    scale : float
        Largest scale factor of the common plane where the archive was on another one.
    bend : float
        Metres by which its lines may bend on the common plane.
    """

    name: str
    archive: Archive
    ids: tuple[str, ...]
    curves: tuple[Curve, ...]
    scale: float = 1.0
    bend: float = 0.0

    @property
    def untimed(self) -> frozenset[str]:
        """Ids of the tracks without times."""
        untimed = set(self.archive.untimed)
        pairs = zip(self.ids, self.archive.ids, strict=True)
        return frozenset(new for new, old in pairs if old in untimed)

    @property
    def at_knots(self) -> float:
        """Share of the log's points that may lie at knots."""
        return share_at_knots(self.curves, self.archive.sampling)


def read_sources(
    archives: Sequence[Archive],
    names: Sequence[str],
    options: MergeOptions,
    order: Sequence[int],
) -> list[MergeSource]:
    """Read the curves of archives, in the given order, with the ids that their tracks get.

    Raises
    ------
    OptionError
        If two archives have a track of one id, and the options don't say what to do.
    """
    # Read archive after archive; an id belongs to the first one that has it.
    sources, owners = [], dict[str, str]()
    for name, archive in zip(names, archives, strict=True):
        # Ids, which tell whose track it is where the user wants that.
        prefixed = options.same_id == "prefix"
        ids = tuple(f"{name}:{id}" for id in archive.ids) if prefixed else archive.ids
        for id in ids:
            if id in owners and options.same_id != "join":
                remedy = "name the archives differently" if prefixed else _SAME_ID
                raise OptionError(f"track {id!r} is in {owners[id]} and in {name}", remedy=remedy)
            owners.setdefault(id, name)

        # Curves, with times for shapes.
        nodes = archive.road_map.nodes
        walks = (_with_times(walk, nodes, archive.grid) for walk in archive.walks)
        curves = tuple(
            build_curve(replace(walk, id=id), nodes) for id, walk in zip(ids, walks, strict=True)
        )
        sources.append(MergeSource(name, archive, ids, curves))
    return [sources[i] for i in order]


def on_common_plane(sources: list[MergeSource], limit: DeviationLimit) -> list[MergeSource]:
    """Return the same curves on planes that all archives share."""
    # Leave the curves as they are where all archives share one plane already.
    planes = [source.archive.grid.plane for source in sources]
    if len(set(planes)) == 1:
        return sources
    from gpszip.geo.common_plane import max_scale_factor, to_common_plane

    # Long segments are cut, so that none bends much on another plane.
    known = [plane for plane in planes if plane is not None]
    cut = [
        replace(source, curves=tuple(_cut_segments(curve, limit) for curve in source.curves))
        for source in sources
    ]
    positions = [
        np.concatenate([curve.track.positions for curve in source.curves]) for source in cut
    ]
    starts = [_piece_starts(source.curves) for source in cut]
    shared, moved_positions, moved = to_common_plane(known, positions, starts)

    # What the move may have added to the error.
    return [
        replace(
            source,
            curves=_moved(source.curves, positions, shared),
            scale=max_scale_factor(positions[rows], shared) if rows.any() else 1.0,
            bend=_MAX_BEND * limit.metres if rows.any() else 0.0,
        )
        for source, positions, rows in zip(cut, moved_positions, moved, strict=True)
    ]


def curves_of_archives(
    sources: Sequence[MergeSource], limit_shares: Sequence[float]
) -> list[ArchiveCurves]:
    """Return the curves of each archive; of all together where tracks of one id are joined.

    Parameters
    ----------
    sources : sequence of MergeSource
        On one plane.
    limit_shares : sequence of float
        Share of the limit by which the curves of each archive may be moved.
    """
    grids = [_grid_on_common_plane(source) for source in sources]
    ids = [id for source in sources for id in source.ids]
    if len(set(ids)) == len(ids):
        return [
            replace(
                _archive_curves(source.curves, grid, source.archive.sampling), limit_share=share
            )
            for source, grid, share in zip(sources, grids, limit_shares, strict=True)
        ]
    return [replace(_joined_curves(sources, grids), limit_share=min(limit_shares))]


def sampling_of(archives: Sequence[Archive]) -> float | None:
    """Longest sampling interval of the logs in seconds; None unless it is known of all."""
    intervals = [archive.sampling for archive in archives if archive.sampling is not None]
    return max(intervals) if len(intervals) == len(archives) else None


def _with_times(walk: Walk, nodes: NDArray[np.float64], grid: QuantisationGrid) -> Walk:
    """Give the walk of a shape times at a speed that suits the steps of the grid."""
    if walk.times is not None:
        return walk
    length = float(np.sqrt((np.diff(nodes[walk.nodes], axis=0) ** 2).sum(axis=1)).sum())
    speed = _STEPS_PER_TIME_STEP * step_size(grid.space) / step_size(grid.time)
    start = grid.epoch / 1000
    return assign_times_by_distance(walk, nodes, start, start + length / speed)


def _cut_segments(curve: Curve, limit: DeviationLimit) -> Curve:
    """Cut segments so short that none bends by more than is tolerated on another plane.

    On transverse Mercator planes within reach, a line of length l bends by less than
    l**2 / (60 R), with R the radius of the earth.
    """
    # Solve l**2 / (60 R) for the longest segment that bends no more than is tolerated, and count
    # the parts of each segment. No line is claimed in a gap, which stays whole.
    longest = (60 * _EARTH_RADIUS * _MAX_BEND * limit.metres) ** 0.5
    lengths = np.linalg.norm(np.diff(curve.track.positions, axis=0), axis=1)
    counts = np.where(curve.gaps, 1, np.ceil(lengths / longest)).astype(np.int64)
    if (counts <= 1).all():
        return curve

    # Knots at equal fractions of each segment.
    knots = np.arange(len(curve.track))
    fractions = [
        first + np.arange(count) / count
        for first, count in enumerate(np.maximum(counts, 1).tolist())
    ]
    at = np.append(np.concatenate(fractions), knots[-1])
    positions = np.stack([np.interp(at, knots, axis) for axis in curve.track.positions.T], axis=1)
    times = np.interp(at, knots, curve.track.times)

    # Rounding may make two times one.
    kept = np.append(True, np.diff(times) > 0)
    gaps = curve.gaps[at[:-1].astype(np.int64)]
    return Curve(Track(curve.track.id, times[kept], positions[kept]), gaps[kept[1:]])


def _piece_starts(curves: Sequence[Curve]) -> NDArray[np.int64]:
    """First knot of each piece, counted over all curves."""
    offsets = np.cumsum([0] + [len(curve.track) for curve in curves])
    return np.array(
        [
            offset + first
            for curve, offset in zip(curves, offsets, strict=False)
            for first, _ in split_at_gaps(curve.gaps)
        ]
    )


def _moved(
    curves: Sequence[Curve], positions: NDArray[np.float64], plane: Plane
) -> tuple[Curve, ...]:
    """The curves at other positions."""
    cuts = np.cumsum([len(curve.track) for curve in curves])[:-1]
    return tuple(
        Curve(Track(curve.track.id, curve.track.times, own, plane=plane), curve.gaps)
        for curve, own in zip(curves, np.split(positions, cuts), strict=True)
    )


def _grid_on_common_plane(source: MergeSource) -> QuantisationGrid:
    """The archive's grid; on another plane, one whose origin is near its first knot."""
    grid, plane = source.archive.grid, source.curves[0].track.plane
    if plane is None or grid.plane == plane:
        return grid
    origin = tuple(1000 * int(np.floor(x)) for x in source.curves[0].track.positions[0])
    return replace(grid, origin=origin, plane=plane)


def _archive_curves(
    curves: Sequence[Curve], grid: QuantisationGrid, sampling: float | None
) -> ArchiveCurves:
    """Curves with the nodes that they share."""
    positions = np.concatenate([curve.track.positions for curve in curves])
    nodes, at_node = np.unique(positions, axis=0, return_inverse=True)
    cuts = np.cumsum([len(curve.track) for curve in curves])[:-1]
    knot_nodes = tuple(np.split(at_node.reshape(-1).astype(np.int32), cuts))
    return ArchiveCurves(tuple(curves), nodes, knot_nodes, grid, sampling)


def _joined_curves(
    sources: Sequence[MergeSource], grids: Sequence[QuantisationGrid]
) -> ArchiveCurves:
    """All curves together, those of one id as one curve, on the grid of the largest archive."""
    curves = dict[str, list[tuple[Curve, MergeSource]]]()
    for source in sources:
        for name, curve in zip(source.ids, source.curves, strict=True):
            curves.setdefault(name, []).append((curve, source))
    knots = [sum(len(curve.track) for curve in source.curves) for source in sources]
    grid = grids[knots.index(max(knots))]
    joined = [_join_curves(name, pairs) for name, pairs in curves.items()]
    return _archive_curves(joined, grid, sampling_of([source.archive for source in sources]))


def _join_curves(name: str, pairs: list[tuple[Curve, MergeSource]]) -> Curve:
    """Join the curves of one agent in the order of time, with gaps between them."""
    if len(pairs) > 1 and any(name in source.untimed for _, source in pairs):
        raise OptionError(
            f"track {name!r} has no times, so that nobody knows how it goes on",
            remedy=_KEEP_APART,
        )
    pairs = sorted(pairs, key=lambda pair: float(pair[0].track.times[0]))
    joined, source = pairs[0]
    for later, later_source in pairs[1:]:
        before, after = _apart_in_time(name, joined, source, later, later_source)
        times = np.concatenate([before.track.times, after.track.times])
        positions = np.concatenate([before.track.positions, after.track.positions])
        gaps = np.concatenate([before.gaps, [True], after.gaps])
        joined = Curve(Track(name, times, positions, plane=before.track.plane), gaps)
        source = later_source
    return joined


def _apart_in_time(
    name: str, before: Curve, source: MergeSource, after: Curve, later_source: MergeSource
) -> tuple[Curve, Curve]:
    """Cut two curves at a common time where their ends were rounded over each other.

    Raises
    ------
    OptionError
        If they overlap by more than the rounding of both.
    """
    end, start = float(before.track.times[-1]), float(after.track.times[0])
    rounding = step_size(source.archive.grid.time) + step_size(later_source.archive.grid.time)
    if end - start > rounding:
        raise OptionError(
            f"track {name!r} is in {source.name} until {end:.3f} s and in {later_source.name} "
            f"from {start:.3f} s: one agent can't be at two places",
            remedy=f"{_KEEP_APART}; gpszip join puts parts of one archive together again",
        )
    if end < start:
        return before, after
    joint = (end + start) / 2
    return (
        _time_range(before, float(before.track.times[0]), joint),
        _time_range(after, joint + _JOINT, float(after.track.times[-1])),
    )


def _time_range(curve: Curve, first: float, last: float) -> Curve:
    """The curve between two times, which it covers."""
    # Its knots inside, and the two ends.
    times = curve.track.times
    inside = times[(times > first) & (times < last)]
    ends = np.array([max(first, float(times[0])), min(last, float(times[-1]))])
    when = np.unique(np.concatenate([ends, inside]))
    positions = np.stack([np.interp(when, times, axis) for axis in curve.track.positions.T], axis=1)

    # Each segment has the gap of the one that it is a part of.
    middles = (when[1:] + when[:-1]) / 2
    segment = np.clip(np.searchsorted(times, middles) - 1, 0, max(len(curve.gaps) - 1, 0))
    gaps = curve.gaps[segment] if len(curve.gaps) else np.zeros(len(segment), np.bool_)
    return Curve(Track(curve.track.id, when, positions, plane=curve.track.plane), gaps)
