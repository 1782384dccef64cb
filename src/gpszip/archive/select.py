"""Cut an archive to some tracks, a time range or an area, without learning anything anew.

The knots of the new archive are those of the old one, so that positions stay what they are. Its
travel begins and ends where the selection says, to a millisecond.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.archive import Archive
from gpszip.archive.create import new_archive, with_error_bound
from gpszip.archive.pieces import build_pieces, pieces_by_track
from gpszip.archive.renumber import number_on_known_map
from gpszip.codec.end_kinds import MAX_QUOTIENT
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.catalog import group_heads
from gpszip.container.contents import Section
from gpszip.errors import OptionError
from gpszip.lossless.kept import smaller_section
from gpszip.model.error_bound import ErrorBound, rounded_bound
from gpszip.model.grid import QuantisationGrid, step_size
from gpszip.model.grid_walks import GridWalk, GridWalks, ends_of_walks
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

#: Share of a time step by which float noise may move a time off it.
_STEP_TOLERANCE = 1e-6

#: Seconds by which a sample may lie outside of a time range, which is kept to a millisecond.
_TIME_SLACK = 1e-3

#: Time steps between a knot and where travel begins that the format can hold; beyond these, a new
#: knot stands there.
_MAX_OFFSET_STEPS = MAX_QUOTIENT

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
    time step of the grid. Of tracks without times, the segments that
    touch the area remain; a time range leaves them out.

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
    cutter = _GridCutter(archive.grid, selected.grid_walks)
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
        extras=_kept_section(archive, ids, time_ranges),
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
    for head in group_heads(archive.contents):
        own = range(head.first_track, head.first_track + head.tracks)
        ids = tuple(archive.ids[track] for track in own if not wanted or track in wanted)
        if not ids:
            continue
        selected = _select_walks(archive, replace(selection, tracks=ids), may_be_empty=True)
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
        for piece in build_pieces(walk, selected.nodes, named[walk.id], archive.grid.plane)
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


class _Piece(NamedTuple):
    """A piece of what remains of a walk.

    Parameters
    ----------
    knots : int array, shape (k,)
        Indices of its knots.
    begin, end : float
        Seconds at which travel begins and ends.
    """

    knots: NDArray[np.intp]
    begin: float
    end: float


class _GridCutter:
    """Brings what remains of walks to the grid.

    Where travel begins or ends too far from its knot for the format to say so, a new knot on the
    line takes the place of that knot.

    Parameters
    ----------
    grid : QuantisationGrid
        The grid.
    walks : GridWalks
        The walks as they are.
    """

    def __init__(self, grid: QuantisationGrid, walks: GridWalks) -> None:
        self._grid = grid
        self._nodes = walks.nodes
        self._new_nodes: list[NDArray[np.int64]] = []
        #: Largest distance in metres between a new knot and the line between its neighbours.
        self.moved = 0.0

    @property
    def nodes(self) -> NDArray[np.int64]:
        """The nodes of the walks, and new ones after them."""
        return np.concatenate([self._nodes, *(node[None] for node in self._new_nodes)])

    def cut(self, walk: GridWalk, kept: RestrictedKnots) -> tuple[GridWalk, Floats]:
        """Return what remains of a walk on the grid, and the time ranges of its pieces."""
        # A shape has no times at which it could be cut.
        if not len(kept.time_ranges):
            shape = GridWalk(walk.nodes[kept.knots], walk.time_steps[kept.knots], kept.gaps)
            return shape, kept.time_ranges

        # Cut the pieces; the outer ends of a track have a finer place in the format than those at
        # a gap, and a knot of two pieces has to give way in both.
        pieces = self._distinct_pieces(kept)
        nodes, steps = [], []
        for number, piece in enumerate(pieces):
            before = pieces[number - 1].knots[-1] if number else -1
            after = pieces[number + 1].knots[0] if number + 1 < len(pieces) else len(walk.nodes)
            limits = (
                _MAX_OFFSET_STEPS if number == 0 else int(before < piece.knots[0]),
                _MAX_OFFSET_STEPS if number == len(pieces) - 1 else int(after > piece.knots[-1]),
            )
            own_nodes, own_steps = self._cut_piece(walk, piece, limits)
            nodes.append(own_nodes)
            steps.append(own_steps)

        # Join them, with a gap between any two.
        gaps = np.zeros(sum(map(len, nodes)) - 1, np.bool_)
        gaps[np.cumsum([len(own) for own in nodes])[:-1] - 1] = True
        time_ranges = np.array([(piece.begin, piece.end) for piece in pieces])
        return GridWalk(np.concatenate(nodes), np.concatenate(steps), gaps), time_ranges

    def _distinct_pieces(self, kept: RestrictedKnots) -> list[_Piece]:
        """Pieces of a walk; those that have a knot in common, and no time step between, are one."""
        bounds = [0, *(np.flatnonzero(kept.gaps) + 1).tolist(), len(kept.knots)]
        pieces: list[_Piece] = []
        for (first, after), (begin, end) in zip(
            pairwise(bounds), kept.time_ranges.tolist(), strict=True
        ):
            piece = _Piece(kept.knots[first:after], begin, end)
            if pieces and piece.knots[0] <= pieces[-1].knots[-1]:
                last_step = self._steps_around(pieces[-1].begin, pieces[-1].end)[1]
                if self._steps_around(begin, end)[0] <= last_step:
                    before = pieces.pop()
                    piece = _Piece(np.union1d(before.knots, piece.knots), before.begin, end)
            pieces.append(piece)
        return pieces

    def _cut_piece(
        self, walk: GridWalk, piece: _Piece, limits: tuple[int, int]
    ) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        """Nodes and time steps of a piece, with new knots where its ends are beyond some steps."""
        old_nodes, old_steps = walk.nodes[piece.knots], walk.time_steps[piece.knots]
        nodes, steps = old_nodes.copy(), old_steps.copy()
        begin_step, end_step = self._steps_around(piece.begin, piece.end)
        if begin_step - old_steps[0] > limits[0]:
            nodes[0] = self._add_node(old_nodes[:2], old_steps[:2], begin_step)
            steps[0] = begin_step
        if old_steps[-1] - end_step > limits[1]:
            nodes[-1] = self._add_node(old_nodes[-2:], old_steps[-2:], end_step)
            steps[-1] = end_step

        # Both may be at one time step of one segment.
        if len(steps) > 1 and steps[-1] <= steps[-2]:
            return nodes[:-1], steps[:-1]
        return nodes, steps

    def _steps_around(self, begin: float, end: float) -> tuple[int, int]:
        """The last time step at or before a time, and the first at or after another one."""
        epoch, step = self._grid.epoch / 1000, step_size(self._grid.time)
        first = math.floor((begin - epoch) / step + _STEP_TOLERANCE)
        return first, math.ceil((end - epoch) / step - _STEP_TOLERANCE)

    def _add_node(self, nodes: NDArray[np.int32], steps: NDArray[np.int64], time_step: int) -> int:
        """Add the node nearest to where a segment is at a time step, and return its number."""
        start, stop = self._nodes[nodes]
        share = (time_step - steps[0]) / (steps[1] - steps[0])
        position = start + share * (stop - start)
        node = np.rint(position).astype(np.int64)
        self._new_nodes.append(node)
        distance = float(np.linalg.norm(node - position)) * step_size(self._grid.space)
        self.moved = max(self.moved, distance)
        return len(self._nodes) + len(self._new_nodes) - 1


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
        own = np.arange(len(kept.times))[kept.rows(archive._track_number(track))]
        times = kept.times[own]
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
