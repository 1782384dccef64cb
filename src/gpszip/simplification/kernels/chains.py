"""Edges strung together at the nodes where nothing branches off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["chain_edges"]


@jit
def _follow_chain(
    offsets: NDArray[np.int64],
    targets: NDArray[np.int32],
    edges: NDArray[np.int32],
    arc: int,
    used: NDArray[np.bool_],
    nodes: NDArray[np.int32],
    strung: NDArray[np.int32],
    place: int,
    way: int,
) -> int:
    # A way has one node more than edges: with those of the ways before, nodes[i + way] is where strung[i] starts.
    while True:
        strung[place] = edges[arc]
        used[edges[arc]] = True
        place += 1
        node = targets[arc]
        nodes[place + way] = node
        first = offsets[node]
        if offsets[node + 1] - first != 2:
            return place
        arc = first if not used[edges[first]] else first + 1
        if used[edges[arc]]:
            return place


@jit
def chain_edges(
    offsets: NDArray[np.int64], targets: NDArray[np.int32], edges: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]:
    """Offsets and nodes of the ways, and the edges that they consist of; first those between ends and junctions, then rings."""
    used = np.zeros(count, np.bool_)
    starts = np.zeros(count + 1, np.int64)
    nodes = np.zeros(2 * count, np.int32)
    strung = np.zeros(count, np.int32)
    way = place = 0
    for rings in (False, True):
        for node in range(len(offsets) - 1):
            if not rings and offsets[node + 1] - offsets[node] == 2:
                continue
            for arc in range(offsets[node], offsets[node + 1]):
                if not used[edges[arc]]:
                    starts[way] = place + way
                    nodes[place + way] = node
                    place = _follow_chain(
                        offsets, targets, edges, arc, used, nodes, strung, place, way
                    )
                    way += 1
    starts[way] = place + way
    return starts[: way + 1].copy(), nodes[: place + way].copy(), strung
