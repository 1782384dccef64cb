"""Getting an archive ready for tracks that go on: a finer grid of time where that is needed, walks that stop where their track did."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.archive import Archive, new_archive, with_error_bound
from gpszip.codec.walks import number_by_visit
from gpszip.model import GridWalk, GridWalks, QuantisationGrid
from gpszip.model.grid import MAX_REFINEMENTS, step_size
from gpszip.walks.quantised import knot_times

__all__ = ["claimed", "end_of", "ready_to_continue"]

#: Eighths of an octave in one halving of a time step.
_OCTAVE = 8

#: A time step this many times the one that suits the new tracks is made finer first. Logs of parked vehicles have steps of hours.
_TOO_COARSE = 8.0


def ready_to_continue(archive: Archive, starts: Mapping[str, float], suited: float) -> Archive:
    """Make room for tracks that go on soon after they ended in an archive.

    The last knot of a walk lies up to a time step after the last sample. Where a track goes on before that knot, the walk is cut
    at the first cell after its last sample; it stays the same line up to there, but for the rounding of its new last knot.

    Parameters
    ----------
    archive : Archive
        With times and a map of its own.
    starts : mapping of str to float
        Time of the first new sample of each track, in seconds.
    suited : float
        Time step in seconds that suits the new tracks.

    Returns
    -------
    Archive
        The same archive where nothing has to change.
    """
    refinements = _halvings(archive.grid, suited)
    late = [
        name
        for name, start in starts.items()
        if name in archive.ids and start < _last_knot(archive, name)
    ]
    if not late and refinements == 0:
        return archive

    # the same walks on a finer grid of time
    grid = replace(archive.grid, time=archive.grid.time - _OCTAVE * refinements)
    walks = [
        GridWalk(walk.nodes, walk.time_steps << refinements, walk.gaps)
        for walk in archive.grid_walks.walks
    ]
    nodes = [archive.grid_walks.nodes]

    # the walks that go on, cut where they end
    for name in late:
        number = archive.ids.index(name)
        walks[number], own = _cut(
            walks[number],
            archive.grid_walks.nodes,
            sum(map(len, nodes)),
            _end_cell(archive, name, grid),
        )
        nodes.append(own)
    grid_walks = number_by_visit(
        GridWalks(np.concatenate(nodes), tuple(walks), untimed=archive.grid_walks.untimed)
    )
    made = new_archive(
        grid,
        archive.ids,
        grid_walks,
        layer=archive.contents.layer,
        extras=archive.contents.extras,
        spans=claimed(archive),
    )
    return with_error_bound(
        replace(made, contents=replace(made.contents, sampling=archive.contents.sampling)),
        archive.error_bound,
    )


def claimed(archive: Archive) -> list[NDArray[np.float64]]:
    """Seconds at which each piece of each track begins and ends, shape (pieces, 2)."""
    spans = []
    for walk in archive.walks:
        if walk.times is None:
            spans.append(np.zeros((0, 2)))
            continue
        first, last = np.append(True, walk.gaps), np.append(walk.gaps, True)
        spans.append(
            np.stack([walk.times[first], walk.times[last]], axis=1)
            if walk.spans is None
            else walk.spans
        )
    return spans


def end_of(archive: Archive, name: str) -> float:
    """Time in seconds at which a track ends in an archive."""
    walk = archive.walk(name)
    return _last_knot(archive, name) if walk.spans is None else float(walk.spans[-1, 1])


def _last_knot(archive: Archive, name: str) -> float:
    cells = archive.grid_walks.walks[archive.ids.index(name)].time_steps
    return float(knot_times(cells[-1:], archive.grid)[0])


def _halvings(grid: QuantisationGrid, suited: float) -> int:
    """How often the time step is to be halved; the archive on the map may halve it a few times more."""
    step = step_size(grid.time)
    if step <= _TOO_COARSE * suited:
        return 0
    most = grid.time // _OCTAVE - MAX_REFINEMENTS
    return max(min(math.ceil(math.log2(step / suited)), most), 0)


def _end_cell(archive: Archive, name: str, grid: QuantisationGrid) -> int:
    """First cell at or after the end of a track."""
    return math.ceil((end_of(archive, name) - grid.epoch / 1000) / step_size(grid.time) - 1e-6)


def _cut(
    walk: GridWalk, nodes: NDArray[np.int64], count: int, end: int
) -> tuple[GridWalk, NDArray[np.int64]]:
    """Let a walk end at a cell of its last part: at a node of that part, or at a new one, the ``count``-th."""
    end = max(end, int(walk.time_steps[-2]) + 1) if len(walk.time_steps) > 1 else end
    if len(walk.time_steps) == 1 or walk.gaps[-1] or end >= walk.time_steps[-1]:
        return walk, nodes[:0]
    before, after = nodes[walk.nodes[-2]], nodes[walk.nodes[-1]]
    share = (end - walk.time_steps[-2]) / (walk.time_steps[-1] - walk.time_steps[-2])
    place = np.rint(before + share * (after - before)).astype(np.int64)
    cells = np.append(walk.time_steps[:-1], end)
    if (place == before).all():
        return GridWalk(np.append(walk.nodes[:-1], walk.nodes[-2]), cells, walk.gaps), nodes[:0]
    return GridWalk(np.append(walk.nodes[:-1], np.int32(count)), cells, walk.gaps), place[None, :]
