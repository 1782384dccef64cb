"""Centrelines: the skeleton's vertices move from grid cells to the middle of the travel there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import RoadMap
from gpszip.simplification.bundling import weigh_by_spacing
from gpszip.simplification.skeleton import Skeleton
from gpszip.simplification.traversals import EdgePaths

__all__ = ["move_to_centrelines"]

#: Weight of the nodes at dead ends, against 1 for an edge: there, the nodes alone count.
_DEAD_END_WEIGHT = 1e6

#: Least sum of weights at a vertex that moves.
_MIN_WEIGHT = 1e-3


def move_to_centrelines(
    road_map: RoadMap,
    counts: NDArray[np.float64],
    spacing: NDArray[np.float64],
    skeleton: Skeleton,
    paths: EdgePaths,
    scale: float,
) -> Skeleton:
    """Move each vertex to the weighted mean of the nearest points on the edges that pass it.

    An edge has less weight if its unobserved length is large or if it is far from the vertex; both
    mean that it cuts a corner. Dead ends move to the nodes at which walks end.

    Parameters
    ----------
    road_map : RoadMap
        The map whose edges were matched to the skeleton.
    counts : float64 array, shape (E,)
        Traversals of each edge.
    spacing : float64 array, shape (E,)
        Unobserved length of each edge in metres.
    skeleton : Skeleton
        The vertices to move.
    paths : EdgePaths
        Path of each edge on the skeleton.
    scale : float
        Standard deviation in metres of the Gaussian that weighs edges by distance.
    """
    # Weigh edges by traversals, and less if much of them is unobserved.
    nodes, edge = road_map.nodes[:, :2], paths.owner
    starts = nodes[road_map.edges[:, 0]]
    directions = nodes[road_map.edges[:, 1]] - starts
    weight = counts * weigh_by_spacing(spacing, counts)
    sums, total = np.zeros_like(skeleton.positions), np.zeros(len(skeleton.positions))

    # Add up the nearest points on the edges, for both ends of each link.
    for vertex in skeleton.links[paths.links].T:
        nearest = _nearest_points(skeleton.positions[vertex], starts[edge], directions[edge])
        square = ((nearest - skeleton.positions[vertex]) ** 2).sum(axis=1)
        _accumulate(sums, total, vertex, nearest, weight[edge] * np.exp(-square / (2 * scale**2)))

    # At dead ends, add the nodes.
    visits = np.bincount(
        road_map.edges.ravel(), weights=np.repeat(counts, 2), minlength=len(nodes)
    ).astype(np.float64)
    last = np.flatnonzero((paths.vertices >= 0) & (skeleton.degrees[paths.vertices] == 1))
    _accumulate(sums, total, paths.vertices[last], nodes[last], _DEAD_END_WEIGHT * visits[last])

    # Vertices without travel stay.
    known = total > _MIN_WEIGHT
    means = sums / np.where(known, total, 1)[:, None]
    return Skeleton(np.where(known[:, None], means, skeleton.positions), skeleton.links)


def _nearest_points(
    points: NDArray[np.float64], starts: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Point nearest to each point on the segment from a start along a direction."""
    square = np.maximum((directions * directions).sum(axis=1), 1e-12)
    fraction = ((points - starts) * directions).sum(axis=1) / square
    nearest: NDArray[np.float64] = starts + np.clip(fraction, 0, 1)[:, None] * directions
    return nearest


def _accumulate(
    sums: NDArray[np.float64],
    total: NDArray[np.float64],
    vertices: NDArray[np.int32],
    points: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> None:
    """Add weighted points and weights to the sums of their vertices, in place."""
    for axis in range(2):
        weighted = weights * points[:, axis]
        sums[:, axis] += np.bincount(vertices, weights=weighted, minlength=len(sums))
    total += np.bincount(vertices, weights=weights, minlength=len(sums))
