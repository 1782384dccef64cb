"""Between an archive's lattice of integers and a road map with walks in metres and seconds.

The way out, :func:`node_positions`, :func:`road_map_of` and :func:`walks_of`, is exact. The way in, :func:`to_lattice`,
rounds nodes to the nearest lattice point and knots to the nearest cell; only the ends of a piece are rounded away from
it, so that every instant that a piece covered is still covered.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.ends import claimed_spans
from gpszip.codec.walks import number_by_visit
from gpszip.model.frame import Frame, Plane, quantum
from gpszip.model.lattice import LatticeWalk, LatticeWalks, ends_joined
from gpszip.model.road_map import RoadMap
from gpszip.model.walk import Walk
from gpszip.walks.counting import count_edges

__all__ = ["frame_for", "join_lattices", "knot_times", "node_positions", "piece_ends", "road_map_of", "to_lattice", "walks_of"]

#: Times this near to a cell, in seconds, are on it: float64 seconds since 1970 are no finer.
_ON_CELL = 1e-6

#: A piece of a single knot may lie this far from its sample, in seconds; farther, and it takes two knots around it.
_COVER = 5e-4


def node_positions(lattice: LatticeWalks, frame: Frame) -> NDArray[np.float64]:
    """Positions of the nodes in metres, shape (V, d)."""
    return np.asarray(frame.origin, dtype=np.float64) / 1000 + lattice.nodes * quantum(frame.space)


def knot_times(cells: NDArray[np.int64], frame: Frame) -> NDArray[np.float64]:
    """Seconds in the log's own zero at each cell.

    Examples
    --------
    >>> knot_times(np.array([0, 3]), Frame(origin=(0, 0), epoch=1500, space=128, time=136))
    array([1.5, 7.5])
    """
    return frame.epoch / 1000 + cells.astype(np.float64) * quantum(frame.time)


def road_map_of(lattice: LatticeWalks, frame: Frame) -> RoadMap:
    """Nodes in metres, and the ways between them with how often each was travelled (thesis, Algorithm 5)."""
    walks = walks_of(lattice, frame, [""] * len(lattice.walks))
    return count_edges(node_positions(lattice, frame), walks, plane=frame.plane)


def walks_of(lattice: LatticeWalks, frame: Frame, ids: Sequence[str]) -> tuple[Walk, ...]:
    """One walk for each track, with the times of its knots in seconds, or None where the lattice keeps no times."""
    claimed = claimed_spans(lattice, frame) if lattice.timed else None
    spans = claimed if claimed is not None else [None] * len(lattice.walks)
    timed = [lattice.timed and number not in lattice.untimed for number in range(len(lattice.walks))]
    return tuple(
        Walk(name, walk.nodes, knot_times(walk.cells, frame) if has_times else None, walk.gaps, own if has_times else None)
        for name, walk, own, has_times in zip(ids, lattice.walks, spans, timed, strict=True)
    )


def frame_for(nodes: NDArray[np.float64], walks: Sequence[Walk], *, space: int, time: int, plane: Plane | None = None) -> Frame:
    """Return the lattice with these quanta whose zero is the lowest corner of the nodes and the first knot.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Metres.
    walks : sequence of Walk
        At least one; those without times start at 0.
    space, time : int
        Indices of the quanta, see :func:`gpszip.model.frame.quantum`.
    plane : Plane, optional
        Where the nodes lie on the earth.

    Examples
    --------
    >>> walk = Walk("a", np.array([0, 1], np.int32), np.array([7.25, 9.0]), np.array([False]))
    >>> frame_for(np.array([[1.0, 2.0], [0.5, 4.0]]), [walk], space=128, time=128).origin
    (500, 2000)
    """
    origin = tuple(int(c) for c in np.floor(nodes.min(axis=0) * 1000 + _ON_CELL))
    first = min((float(walk.times[0]) for walk in walks if walk.times is not None), default=0.0)
    return Frame(origin, int(np.floor(first * 1000 + _ON_CELL)), space, time, plane)


def to_lattice(nodes: NDArray[np.float64], walks: Sequence[Walk], frame: Frame) -> LatticeWalks:
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
    frame : Frame
        The lattice.

    Returns
    -------
    LatticeWalks
        Nodes in the order in which the walks first visit them.

    Examples
    --------
    >>> walk = Walk("a", np.array([1, 0], np.int32), np.array([0.4, 2.2]), np.array([False]))
    >>> lattice = to_lattice(np.array([[0.0], [3.3]]), [walk], Frame((0,), 0, 128, 128))
    >>> lattice.nodes.tolist(), lattice.walks[0].nodes.tolist(), lattice.walks[0].cells.tolist()
    ([[3], [0]], [0, 1], [0, 3])
    """
    timed = all(walk.times is not None for walk in walks)
    corner = np.asarray(frame.origin, dtype=np.float64) / 1000
    coordinates = np.rint((nodes - corner) / quantum(frame.space)).astype(np.int64)
    return number_by_visit(LatticeWalks(coordinates, tuple(_on_cells(walk, frame) for walk in walks), timed))


