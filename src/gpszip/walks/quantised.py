"""Conversion between walks in metres and seconds and the integer grid walks of an archive.

:func:`node_positions`, :func:`dequantise_road_map` and :func:`dequantise_walks` read a quantisation
grid exactly. :func:`quantise_walks` rounds nodes to the nearest grid point and knots to the nearest
time step. Only the ends of a piece are rounded outwards, so that it covers all times as before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.ends import stored_time_ranges
from gpszip.codec.numbering import number_by_visit
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

#: Times this near to a time step, in seconds, are on it: float64 seconds since 1970 are no finer.
_TIME_TOLERANCE = 1e-6

#: Largest rounding error in seconds of a piece with a single knot. Beyond it, the piece gets two
#: knots around its sample.
_SINGLE_KNOT_TOLERANCE = 5e-4

#: Largest tolerance of the ends of pieces, in time steps, for steps near the resolution of floats.
_MAX_END_TOLERANCE = 0.25


def node_positions(grid_walks: GridWalks, grid: QuantisationGrid) -> NDArray[np.float64]:
    """Positions of the nodes in metres, shape (V, d)."""
    return np.asarray(grid.origin, dtype=np.float64) / 1000 + grid_walks.nodes * step_size(
        grid.space
    )


def knot_times(time_steps: NDArray[np.int64], grid: QuantisationGrid) -> NDArray[np.float64]:
    """Seconds in the log's own zero at each time step.

    Examples
    --------
    >>> grid = QuantisationGrid(origin=(0, 0), epoch=1500, space=128, time=136)
    >>> knot_times(np.array([0, 3]), grid)
    array([1.5, 7.5])
    """
    return grid.epoch / 1000 + time_steps.astype(np.float64) * step_size(grid.time)


def dequantise_road_map(grid_walks: GridWalks, grid: QuantisationGrid) -> RoadMap:
    """Road map with nodes in metres and the counts of traversals (thesis, Algorithm 5)."""
    walks = dequantise_walks(grid_walks, grid, [""] * len(grid_walks.walks))
    return build_road_map(node_positions(grid_walks, grid), walks, plane=grid.plane)


def dequantise_walks(
    grid_walks: GridWalks, grid: QuantisationGrid, ids: Sequence[str]
) -> tuple[Walk, ...]:
    """Walks in metres and seconds.

    Parameters
    ----------
    grid_walks : GridWalks
        The walks on the grid.
    grid : QuantisationGrid
        The grid.
    ids : sequence of str
        Name of the track of each walk.

    Returns
    -------
    tuple of Walk
        Walks of untimed tracks have None for times and time ranges.
    """
    # Time ranges of the pieces, where the archive keeps them.
    time_ranges = stored_time_ranges(grid_walks, grid) if grid_walks.timed else None

    # Times of all knots at once, since there may be many short walks.
    steps = [walk.time_steps for walk in grid_walks.walks] if grid_walks.timed else []
    all_times = knot_times(np.concatenate(steps), grid) if steps else np.zeros(0)

    walks, end = [], 0
    for number, (name, walk) in enumerate(zip(ids, grid_walks.walks, strict=True)):
        start, end = end, end + len(walk.nodes)
        timed = grid_walks.timed and number not in grid_walks.untimed
        times = all_times[start:end] if timed else None
        of_walk = time_ranges[number] if timed and time_ranges is not None else None
        walks.append(Walk(name, walk.nodes, times, walk.gaps, of_walk))
    return tuple(walks)


def choose_grid(
    nodes: NDArray[np.float64],
    walks: Sequence[Walk],
    *,
    space: int,
    time: int,
    plane: Plane | None = None,
) -> QuantisationGrid:
    """Grid with given steps, whose origin is the lowest corner of the nodes and the first knot.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Positions in metres.
    walks : sequence of Walk
        At least one walk; walks without times start at 0.
    space, time : int
        Indices of the steps in space and time, see :func:`gpszip.model.grid.step_size`.
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
    epoch = int(np.floor(first * 1000 + _TIME_TOLERANCE))
    return QuantisationGrid(origin, epoch, space, time, plane)


def quantise_walks(
    nodes: NDArray[np.float64], walks: Sequence[Walk], grid: QuantisationGrid
) -> GridWalks:
    """Round nodes and knots to a quantisation grid.

    - Rounded pieces cover all times that they covered before.
    - If no time step is free between two pieces, the gap between them is dropped: the grid is too
      coarse to represent it.
    - A piece of one knot between two time steps becomes a stop around it.
    - Nodes that no walk visits are dropped.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Positions in metres.
    walks : sequence of Walk
        All with times, or all without.
    grid : QuantisationGrid
        The grid.

    Returns
    -------
    GridWalks
        Nodes in the order in which the walks first visit them.

    Examples
    --------
    >>> walk = Walk("a", np.array([1, 0], np.int32), np.array([0.4, 2.2]), np.array([False]))
    >>> grid = QuantisationGrid((0,), 0, 128, 128)
    >>> grid_walks = quantise_walks(np.array([[0.0], [3.3]]), [walk], grid)
    >>> grid_walks.nodes.tolist()
    [[3], [0]]
    >>> grid_walks.walks[0].nodes.tolist(), grid_walks.walks[0].time_steps.tolist()
    ([0, 1], [0, 3])
    """
    timed = all(walk.times is not None for walk in walks)
    corner = np.asarray(grid.origin, dtype=np.float64) / 1000
    coordinates = np.rint((nodes - corner) / step_size(grid.space)).astype(np.int64)
    rounded = tuple(_quantise_walk(walk, grid) for walk in walks)
    return number_by_visit(GridWalks(coordinates, rounded, timed))


