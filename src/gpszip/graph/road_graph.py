"""A road map as a graph on arrays, with integer weights so that equally long ways are told apart exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["UNITS_PER_METRE", "RoadGraph", "build_road_graph"]

#: Weight of an edge one metre long: 1024 units to the millimetre.
UNITS_PER_METRE = 1024 * 1000


@dataclass(frozen=True, eq=False)
class RoadGraph:
    """Edges sorted by the node that they leave, each as one arc per direction in which it may be travelled.

    Parameters
    ----------
    ends : int32 array, shape (E, 2)
        The two nodes of each edge, as given.
    offsets : int64 array, shape (V + 1,)
        The arcs of node v are ``offsets[v]`` to ``offsets[v + 1] - 1``.
    targets : int32 array, shape (A,)
        Node at which each arc arrives; those of one node are sorted by it, parallel ones by their edge.
    weights : int64 array, shape (A,)
        Positive lengths in 1 / UNITS metres.
    edges : int32 array, shape (A,)
        Edge of each arc.
    ranks : int32 array, shape (V,)
        Place of each node in the lexicographic order of the coordinates, by which ties are broken.
    """

    ends: NDArray[np.int32]
    offsets: NDArray[np.int64]
    targets: NDArray[np.int32]
    weights: NDArray[np.int64]
    edges: NDArray[np.int32]
    ranks: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.ranks)


def build_road_graph(
    nodes: ArrayLike,
    edges: ArrayLike,
    *,
    lengths: ArrayLike | None = None,
    oneway: ArrayLike | None = None,
) -> RoadGraph:
    """Build the graph of a road map (thesis, definitions 4.1.8 and 4.1.9).

    Parallel edges, self-loops, edges of length zero and disconnected parts are all allowed.

    Parameters
    ----------
    nodes : array_like, shape (V, d)
        Positions in metres. An archive gives its lattice coordinates instead, whose differences are exact wherever
        the log lies; only ratios of lengths matter to paths.
    edges : array_like of int, shape (E, 2)
        The nodes that each edge joins.
    lengths : array_like, shape (E,), optional
        Lengths in metres, or any other positive cost; by default the distance between the ends.
    oneway : array_like of bool, shape (E,), optional
        Edges that may be travelled from their first node to their second only; by default none.

    Raises
    ------
    ValueError
        If an edge names a node that is not there.

    Examples
    --------
    >>> graph = build_road_graph([[0, 0], [3, 4], [3, 0]], [[0, 1], [1, 2]])
    >>> graph.offsets.tolist(), graph.targets.tolist()
    ([0, 1, 3, 4], [1, 0, 2, 1])
    >>> (graph.weights / UNITS_PER_METRE).tolist()
    [5.0, 5.0, 4.0, 4.0]
    """
    positions = np.asarray(nodes, dtype=np.float64)
    ends = np.asarray(edges, dtype=np.int32).reshape(-1, 2)
    if ends.size and (ends.min() < 0 or ends.max() >= len(positions)):
        raise ValueError(
            f"an edge names node {int(ends.max())}, but there are {len(positions)} nodes, counted from 0"
        )
    weights = _weights(positions, ends, lengths)
    sources, targets, names = _arcs(ends, oneway)
    order = np.lexsort((names, targets, sources))
    offsets = np.searchsorted(sources[order], np.arange(len(positions) + 1))
    names = names[order]
    return RoadGraph(
        ends, offsets.astype(np.int64), targets[order], weights[names], names, _ranks(positions)
    )


def _weights(
    positions: NDArray[np.float64], ends: NDArray[np.int32], lengths: ArrayLike | None
) -> NDArray[np.int64]:
    if lengths is None:
        lengths = np.sqrt(np.square(positions[ends[:, 0]] - positions[ends[:, 1]]).sum(axis=1))
    # At least 1, for canonical paths must be simple; capped, so that no path's length overflows.
    cap = float((1 << 61) // (len(positions) + 1))
    return np.clip(
        np.rint(np.asarray(lengths, dtype=np.float64) * UNITS_PER_METRE), 1.0, cap
    ).astype(np.int64)


def _arcs(
    ends: NDArray[np.int32], oneway: ArrayLike | None
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    names = np.arange(len(ends), dtype=np.int32)
    back = ends[:, 0] != ends[:, 1]  # a self-loop is one arc
    if oneway is not None:
        back &= ~np.asarray(oneway, dtype=np.bool_)
    sources = np.concatenate((ends[:, 0], ends[back, 1]))
    targets = np.concatenate((ends[:, 1], ends[back, 0]))
    return sources, targets, np.concatenate((names, names[back]))


def _ranks(positions: NDArray[np.float64]) -> NDArray[np.int32]:
    ranks = np.empty(len(positions), dtype=np.int32)
    ranks[np.lexsort(positions.T[::-1])] = np.arange(len(positions), dtype=np.int32)
    return ranks
