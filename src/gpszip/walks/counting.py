"""Roads from walks: which edges were travelled, how often, and in which direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.model import GridWalk, Plane, RoadMap, Walk

__all__ = ["build_road_map", "build_road_map_from_counts", "find_travelled_segments"]


def build_road_map(
    nodes: ArrayLike, walks: Sequence[Walk | GridWalk], *, plane: Plane | None = None
) -> RoadMap:
    """Make a road map of what the walks travelled.

    Parameters
    ----------
    nodes : array_like, shape (V, d)
        Positions in metres, of all nodes that the walks name.
    walks : sequence of Walk or LatticeWalk
        Their stops and gaps are no travel and don't count.
    plane : Plane, optional
        Where the nodes lie on the earth.

    Returns
    -------
    RoadMap
        All nodes, and each pair of nodes between which someone travelled.

    Examples
    --------
    >>> walk = Walk("0", np.array([0, 1, 1, 0, 2]), None, np.array([False, False, False, True]))
    >>> road_map = build_road_map([[0, 0], [5, 0], [9, 9]], [walk])
    >>> road_map.edges.tolist(), road_map.forward.tolist(), road_map.backward.tolist()
    ([[0, 1]], [1], [1])
    """
    hops = [_travelled_pairs(walk) for walk in walks]
    pairs = np.concatenate(hops) if hops else np.zeros((0, 2), np.int32)
    return build_road_map_from_counts(nodes, pairs, np.ones(len(pairs), np.int64), plane=plane)


def build_road_map_from_counts(
    nodes: ArrayLike,
    pairs: NDArray[np.int32],
    counts: NDArray[np.int64],
    *,
    plane: Plane | None = None,
) -> RoadMap:
    """Make a road map of directed pairs of different nodes, shape (p, 2), each travelled as often as its count says.

    Examples
    --------
    >>> road_map = build_road_map_from_counts([[0, 0], [5, 0]], np.array([[0, 1], [1, 0]]), np.array([3, 4]))
    >>> road_map.forward.tolist(), road_map.backward.tolist()
    ([3], [4])
    """
    positions = np.asarray(nodes, dtype=np.float64)
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    keys, places = np.unique(low * len(positions) + high, return_inverse=True)
    edges = np.stack(np.divmod(keys, max(len(positions), 1)), axis=1).astype(np.int32)
    backwards = pairs[:, 0] > pairs[:, 1]
    # Not bincount, which adds weights as floating point numbers.
    directed = np.zeros((2, len(keys)), dtype=np.int64)
    np.add.at(directed, (backwards.astype(np.intp), places), counts)
    return RoadMap(positions, edges, directed[0], directed[1], plane)


def find_travelled_segments(walk: Walk | GridWalk) -> NDArray[np.bool_]:
    """Which parts of a walk lead to another node: no gap, no stop, and not all before its start or after its end.

    Examples
    --------
    >>> walk = Walk("0", np.array([0, 1, 2]), np.array([0.0, 5.0, 9.0]), np.zeros(2, bool), np.array([[0.0, 5.0]]))
    >>> find_travelled_segments(walk).tolist()
    [True, False]
    """
    moved: NDArray[np.bool_] = ~walk.gaps & (walk.nodes[1:] != walk.nodes[:-1])
    if isinstance(walk, GridWalk) or walk.spans is None or walk.times is None:
        return moved

    # only the first and the last part of a piece may lie outside of the time in which travel is claimed
    piece = np.append(0, np.cumsum(walk.gaps))[:-1]
    begins, ends = walk.spans[piece].T if len(piece) else (np.zeros(0), np.zeros(0))
    return np.asarray(moved & (walk.times[1:] > begins) & (walk.times[:-1] < ends))


def _travelled_pairs(walk: Walk | GridWalk) -> NDArray[np.int32]:
    hops = np.stack((walk.nodes[:-1], walk.nodes[1:]), axis=1)
    travelled: NDArray[np.int32] = hops[find_travelled_segments(walk)]
    return travelled
