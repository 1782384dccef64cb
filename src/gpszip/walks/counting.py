"""The road map of walks: which edges were travelled, how often, and in which direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.model import GridWalk, Plane, RoadMap, Walk

__all__ = ["build_road_map", "build_road_map_from_counts", "find_travelled_segments"]


def build_road_map(
    nodes: ArrayLike, walks: Sequence[Walk | GridWalk], *, plane: Plane | None = None
) -> RoadMap:
    """Build the road map of the edges that walks travel.

    Parameters
    ----------
    nodes : array_like, shape (V, d)
        Positions in metres of all nodes.
    walks : sequence of Walk or GridWalk
        Walks on these nodes. Stops and gaps don't count as travel.
    plane : Plane, optional
        Where the nodes lie on the earth.

    Returns
    -------
    RoadMap
        All nodes, and an edge for each pair of nodes with travel between them.

    Examples
    --------
    >>> walk = Walk("0", np.array([0, 1, 1, 0, 2]), None, np.array([False, False, False, True]))
    >>> road_map = build_road_map([[0, 0], [5, 0], [9, 9]], [walk])
    >>> road_map.edges.tolist(), road_map.forward.tolist(), road_map.backward.tolist()
    ([[0, 1]], [1], [1])
    """
    pairs = _travelled_pairs(walks)
    return build_road_map_from_counts(nodes, pairs, np.ones(len(pairs), np.int64), plane=plane)


def build_road_map_from_counts(
    nodes: ArrayLike,
    pairs: NDArray[np.int32],
    counts: NDArray[np.int64],
    *,
    plane: Plane | None = None,
) -> RoadMap:
    """Build a road map from counted pairs of nodes.

    Parameters
    ----------
    nodes : array_like, shape (V, d)
        Positions in metres.
    pairs : int32 array, shape (p, 2)
        Directed pairs of different nodes; a pair may occur several times.
    counts : int64 array, shape (p,)
        Traversals of each pair.
    plane : Plane, optional
        Where the nodes lie on the earth.

    Examples
    --------
    >>> pairs, counts = np.array([[0, 1], [1, 0]]), np.array([3, 4])
    >>> road_map = build_road_map_from_counts([[0, 0], [5, 0]], pairs, counts)
    >>> road_map.forward.tolist(), road_map.backward.tolist()
    ([3], [4])
    """
    # One edge for both directions of a pair.
    positions = np.asarray(nodes, dtype=np.float64)
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    # One number for each pair, so that unique() sorts by u, then by v.
    keys, edge = np.unique(low * len(positions) + high, return_inverse=True)
    edges = np.stack(np.divmod(keys, max(len(positions), 1)), axis=1).astype(np.int32)

    # Add up the counts, not by bincount, which adds them as floats.
    is_backward = pairs[:, 0] > pairs[:, 1]
    directed = np.zeros((2, len(keys)), dtype=np.int64)
    np.add.at(directed, (is_backward.astype(np.intp), edge), counts)
    return RoadMap(positions, edges, directed[0], directed[1], plane)


def find_travelled_segments(walk: Walk | GridWalk) -> NDArray[np.bool_]:
    """Which segments of a walk are travel to another node, shape (k,).

    Gaps and stops are no travel, nor are segments entirely before the start or after the end of
    their piece.

    Examples
    --------
    >>> nodes, times, gaps = np.array([0, 1, 2]), np.array([0.0, 5.0, 9.0]), np.zeros(2, bool)
    >>> walk = Walk("0", nodes, times, gaps, time_ranges=np.array([[0.0, 5.0]]))
    >>> find_travelled_segments(walk).tolist()
    [True, False]
    """
    moved: NDArray[np.bool_] = ~walk.gaps & (walk.nodes[1:] != walk.nodes[:-1])
    if isinstance(walk, Walk) and _has_time_ranges(walk):
        moved &= _are_within_pieces([walk])
    return moved


def _travelled_pairs(walks: Sequence[Walk | GridWalk]) -> NDArray[np.int32]:
    """Nodes at both ends of each travelled segment of all walks, shape (t, 2)."""
    if not walks:
        return np.zeros((0, 2), np.int32)

    # All segments; those that lead from one walk to the next are none.
    nodes = np.concatenate([walk.nodes for walk in walks])
    counts = np.array([len(walk.gaps) for walk in walks])
    starts = np.ones(len(nodes), np.bool_)
    starts[np.cumsum(counts + 1) - 1] = False
    first = np.flatnonzero(starts)
    pairs = np.stack((nodes[first], nodes[first + 1]), axis=1)

    # Those that are travel.
    moved = ~np.concatenate([walk.gaps for walk in walks]) & (pairs[:, 0] != pairs[:, 1])
    bounded = [walk for walk in walks if isinstance(walk, Walk) and _has_time_ranges(walk)]
    if bounded:
        is_bounded = [isinstance(walk, Walk) and _has_time_ranges(walk) for walk in walks]
        moved[np.repeat(is_bounded, counts)] &= _are_within_pieces(bounded)
    travelled: NDArray[np.int32] = pairs[moved]
    return travelled


def _has_time_ranges(walk: Walk) -> bool:
    return walk.times is not None and walk.time_ranges is not None


def _are_within_pieces(walks: Sequence[Walk]) -> NDArray[np.bool_]:
    """Which segments of walks with time ranges lie at least in part in that of their piece."""
    # The piece of each knot: a new one begins with each walk and after each gap.
    times = np.concatenate([walk.times for walk in walks if walk.times is not None])
    ranges = np.concatenate([walk.time_ranges for walk in walks if walk.time_ranges is not None])
    ends = np.cumsum([len(walk.nodes) for walk in walks]) - 1
    starts = np.ones(len(times), np.bool_)
    starts[ends] = False
    begins_piece = np.ones(len(times), np.bool_)
    first = np.flatnonzero(starts)
    begins_piece[first + 1] = np.concatenate([walk.gaps for walk in walks])
    piece = np.cumsum(begins_piece) - 1

    # Only the first and the last segment of a piece can lie outside of its time range.
    begins, after = ranges[piece[first]].T
    return np.asarray((times[first + 1] > begins) & (times[first] < after))