def merge_grid_walks(groups: Sequence[GridWalks]) -> GridWalks:
    """Merge groups of walks on the same quantisation grid; equal nodes become one.

    Examples
    --------
    >>> walk = GridWalk(np.array([0, 1], np.int32), np.array([0, 1]), np.array([False]))
    >>> first, second = (GridWalks(np.array(n), (walk,)) for n in ([[0], [5]], [[5], [9]]))
    >>> merged = merge_grid_walks([first, second])
    >>> merged.nodes.tolist(), merged.walks[1].nodes.tolist()
    ([[0], [5], [9]], [1, 2])
    """
    # Number the distinct nodes.
    coordinates, number = np.unique(
        np.concatenate([group.nodes for group in groups]), axis=0, return_inverse=True
    )
    bounds = np.cumsum([len(group.nodes) for group in groups])[:-1]
    numbers = np.split(number.reshape(-1).astype(np.int32), bounds)

    # Renumber the nodes of all walks.
    walks = tuple(
        GridWalk(group_numbers[walk.nodes], walk.time_steps, walk.gaps)
        for group, group_numbers in zip(groups, numbers, strict=True)
        for walk in group.walks
    )

    # Shift the numbers of untimed walks.
    first = np.cumsum([0] + [len(group.walks) for group in groups]).tolist()
    untimed = frozenset(
        start + number
        for start, group in zip(first, groups, strict=False)
        for number in group.untimed
    )
    return number_by_visit(
        GridWalks(coordinates, walks, groups[0].timed, concatenated_ends(groups), untimed)
    )


def mark_piece_ends(gaps: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each knot is the first of a piece, and whether it is the last.

    Parameters
    ----------
    gaps : bool array, shape (k,)
        Whether each segment is a gap.

    Returns
    -------
    first, last : bool arrays, shape (k + 1,)

    Examples
    --------
    >>> first, last = mark_piece_ends(np.array([False, True]))
    >>> first.tolist(), last.tolist()
    ([True, False, True], [False, True, True])
    """
    return np.append(True, gaps), np.append(gaps, True)


def _quantise_walk(walk: Walk, grid: QuantisationGrid) -> GridWalk:
    """Round the knots of a walk to time steps; its nodes are not changed."""
    # A shape has zeros for time steps.
    if walk.times is None:
        return GridWalk(walk.nodes, np.zeros(len(walk.nodes), np.int64), walk.gaps)

    # Times in time steps.
    step = step_size(grid.time)
    exact = (walk.times - grid.epoch / 1000) / step
    nodes, exact, gaps = _double_single_knots(
        walk.nodes, exact, walk.gaps, _SINGLE_KNOT_TOLERANCE / step
    )

    # Round the start of a piece down, its end up, and inner knots to the nearest step.
    first, last = mark_piece_ends(gaps)
    tolerance = min(_TIME_TOLERANCE / step, _MAX_END_TOLERANCE)
    starts = np.where(first & last, np.rint(exact), np.floor(exact + tolerance))
    rounded = np.where(first, starts, np.where(last, np.ceil(exact - tolerance), np.rint(exact)))
    time_steps = _make_increasing(rounded.astype(np.int64))

    # A piece that can't start in time is joined to the one before it, which covers all its times.
    is_late = time_steps[1:] > starts[1:]
    return GridWalk(nodes, time_steps, gaps & ~is_late)


def _double_single_knots(
    nodes: NDArray[np.int32], exact: NDArray[np.float64], gaps: NDArray[np.bool_], tolerance: float
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]]:
    """Double the knots that are pieces by themselves and not on a time step.

    Parameters
    ----------
    nodes, exact, gaps : arrays, shape (k + 1,), (k + 1,) and (k,)
        The walk, with times in time steps.
    tolerance : float
        Distance in time steps up to which a knot is on a time step.
    """
    first, last = mark_piece_ends(gaps)
    is_doubled = first & last & (np.abs(exact - np.rint(exact)) > tolerance)
    copies = 1 + is_doubled

    # There is no gap between the two copies.
    gap_after = np.repeat(np.append(gaps, True), copies)
    # The index of a knot's first copy is the number of copies before it.
    gap_after[(np.cumsum(copies) - copies)[is_doubled]] = False
    return np.repeat(nodes, copies), np.repeat(exact, copies), gap_after[:-1]


def _make_increasing(time_steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Increase time steps as little as possible until each is above the one before."""
    # With i taken off entry i, what must increase need only not fall. The maximum so far is the
    # least sequence above that does not.
    ramp = np.arange(len(time_steps))
    raised: NDArray[np.int64] = np.maximum.accumulate(time_steps - ramp) + ramp
    return raised
