"""Lines moved from the grid on which they were found to the middle of what was travelled along them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import RoadMap
from gpszip.simplification.bundling import weigh_by_spacing
from gpszip.simplification.skeleton import Skeleton
from gpszip.simplification.traversals import EdgePaths

__all__ = ["move_to_centrelines"]


def move_to_centrelines(
    road_map: RoadMap,
    travelled: NDArray[np.float64],
    spacing: NDArray[np.float64],
    lines: Skeleton,
    routes: EdgePaths,
    scale: float,
) -> Skeleton:
    """Move each vertex to the mean of the nearest points on the edges that pass it, and dead ends to the nodes where walks ended.

    Parameters
    ----------
    road_map : RoadMap
        Whose edges were matched with the lines.
    travelled : float64 array, shape (E,)
        How often each edge was. Those with long chords count less, and so do distant ones, which cut a corner there.
    spacing : float64 array, shape (E,)
        Metres of each edge that may have been travelled unseen.
    lines : LineGraph
        The lines.
    routes : Routes
        What the edges take of them.
    scale : float
        Metres within which edges count.
    """
    nodes, edge = road_map.nodes[:, :2], routes.owner
    starts = nodes[road_map.edges[:, 0]]
    along = nodes[road_map.edges[:, 1]] - starts
    weight = travelled * weigh_by_spacing(spacing, travelled)
    sums, total = np.zeros_like(lines.positions), np.zeros(len(lines.positions))
    for vertex in lines.links[routes.links].T:
        nearest = _nearest_points(lines.positions[vertex], starts[edge], along[edge])
        away = ((nearest - lines.positions[vertex]) ** 2).sum(axis=1)
        _accumulate(sums, total, vertex, nearest, weight[edge] * np.exp(-away / (2 * scale**2)))
    visits = np.bincount(
        road_map.edges.ravel(), weights=np.repeat(travelled, 2), minlength=len(nodes)
    ).astype(np.float64)
    last = np.flatnonzero((routes.at >= 0) & (lines.degrees[routes.at] == 1))
    _accumulate(sums, total, routes.at[last], nodes[last], 1e6 * visits[last])
    known = total > 1e-3
    return Skeleton(
        np.where(known[:, None], sums / np.where(known, total, 1)[:, None], lines.positions),
        lines.links,
    )


def _nearest_points(
    points: NDArray[np.float64], starts: NDArray[np.float64], along: NDArray[np.float64]
) -> NDArray[np.float64]:
    share = ((points - starts) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-12)
    found: NDArray[np.float64] = starts + np.clip(share, 0, 1)[:, None] * along
    return found


def _accumulate(
    sums: NDArray[np.float64],
    total: NDArray[np.float64],
    where: NDArray[np.int32],
    points: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> None:
    for axis in range(2):
        sums[:, axis] += np.bincount(where, weights=weights * points[:, axis], minlength=len(sums))
    total += np.bincount(where, weights=weights, minlength=len(sums))
