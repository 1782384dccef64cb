"""Cut an archive to some tracks, a time range or an area, without learning anything anew.

The knots of the new archive are those of the old one, so that positions stay what they are. Its
travel begins and ends where the selection says, to a millisecond.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.archive import Archive
from gpszip.archive.create import new_archive, with_error_bound
from gpszip.archive.grid_cutter import GridCutter
from gpszip.archive.pieces import build_pieces, pieces_by_track
from gpszip.archive.renumber import number_on_known_map
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.catalog import group_heads
from gpszip.container.contents import Section
from gpszip.errors import OptionError
from gpszip.lossless.kept import smaller_section
from gpszip.model.error_bound import ErrorBound, rounded_bound
from gpszip.model.grid_walks import GridWalks, ends_of_walks
from gpszip.model.projection import map_coordinates
from gpszip.model.selection import Selection
from gpszip.model.timestamps import format_span
from gpszip.model.track import Track
from gpszip.model.walk import Walk
from gpszip.walks.quantised import dequantise_walks, merge_grid_walks, node_positions
from gpszip.walks.restrict import (
    RestrictedKnots,
    find_intervals,
    restrict_knots,
    restrict_shape,
)

__all__ = ["decompress_selection", "iterate_selection", "select"]

#: Seconds by which a sample may lie outside of a time range, which is kept to a millisecond.
_TIME_SLACK = 1e-3

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _SelectedWalks:
    """Walks of the tracks that a selection may concern, and what remains of each.

    Parameters
    ----------
    grid_walks : GridWalks
        The walks as they are.
    walks : tuple of Walk
        The same in seconds, in the same order.
    nodes : float64 array, shape (V, d)
        Positions of the nodes in metres.
    restricted : list of RestrictedKnots or None
        What remains of each walk; None for nothing.
    """

    grid_walks: GridWalks
    walks: tuple[Walk, ...]
    nodes: Floats
    restricted: list[RestrictedKnots | None]

    @property
    def numbers(self) -> list[int]:
        """Numbers of the walks of which something remains."""
        return [number for number, kept in enumerate(self.restricted) if kept is not None]

    def kept(self, number: int) -> RestrictedKnots:
        """What remains of a walk of which something does."""
        kept = self.restricted[number]
        assert kept is not None
        return kept


def select(archive: Archive, selection: Selection) -> Archive:
    """Cut an archive to what is selected.

    A track that leaves the area and comes back has a gap in between, unless it does so within a
    time step of the grid. Of tracks without times, the segments that touch the area remain; a time
    range leaves these tracks out.

    Parameters
    ----------
    archive : Archive
        The archive.
    selection : Selection
        Which tracks, times and positions.

    Returns
    -------
    Archive
        On the same known map, if the archive lies on one; else with a map of its own. It states the
        largest error, if the archive does; a root mean square error need not hold for a part.

    Raises
    ------
    UnknownTrackError
        If there is no such track.
    OptionError
        If nothing is selected.
    """
    # Restrict the walks, and bring them to the grid.
    selected = _select_walks(archive, selection)
    ids = [selected.walks[number].id for number in selected.numbers]
    kept = [selected.kept(number) for number in selected.numbers]
    cutter = GridCutter(archive.grid, selected.grid_walks)
    cut = [
        cutter.cut(selected.grid_walks.walks[number], of_walk)
        for number, of_walk in zip(selected.numbers, kept, strict=True)
    ]
    walks, time_ranges = tuple(walk for walk, _ in cut), [ranges for _, ranges in cut]
    untimed = frozenset(
        i for i, number in enumerate(selected.numbers) if number in selected.grid_walks.untimed
    )
    grid_walks = GridWalks(cutter.nodes, walks, archive.timed, untimed=untimed)

    # Code them, on the same known map if there is one.
    reference = archive.contents.map
    part = new_archive(
        archive.grid,
        ids,
        number_on_known_map(archive, grid_walks),
        layer=archive.contents.layer,
        extras=(
            *_kept_section(archive, ids, time_ranges),
            *_curve_section(archive, ids, time_ranges),
        ),
        known_map=None if reference is None else archive.map,
        refinements=0 if reference is None else reference.refinements,
        time_ranges=time_ranges if archive.timed else None,
    )
    part = with_error_bound(part, _bound_of_part(archive.error_bound, cutter.moved))
    return replace(part, contents=replace(part.contents, sampling=archive.contents.sampling))


def decompress_selection(
    archive: Archive, selection: Selection
) -> tuple[list[Track], dict[str, str]]:
    """Tracks of the knots of what is selected, as :meth:`Archive.decompress` gives them.

    Unlike :func:`select`, this codes nothing.

    Parameters
    ----------
    archive, selection
        As for :func:`select`.

    Returns
    -------
    list of Track
        Pieces between gaps.
    dict of str to str
        Name of the track of each piece.
    """
    return _build_selected(archive, _select_walks(archive, selection))


def iterate_selection(
    archive: Archive, selection: Selection
) -> Iterator[tuple[list[Track], dict[str, str]]]:
    """Yield what :func:`decompress_selection` returns, for one group of tracks after the other.

    Groups that this decodes are not kept, so that one of them is in memory at a time.

    Raises
    ------
    UnknownTrackError
        If there is no such track.
    OptionError
        If nothing is selected.
    """
    wanted = {archive._track_number(track) for track in selection.tracks}
    # A name such as a/1 may be that of a track and of a piece of another group.
    if any("/" in name for name in archive.ids):
        yield decompress_selection(archive, selection)
        return

    found = False
    for number, head in enumerate(group_heads(archive.contents)):
        own = range(head.first_track, head.first_track + head.tracks)
        ids = tuple(archive.ids[track] for track in own if not wanted or track in wanted)
        if not ids:
            continue
        is_cached = number in archive._decoded_groups
        selected = _select_walks(archive, replace(selection, tracks=ids), may_be_empty=True)
        if not is_cached:
            archive._decoded_groups.pop(number, None)
        if selected.numbers:
            found = True
            yield _build_selected(archive, selected)
    if not found:
        raise _nothing_selected(archive, selection)


def _build_selected(
    archive: Archive, selected: _SelectedWalks
) -> tuple[list[Track], dict[str, str]]:
    """Tracks of the knots that remain, and the track of each piece."""
    walks = [_restricted_walk(selected, number) for number in selected.numbers]
    named = pieces_by_track(walks)
    pieces = [
        piece
        for walk in walks
        for piece in archive.with_curves(
            walk.id,
            build_pieces(walk, selected.nodes, named[walk.id], archive.grid.plane),
            at_knots=True,
        )
    ]
    return pieces, {name: track for track, own in named.items() for name, _ in own}


def _select_walks(
    archive: Archive, selection: Selection, *, may_be_empty: bool = False
) -> _SelectedWalks:
    """Decode the groups that a selection may concern, and restrict their walks."""
    geographic = archive.grid.plane is not None
    if selection.bbox is not None:
        selection.bbox.check(geographic=geographic)

    # The walks.
    wanted = {archive._track_number(track) for track in selection.tracks}
    grid_walks, ids = _read_walks(archive, selection, wanted)
    walks = dequantise_walks(grid_walks, archive.grid, ids)
    nodes = node_positions(grid_walks, archive.grid)

    # What remains of each.
    coordinates = np.zeros((0, 2))
    if selection.bbox is not None:
        coordinates = map_coordinates(nodes, archive.grid.plane)
    restricted = [_restrict(walk, coordinates, selection, geographic=geographic) for walk in walks]
    selected = _SelectedWalks(grid_walks, walks, nodes, restricted)
    if not selected.numbers and not may_be_empty:
        raise _nothing_selected(archive, selection)
    return selected


def _read_walks(
    archive: Archive, selection: Selection, wanted: set[int]
) -> tuple[GridWalks, list[str]]:
    """Walks of the wanted tracks, or of all tracks that may travel in the time range."""
    # Groups without such tracks stay packed.
    groups, ids = [], []
    for number, head in enumerate(group_heads(archive.contents)):
        own = range(head.first_track, head.first_track + head.tracks)
        chosen = [track for track in own if not wanted or track in wanted]
        begin, end = archive._group_time_range(number)
        if not chosen or begin > selection.time_range[1] or end < selection.time_range[0]:
            continue
        group = archive._decode_group(number)
        groups.append(_take_walks(group, [track - head.first_track for track in chosen]))
        ids += [archive.ids[track] for track in chosen]

    # Equal nodes of several groups become one.
    if not groups:
        empty = GridWalks(np.zeros((0, archive.grid.dimension), np.int64), (), archive.timed)
        return empty, []
    return groups[0] if len(groups) == 1 else merge_grid_walks(groups), ids


def _take_walks(group: GridWalks, numbers: Sequence[int]) -> GridWalks:
    """Some walks of a group, on all of its nodes."""
    if len(numbers) == len(group.walks):
        return group
    ends = [ends_of_walks(group, number, number + 1) for number in numbers]
    first = ends[0]
    if first is not None and first.tick:
        first = replace(
            first,
            first=np.concatenate([own.first for own in ends if own is not None]),
            last=np.concatenate([own.last for own in ends if own is not None]),
        )
    return GridWalks(
        group.nodes,
        tuple(group.walks[number] for number in numbers),
        group.timed,
        first,
        frozenset(i for i, number in enumerate(numbers) if number in group.untimed),
    )


def _restrict(
    walk: Walk, coordinates: Floats, selection: Selection, *, geographic: bool
) -> RestrictedKnots | None:
    """What remains of a walk; ``coordinates`` are those of all nodes, if there is an area."""
    bbox = selection.bbox
    own = coordinates if bbox is None else coordinates[walk.nodes]
    if walk.times is not None:
        intervals = find_intervals(
            walk, own, time_range=selection.time_range, bbox=bbox, geographic=geographic
        )
        return restrict_knots(walk, intervals)

    # A shape has no time that could lie in a range.
    if selection.has_times:
        return None
    if bbox is None:
        return RestrictedKnots(np.arange(len(walk.nodes)), walk.gaps, np.zeros((0, 2)))
    return restrict_shape(walk, own, bbox, geographic=geographic)


def _restricted_walk(selected: _SelectedWalks, number: int) -> Walk:
    """What remains of a walk, as a walk."""
    walk, kept = selected.walks[number], selected.kept(number)
    times = None if walk.times is None else walk.times[kept.knots]
    ranges = None if walk.times is None else kept.time_ranges
    return Walk(walk.id, walk.nodes[kept.knots], times, kept.gaps, ranges)


def _kept_section(
    archive: Archive, ids: Sequence[str], time_ranges: Sequence[Floats]
) -> tuple[Section, ...]:
    """Kept columns and times of the samples that remain; nothing where none are kept."""
    if archive.kept_columns is None:
        return ()

    # Rows of each track whose time lies in one of its ranges.
    kept = archive._kept_samples
    rows, counts = [], []
    for track, ranges in zip(ids, time_ranges, strict=True):
        of_track = kept.rows(archive._track_number(track))
        own, times = np.arange(of_track.start, of_track.stop), kept.times[of_track]
        piece = np.maximum(np.searchsorted(ranges[:, 0], times + _TIME_SLACK) - 1, 0)
        is_within = (times >= ranges[piece, 0] - _TIME_SLACK) & (
            times <= ranges[piece, 1] + _TIME_SLACK
        )
        rows.append(own[is_within])
        counts.append(int(is_within.sum()))

    # Their values.
    chosen = np.concatenate(rows)
    columns = {name: values[chosen] for name, values in kept.columns.items()}
    body = encode_attributes(KeptColumns(tuple(counts), kept.times[chosen], columns))
    return (Section(*smaller_section(body, len(ids))),)


def _curve_section(
    archive: Archive, ids: Sequence[str], time_ranges: Sequence[Floats]
) -> tuple[Section, ...]:
    """Curves of the tracks that remain, with the knots about their time ranges."""
    if not archive.curve_sizes:
        return ()
    from gpszip.archive.curves import curves_section

    # Of each track, the knots from the last one before its travel to the first one after it.
    columns = {}
    for name, column in archive._curve_columns.items():
        knots = []
        for track, ranges in zip(ids, time_ranges, strict=True):
            own = column.knots[archive._track_number(track)]
            seconds = own[:, 1] / column.unit
            first = int(np.searchsorted(seconds, ranges.min(initial=np.inf), side="right")) - 1
            after = int(np.searchsorted(seconds, ranges.max(initial=-np.inf))) + 1
            knots.append(_begin_track(own[max(first, 0) : after]))
        columns[name] = replace(column, knots=tuple(knots))
    return (curves_section(columns),)


def _begin_track(knots: NDArray[np.int64]) -> NDArray[np.int64]:
    """The knots, the first of which begins a track."""
    from gpszip.codec.kernels.curves import BEGINS_TRACK

    begun = knots.copy()
    begun[:1, 0] = BEGINS_TRACK
    return begun


def _bound_of_part(bound: ErrorBound | None, moved: float) -> ErrorBound | None:
    """Largest error of some of the samples, whose lines have moved by so many metres at most."""
    if bound is None:
        return None
    largest = bound.metres if bound.maximum else bound.max_error
    if largest is None:
        return None
    return bound if bound.maximum and not moved else rounded_bound(largest + moved, maximum=True)


def _nothing_selected(archive: Archive, selection: Selection) -> OptionError:
    """Error where nothing is left, with what the archive has."""
    span = archive.time_range
    has = "no times" if span is None else format_span(*span)
    where = "" if selection.bbox is None else f" in the box {selection.bbox}"
    return OptionError(
        f"nothing is selected{where}; the archive has {has}",
        remedy="'gpszip info --detail' shows its tracks, its time range and its area",
    )
