"""Making an archive ready for tracks that are continued soon after they ended.

The last knot of a walk lies up to a time step after the last sample of its track. Where the track
continues before that knot, the walk is cut short, on a finer time grid where that is needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, with_error_bound
from gpszip.codec.numbering import number_by_visit
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.model.grid import MAX_REFINEMENTS, step_size
from gpszip.walks.quantised import knot_times

__all__ = [
    "cut_at_knots",
    "last_fixed_knot",
    "piece_time_ranges_of",
    "ready_to_continue",
    "track_end",
]

#: Step sizes from one time step to its half.
_STEP_SIZES_PER_OCTAVE = 8

#: A time step this many times the one that suits the new tracks is refined first. Logs of parked
#: vehicles have steps of hours.
_TOO_COARSE = 8.0

#: Share of a time step by which a track may end after a step and still count as ending on it.
_ROUNDING = 1e-6


def ready_to_continue(
    archive: Archive, spans: Mapping[str, tuple[float, float]], time_step: float, further: int = 0
) -> Archive:
    """Cut walks that end after the start of what continues them.

    A walk is cut at the first time step after its last sample. Up to there it stays the same
    line, but for the rounding of its new last knot.

    Parameters
    ----------
    archive : Archive
        With times and a map of its own.
    spans : mapping of str to (float, float)
        Times of the first and last new sample of each track, in seconds.
    time_step : float
        Seconds that suit the new tracks.
    further : int
        Refinements of the time step beyond those that suit them, as far as the archive allows.

    Returns
    -------
    Archive
        The same archive where nothing has to change.
    """
    # Find the refinements that suit the new tracks, and walks that end after they begin.
    late = [
        name
        for name, (start, _) in spans.items()
        if name in archive.ids and start < _last_knot_time(archive, name)
    ]
    space = min((spans[name][1] - track_end(archive, name) for name in late), default=math.inf)
    refinements = _refinements(archive.grid, time_step, space, further)
    if not late and refinements == 0:
        return archive

    # The same walks on a finer time grid.
    grid = replace(archive.grid, time=archive.grid.time - _STEP_SIZES_PER_OCTAVE * refinements)
    known = archive.grid_walks
    walks = [
        GridWalk(walk.nodes, walk.time_steps << refinements, walk.gaps) for walk in known.walks
    ]

    # The walks that are continued, cut where their tracks end.
    nodes = [known.nodes]
    for name in late:
        number = archive.ids.index(name)
        end = _end_step(archive, name, grid)
        walks[number], added = _cut(walks[number], known.nodes, sum(map(len, nodes)), end)
        nodes.append(added)

    # Code the cut walks anew; columns, sampling and error bound stay those of the archive.
    cut = GridWalks(np.concatenate(nodes), tuple(walks), untimed=known.untimed)
    ready = new_archive(
        grid,
        archive.ids,
        number_by_visit(cut),
        layer=archive.contents.layer,
        extras=archive.contents.extras,
        time_ranges=piece_time_ranges_of(archive),
    )
    contents = replace(ready.contents, sampling=archive.contents.sampling)
    return with_error_bound(replace(ready, contents=contents), archive.error_bound)


def last_fixed_knot(archive: Archive, name: str) -> int | None:
    """Number of the knot from which on a walk is to be learned anew where its track goes on.

    That is the last knot but one: the walk arrives there, whatever comes later. A knot after which
    a piece begins would be a piece of its own, so that the one before the gap is taken.

    Returns
    -------
    int or None
        None where the whole walk is to be learned anew.
    """
    walk = archive.grid_walks.walks[archive.ids.index(name)]
    knot = len(walk.nodes) - 2
    while knot > 0 and walk.gaps[knot - 1]:
        knot -= 1
    return knot if knot > 0 else None


def cut_at_knots(archive: Archive, knots: Mapping[str, int | None]) -> Archive | None:
    """Let walks end at some of their knots, or leave them out.

    Parameters
    ----------
    archive : Archive
        With times and a map of its own.
    knots : mapping of str to int or None
        Number of the last knot that each walk keeps, at least 1; None to leave it out.

    Returns
    -------
    Archive or None
        Without nodes that no walk visits any more. None where no walk is left.
    """
    # Cut the walks, and the times at which their pieces begin and end.
    known, ids, walks, ranges = archive.grid_walks, [], [], []
    for name, walk, pieces in zip(
        archive.ids, known.walks, piece_time_ranges_of(archive), strict=True
    ):
        last = knots.get(name, len(walk.nodes) - 1)
        if last is None:
            continue
        kept = pieces[: int(walk.gaps[:last].sum()) + 1].copy()
        end = knot_times(walk.time_steps[last : last + 1], archive.grid)
        kept[-1:, 1] = np.minimum(kept[-1:, 1], end)
        ids.append(name)
        walks.append(
            GridWalk(walk.nodes[: last + 1], walk.time_steps[: last + 1], walk.gaps[:last])
        )
        ranges.append(kept)
    if not walks:
        return None

    # Code them anew; all else stays what it is.
    untimed = frozenset(ids.index(name) for name in archive.untimed)
    cut = new_archive(
        archive.grid,
        ids,
        number_by_visit(GridWalks(known.nodes, tuple(walks), untimed=untimed)),
        layer=archive.contents.layer,
        extras=archive.contents.extras,
        time_ranges=ranges,
        is_draft=True,
    )
    contents = replace(cut.contents, sampling=archive.contents.sampling)
    return with_error_bound(replace(cut, contents=contents), archive.error_bound)


def piece_time_ranges_of(archive: Archive) -> list[NDArray[np.float64]]:
    """Seconds at which each piece of each track begins and ends, shape (pieces, 2)."""
    ranges = []
    for walk in archive.walks:
        if walk.times is None:
            ranges.append(np.zeros((0, 2)))
        elif walk.time_ranges is not None:
            ranges.append(walk.time_ranges)
        else:
            first, last = np.append(True, walk.gaps), np.append(walk.gaps, True)
            ranges.append(np.stack([walk.times[first], walk.times[last]], axis=1))
    return ranges


def track_end(archive: Archive, name: str) -> float:
    """Time in seconds at which a track ends in an archive."""
    walk = archive.walk(name)
    return (
        _last_knot_time(archive, name)
        if walk.time_ranges is None
        else float(walk.time_ranges[-1, 1])
    )


def _last_knot_time(archive: Archive, name: str) -> float:
    time_steps = archive.grid_walks.walks[archive.ids.index(name)].time_steps
    return float(knot_times(time_steps[-1:], archive.grid)[0])


def _refinements(grid: QuantisationGrid, time_step: float, space: float, further: int) -> int:
    """How often the time step is to be halved.

    The seconds from the end of a track to its last new sample, ``space``, have to hold a time step:
    the walk is cut there, and goes on to that sample. An archive on this map may halve the step a
    few times more, so some step sizes are left for that.
    """
    step, wanted = step_size(grid.time), 0
    if step > _TOO_COARSE * time_step:
        wanted = math.ceil(math.log2(step / time_step))
    if 0 < space <= step:
        wanted = max(wanted, math.floor(math.log2(step / space)) + 1)
    most = grid.time // _STEP_SIZES_PER_OCTAVE - MAX_REFINEMENTS
    return max(min(wanted + further, most), 0)


def _end_step(archive: Archive, name: str, grid: QuantisationGrid) -> int:
    """First time step at or after the end of a track."""
    steps = (track_end(archive, name) - grid.epoch / 1000) / step_size(grid.time)
    return math.ceil(steps - _ROUNDING)


def _cut(
    walk: GridWalk, nodes: NDArray[np.int64], count: int, end: int
) -> tuple[GridWalk, NDArray[np.int64]]:
    """Let a walk end at a time step of its last segment.

    Parameters
    ----------
    walk : GridWalk
        The walk.
    nodes : int64 array, shape (V, d)
        Coordinates of the nodes.
    count : int
        Number that a new node gets.
    end : int
        The time step.

    Returns
    -------
    GridWalk
        With its last knot at ``end``: at the node before it, or at a new one.
    int64 array, shape (0 or 1, d)
        The new node.
    """
    # Leave a walk whose last segment can't be cut: a single knot, a gap, or one that ends by then.
    steps, no_node = walk.time_steps, nodes[:0]
    if len(steps) == 1 or walk.gaps[-1]:
        return walk, no_node
    end = max(end, int(steps[-2]) + 1)
    if end >= steps[-1]:
        return walk, no_node

    # The point of the segment at that time, on the grid.
    before, after = nodes[walk.nodes[-2]], nodes[walk.nodes[-1]]
    share = (end - steps[-2]) / (steps[-1] - steps[-2])
    point = np.rint(before + share * (after - before)).astype(np.int64)
    cut_steps = np.append(steps[:-1], end)
    if (point == before).all():
        return GridWalk(np.append(walk.nodes[:-1], walk.nodes[-2]), cut_steps, walk.gaps), no_node
    cut_nodes = np.append(walk.nodes[:-1], np.int32(count))
    return GridWalk(cut_nodes, cut_steps, walk.gaps), point[None, :]
