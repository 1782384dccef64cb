"""The edges of a map as a directed graph: one row for each direction (thesis, definition 4.1.8)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text

__all__ = ["DirectedEdges", "split_directions"]


@dataclass(frozen=True, eq=False, repr=False)
class DirectedEdges:
    """Directions in which the edges of a map were travelled.

    Iterating yields ``(start, end, traversals)`` for each.

    Parameters
    ----------
    starts, ends : int32 array, shape (D,)
        Nodes (junctions of a clean map) from which and to which each row leads.
    traversals : int64 array, shape (D,)
        How often it was travelled, at least once.
    edges : int32 array, shape (D,)
        Edge of the map of which it is a direction.
    forward : bool array, shape (D,)
        Whether it leads along the edge as the map stores it, rather than against it.
    """

    starts: NDArray[np.int32]
    ends: NDArray[np.int32]
    traversals: NDArray[np.int64]
    edges: NDArray[np.int32]
    forward: NDArray[np.bool_]

    def __repr__(self) -> str:
        edges = count_text(len(self), "directed edge")
        return f"DirectedEdges({edges}, {count_text(int(self.traversals.sum()), 'traversal')})"

    def __len__(self) -> int:
        return len(self.starts)

    def __iter__(self) -> Iterator[tuple[int, int, int]]:
        # Lists hold Python's own integers, which a program can put into JSON or networkx as they
        # are.
        return zip(self.starts.tolist(), self.ends.tolist(), self.traversals.tolist(), strict=True)


def split_directions(
    pairs: NDArray[np.int32], forward: NDArray[np.int64], backward: NDArray[np.int64]
) -> DirectedEdges:
    """Directed edges from undirected ones with a count for each direction.

    Parameters
    ----------
    pairs : int32 array, shape (E, 2)
        Nodes u and v of each edge.
    forward, backward : int64 array, shape (E,)
        Traversals from u to v and from v to u.

    Returns
    -------
    DirectedEdges
        In the order of the edges, forward before backward.

    Examples
    --------
    >>> pairs = np.array([[0, 1], [1, 2]], np.int32)
    >>> list(split_directions(pairs, np.array([3, 0]), np.array([1, 2])))
    [(0, 1, 3), (1, 0, 1), (2, 1, 2)]
    """
    # Row 2 e is edge e forward, row 2 e + 1 the same edge backward.
    both = np.stack([pairs, pairs[:, ::-1]], axis=1).reshape(-1, 2)
    traversals = np.stack([forward, backward], axis=1).reshape(-1)
    # A direction that nobody travelled has no row.
    travelled = np.flatnonzero(traversals)
    return DirectedEdges(
        starts=both[travelled, 0],
        ends=both[travelled, 1],
        traversals=traversals[travelled],
        edges=(travelled // 2).astype(np.int32),
        forward=travelled % 2 == 0,
    )
