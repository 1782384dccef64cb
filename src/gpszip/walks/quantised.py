"""Between an archive's lattice of integers and a road map with walks in metres and seconds.

The way out, :func:`node_positions`, :func:`dequantise_road_map` and :func:`dequantise_walks`, is exact. The way in, :func:`quantise_walks`,
rounds nodes to the nearest lattice point and knots to the nearest cell; only the ends of a piece are rounded away from
it, so that every instant that a piece covered is still covered.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.ends import piece_time_ranges
from gpszip.codec.walks import number_by_visit
from gpszip.model.grid import Plane, QuantisationGrid, step_size
from gpszip.model.grid_walks import GridWalk, GridWalks, concatenated_ends
from gpszip.model.road_map import RoadMap
from gpszip.model.walk import Walk
from gpszip.walks.counting import build_road_map

__all__ = [
    "choose_grid",
    "dequantise_road_map",
    "dequantise_walks",
    "knot_times",
    "mark_piece_ends",
    "merge_grid_walks",
    "node_positions",
    "quantise_walks",
]

#: Times this near to a cell, in seconds, are on it: float64 seconds since 1970 are no finer.
_TIME_TOLERANCE = 1e-6

#: A piece of a single knot may lie this far from its sample, in seconds; farther, and it takes two knots around it.
_SINGLE_KNOT_TOLERANCE = 5e-4


def node_positions(grid_walks: GridWalks, grid: QuantisationGrid) -> NDArray[np.float64]:
    """Positions of the nodes in metres, shape (V, d)."""
    return np.asarray(grid.origin, dtype=np.float64) / 1000 + grid_walks.nodes * step_size(
        grid.space
    )


def knot_times(cells: NDArray[np.int64], grid: QuantisationGrid) -> NDArray[np.float64]:
    """Seconds in the log's own zero at each cell.

    Examples
    --------
    >>> knot_times(np.array([0, 3]), QuantisationGrid(origin=(0, 0), epoch=1500, space=128, time=136))
    array([1.5, 7.5])
    """
    return grid.epoch / 1000 + cells.astype(np.float64) * step_size(grid.time)


def dequantise_road_map(grid_walks: GridWalks, grid: QuantisationGrid) -> RoadMap:
    """Nodes in metres, and the ways between them with how often each was travelled (thesis, Algorithm 5)."""
    walks = dequantise_walks(grid_walks, grid, [""] * len(grid_walks.walks))
    return build_road_map(node_positions(grid_walks, grid), walks, plane=grid.plane)


def dequantise_walks(
    grid_walks: GridWalks, grid: QuantisationGrid, ids: Sequence[str]
) -> tuple[Walk, ...]:
    """One walk for each track, with the times of its knots in seconds, or None where the lattice keeps no times."""
    claimed = piece_time_ranges(grid_walks, grid) if grid_walks.timed else None
    spans = claimed if claimed is not None else [None] * len(grid_walks.walks)
    timed = [
        grid_walks.timed and number not in grid_walks.untimed
        for number in range(len(grid_walks.walks))
    ]
    return tuple(
        Walk(
            name,
            walk.nodes,
            knot_times(walk.time_steps, grid) if has_times else None,
            walk.gaps,
            own if has_times else None,
        )
        for name, walk, own, has_times in zip(ids, grid_walks.walks, spans, timed, strict=True)
    )


def choose_grid(
    nodes: NDArray[np.float64],
    walks: Sequence[Walk],
    *,
    space: int,
    time: int,
    plane: Plane | None = None,
) -> QuantisationGrid:
    """Return the lattice with these quanta whose zero is the lowest corner of the nodes and the first knot.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Metres.
    walks : sequence of Walk
        At least one; those without times start at 0.
    space, time : int
        Indices of the quanta, see :func:`gpszip.model.grid.step_size`.
    plane : Plane, optional
        Where the nodes lie on the earth.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([7.25, 9.0]), np.array([False]))
    >>> choose_grid(np.array([[1.0, 2.0], [0.5, 4.0]]), [walk], space=128, time=128).origin
    (500, 2000)
    """
    origin = tuple(int(c) for c in np.floor(nodes.min(axis=0) * 1000 + _TIME_TOLERANCE))
    first = min((float(walk.times[0]) for walk in walks if walk.times is not None), default=0.0)
    return QuantisationGrid(
        origin, int(np.floor(first * 1000 + _TIME_TOLERANCE)), space, time, plane
    )


def quantise_walks(
    nodes: NDArray[np.float64], walks: Sequence[Walk], grid: QuantisationGrid
) -> GridWalks:
    """Round nodes and knots to a lattice.

    Every instant between the first and the last knot of a piece still is after rounding. Where two pieces come to lie so
    near that no cell is free between them, the gap between them is dropped: the lattice is too coarse to tell of it.
    Nodes that no walk visits are dropped. A piece of one knot between two cells becomes a stop around it.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Metres.
    walks : sequence of Walk
        All with times, or all without.
    grid : Frame
        The lattice.

    Returns
    -------
    LatticeWalks
        Nodes in the order in which the walks first visit them.

    Examples
    --------
    >>> walk = Walk("a", np.array([1, 0], np.int32), np.array([0.4, 2.2]), np.array([False]))
    >>> grid_walks = quantise_walks(np.array([[0.0], [3.3]]), [walk], QuantisationGrid((0,), 0, 128, 128))
    >>> grid_walks.nodes.tolist(), grid_walks.walks[0].nodes.tolist(), grid_walks.walks[0].time_steps.tolist()
    ([[3], [0]], [0, 1], [0, 3])
    """
    timed = all(walk.times is not None for walk in walks)
    corner = np.asarray(grid.origin, dtype=np.float64) / 1000
    coordinates = np.rint((nodes - corner) / step_size(grid.space)).astype(np.int64)
    return number_by_visit(
        GridWalks(coordinates, tuple(_quantise_walk(walk, grid) for walk in walks), timed)
    )


def merge_grid_walks(groups: Sequence[GridWalks]) -> GridWalks:
    """Put the walks of several lattices with one frame on one map, on which equal places are one node.

    Examples
    --------
    >>> there = GridWalk(np.array([0, 1], np.int32), np.array([0, 1]), np.array([False]))
    >>> one, two = (GridWalks(np.array(nodes), (there,)) for nodes in ([[0], [5]], [[5], [9]]))
    >>> joined = merge_grid_walks([one, two])
    >>> joined.nodes.tolist(), joined.walks[1].nodes.tolist()
    ([[0], [5], [9]], [1, 2])
    """
    places, number = np.unique(
        np.concatenate([group.nodes for group in groups]), axis=0, return_inverse=True
    )
    names = np.split(
        number.reshape(-1).astype(np.int32), np.cumsum([len(group.nodes) for group in groups])[:-1]
    )
    walks = tuple(
        GridWalk(own[walk.nodes], walk.time_steps, walk.gaps)
        for group, own in zip(groups, names, strict=True)
        for walk in group.walks
    )
    first = np.cumsum([0] + [len(group.walks) for group in groups]).tolist()
    untimed = frozenset(
        start + number
        for start, group in zip(first, groups, strict=False)
        for number in group.untimed
    )
    return number_by_visit(
        GridWalks(places, walks, groups[0].timed, concatenated_ends(groups), untimed)
    )


def mark_piece_ends(gaps: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each knot is the first, and whether it is the last, of a piece between gaps; two bool arrays of shape (k + 1,).

    Examples
    --------
    >>> first, last = mark_piece_ends(np.array([False, True]))
    >>> first.tolist(), last.tolist()
    ([True, False, True], [False, True, True])
    """
    return np.append(True, gaps), np.append(gaps, True)