def join_lattices(groups: Sequence[LatticeWalks]) -> LatticeWalks:
    """Put the walks of several lattices with one frame on one map, on which equal places are one node.

    Examples
    --------
    >>> there = LatticeWalk(np.array([0, 1], np.int32), np.array([0, 1]), np.array([False]))
    >>> one, two = (LatticeWalks(np.array(nodes), (there,)) for nodes in ([[0], [5]], [[5], [9]]))
    >>> joined = join_lattices([one, two])
    >>> joined.nodes.tolist(), joined.walks[1].nodes.tolist()
    ([[0], [5], [9]], [1, 2])
    """
    places, number = np.unique(np.concatenate([group.nodes for group in groups]), axis=0, return_inverse=True)
    names = np.split(number.reshape(-1).astype(np.int32), np.cumsum([len(group.nodes) for group in groups])[:-1])
    walks = tuple(
        LatticeWalk(own[walk.nodes], walk.cells, walk.gaps) for group, own in zip(groups, names, strict=True) for walk in group.walks
    )
    first = np.cumsum([0] + [len(group.walks) for group in groups]).tolist()
    untimed = frozenset(start + number for start, group in zip(first, groups, strict=False) for number in group.untimed)
    return number_by_visit(LatticeWalks(places, walks, groups[0].timed, ends_joined(groups), untimed))


def piece_ends(gaps: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each knot is the first, and whether it is the last, of a piece between gaps; two bool arrays of shape (k + 1,).

    Examples
    --------
    >>> first, last = piece_ends(np.array([False, True]))
    >>> first.tolist(), last.tolist()
    ([True, False, True], [False, True, True])
    """
    return np.append(True, gaps), np.append(gaps, True)


def _on_cells(walk: Walk, frame: Frame) -> LatticeWalk:
    if walk.times is None:
        return LatticeWalk(walk.nodes, np.zeros(len(walk.nodes), np.int64), walk.gaps)
    step = quantum(frame.time)
    at = (walk.times - frame.epoch / 1000) / step
    nodes, at, gaps = _widen(walk.nodes, at, walk.gaps, _COVER / step)
    first, last = piece_ends(gaps)
    near = min(_ON_CELL / step, 0.25)
    floor = np.where(first & last, np.rint(at), np.floor(at + near))
    cells = _increasing(np.where(first, floor, np.where(last, np.ceil(at - near), np.rint(at))).astype(np.int64))
    # A piece that could not start in time is joined to the one before it, which leaves no instant out.
    late = cells[1:] > floor[1:]
    return LatticeWalk(nodes, cells, gaps & ~late)


def _widen(
    nodes: NDArray[np.int32], at: NDArray[np.float64], gaps: NDArray[np.bool_], slack: float
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.bool_]]:
    """Double the knots that are whole pieces and lie farther than ``slack`` cells from a cell."""
    first, last = piece_ends(gaps)
    double = first & last & (np.abs(at - np.rint(at)) > slack)
    copies = 1 + double
    after = np.repeat(np.append(gaps, True), copies)
    after[(np.cumsum(copies) - copies)[double]] = False
    return np.repeat(nodes, copies), np.repeat(at, copies), after[:-1]


def _increasing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Move cells up, as little as can be, until each is above the one before."""
    ramp = np.arange(len(cells))
    raised: NDArray[np.int64] = np.maximum.accumulate(cells - ramp) + ramp
    return raised
