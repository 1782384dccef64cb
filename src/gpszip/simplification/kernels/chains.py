"""Chains of edges between junctions and dead ends: the edges that osmnx merges to one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit

__all__ = ["chain_edges"]


@inner_uncounted
def _follow_chain(
    offsets: NDArray[np.int64],
    targets: NDArray[np.int32],
    edges: NDArray[np.int32],
    arc: int,
    used: NDArray[np.bool_],
    nodes: NDArray[np.int32],
    chained: NDArray[np.int32],
    size: int,
    chain: int,
) -> int:
    """Append the chain that begins with an arc; return the number of edges in all chains."""
    # A chain has one node more than edges. So with the earlier chains, ``nodes[i + chain]`` is
    # where the edge ``chained[i]`` starts.
    while True:
        chained[size] = edges[arc]
        used[edges[arc]] = True
        size += 1
        node = targets[arc]
        nodes[size + chain] = node

        # Stop at junctions, dead ends, and where a ring closes.
        first = offsets[node]
        if offsets[node + 1] - first != 2:
            return size
        arc = first if not used[edges[first]] else first + 1
        if used[edges[arc]]:
            return size


@jit
def chain_edges(
    offsets: NDArray[np.int64], targets: NDArray[np.int32], edges: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """Group the edges of a graph to chains.

    Parameters
    ----------
    offsets, targets, edges : arrays, shape (V + 1,), (A,) and (A,)
        Arcs by source, as in :class:`gpszip.graph.road_graph.RoadGraph`.
    count : int
        Number of edges.

    Returns
    -------
    starts : int64 array, shape (c + 1,)
        Chain i visits ``nodes[starts[i]:starts[i + 1]]``.
    nodes : int32 array, shape (count + c,)
        Nodes of all chains: first those between junctions and dead ends, then rings.
    chained : int32 array, shape (count,)
        Edges of all chains in the same order.
    """
    # Each edge is in one chain, so there are at most as many chains as edges.
    used = np.zeros(count, np.bool_)
    starts = np.zeros(count + 1, np.int64)
    nodes = np.zeros(2 * count, np.int32)
    chained = np.zeros(count, np.int32)

    # Start at junctions and dead ends first. The edges left over belong to rings.
    chain = size = 0
    for rings in (False, True):
        for node in range(len(offsets) - 1):
            if not rings and offsets[node + 1] - offsets[node] == 2:
                continue

            # Follow each arc that no chain has yet.
            for arc in range(offsets[node], offsets[node + 1]):
                if not used[edges[arc]]:
                    starts[chain] = size + chain
                    nodes[size + chain] = node
                    size = _follow_chain(
                        offsets, targets, edges, arc, used, nodes, chained, size, chain
                    )
                    chain += 1

    # Close the last chain, and drop the capacity that is left over.
    starts[chain] = size + chain
    return starts[: chain + 1].copy(), nodes[: size + chain].copy(), chained