def _quantise_walk(walk: Walk, grid: QuantisationGrid) -> GridWalk:
    if walk.times is None:
        return GridWalk(walk.nodes, np.zeros(len(walk.nodes), np.int64), walk.gaps)
    step = step_size(grid.time)
    at = (walk.times - grid.epoch / 1000) / step
    nodes, at, gaps = _double_single_knots(walk.nodes, at, walk.gaps, _SINGLE_KNOT_TOLERANCE / step)
    first, last = mark_piece_ends(gaps)
    near = min(_TIME_TOLERANCE / step, 0.25)
    floor = np.where(first & last, np.rint(at), np.floor(at + near))
    cells = _make_increasing(
        np.where(first, floor, np.where(last, np.ceil(at - near), np.rint(at))).astype(np.int64)
    )
    # A piece that could not start in time is joined to the one before it, which leaves no instant out.
    late = cells[1:] > floor[1:]
    return GridWalk(nodes, cells, gaps & ~late)


def _double_single_knots(
    nodes: NDArray[np.int32], at: NDArray[np.float64], gaps: NDArray[np.bool_], slack: float
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]]:
    """Double the knots that are whole pieces and lie farther than ``slack`` cells from a cell."""
    first, last = mark_piece_ends(gaps)
    double = first & last & (np.abs(at - np.rint(at)) > slack)
    copies = 1 + double
    after = np.repeat(np.append(gaps, True), copies)
    after[(np.cumsum(copies) - copies)[double]] = False
    return np.repeat(nodes, copies), np.repeat(at, copies), after[:-1]


def _make_increasing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Move cells up, as little as can be, until each is above the one before."""
    ramp = np.arange(len(cells))
    raised: NDArray[np.int64] = np.maximum.accumulate(cells - ramp) + ramp
    return raised
