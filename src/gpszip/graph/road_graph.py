"""A road map as a graph on arrays. Weights are integers, so that ties between paths are exact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["UNITS_PER_METRE", "RoadGraph", "build_road_graph"]

#: Weight of an edge one metre long: 1024 units to the millimetre.
UNITS_PER_METRE = 1024 * 1000


@dataclass(frozen=True, eq=False)
class RoadGraph:
    """Arcs sorted by source node: one for each edge and direction in which it may be travelled.

    Parameters
    ----------
    ends : int32 array, shape (E, 2)
        The two nodes of each edge, as given.
    offsets : int64 array, shape (V + 1,)
        The arcs of node v are ``offsets[v]`` to ``offsets[v + 1] - 1``.
    targets : int32 array, shape (A,)
        Target node of each arc. The arcs of a node are sorted by target, parallel arcs by edge.
    weights : int64 array, shape (A,)
        Positive lengths in 1 / UNITS_PER_METRE metres.
    edges : int32 array, shape (A,)
        Edge of each arc.
    ranks : int32 array, shape (V,)
        Rank of each node in the lexicographic order of coordinates, which breaks ties.
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

    Parallel edges, self-loops, edges of length zero and disconnected components are allowed.

    Parameters
    ----------
    nodes : array_like, shape (V, d)
        Positions in metres. Archives pass integer grid coordinates instead, whose differences are
        exact wherever the log is; only ratios of lengths matter to paths.
    edges : array_like of int, shape (E, 2)
        End nodes of each edge.
    lengths : array_like, shape (E,), optional
        Lengths in metres, or any other positive cost; by default the distance between the ends.
    oneway : array_like of bool, shape (E,), optional
        Whether each edge may be travelled from its first node to its second only; by default none.

    Raises
    ------
    ValueError
        If an edge names a node that doesn't exist.

    Examples
    --------
    >>> graph = build_road_graph([[0, 0], [3, 4], [3, 0]], [[0, 1], [1, 2]])
    >>> graph.offsets.tolist(), graph.targets.tolist()
    ([0, 1, 3, 4], [1, 0, 2, 1])
    >>> (graph.weights / UNITS_PER_METRE).tolist()
    [5.0, 5.0, 4.0, 4.0]
    """
    # Check the input.
    positions = np.asarray(nodes, dtype=np.float64)
    ends = np.asarray(edges, dtype=np.int32).reshape(-1, 2)
    if ends.size and (ends.min() < 0 or ends.max() >= len(positions)):
        raise ValueError(
            f"an edge names node {int(ends.max())}, but there are {len(positions)} nodes, "
            "counted from 0"
        )

    # Sort the arcs by source, target and edge.
    weights = _edge_weights(positions, ends, lengths)
    sources, targets, edge = _list_arcs(ends, oneway)
    order = np.lexsort((edge, targets, sources))
    # The arcs of node v begin at the first source that is not below v.
    offsets = np.searchsorted(sources[order], np.arange(len(positions) + 1))
    edge = edge[order]
    return RoadGraph(
        ends, offsets.astype(np.int64), targets[order], weights[edge], edge, _rank_nodes(positions)
    )


def _edge_weights(
    positions: NDArray[np.float64], ends: NDArray[np.int32], lengths: ArrayLike | None
) -> NDArray[np.int64]:
    """Integer weight of each edge: at least 1, and so small that no path overflows."""
    if lengths is None:
        lengths = np.sqrt(np.square(positions[ends[:, 0]] - positions[ends[:, 1]]).sum(axis=1))

    # At least 1, because canonical paths must be simple. Capped, because sums must fit in 62 bits.
    cap = float((1 << 61) // (len(positions) + 1))
    units = np.rint(np.asarray(lengths, dtype=np.float64) * UNITS_PER_METRE)
    return np.clip(units, 1.0, cap).astype(np.int64)


def _list_arcs(
    ends: NDArray[np.int32], oneway: ArrayLike | None
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Source, target and edge of each arc; first all arcs along their edges, then those against."""
    edge = np.arange(len(ends), dtype=np.int32)
    has_reverse = ends[:, 0] != ends[:, 1]  # a self-loop is one arc
    if oneway is not None:
        has_reverse &= ~np.asarray(oneway, dtype=np.bool_)
    sources = np.concatenate((ends[:, 0], ends[has_reverse, 1]))
    targets = np.concatenate((ends[:, 1], ends[has_reverse, 0]))
    return sources, targets, np.concatenate((edge, edge[has_reverse]))


def _rank_nodes(positions: NDArray[np.float64]) -> NDArray[np.int32]:
    """Rank of each node in the lexicographic order of coordinates; equal nodes by index."""
    ranks = np.empty(len(positions), dtype=np.int32)
    # The last key of lexsort counts most, so that the first coordinate comes last.
    ranks[np.lexsort(positions.T[::-1])] = np.arange(len(positions), dtype=np.int32)
    return ranks
