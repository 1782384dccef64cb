"""The map so far: nodes, and half-edges with how often and how fast they were taken."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["BEARING_COSINES", "NO_BEARING", "HalfEdge", "WalkMap"]

#: Differences of coordinates count as at most this in a length.
_MAX_DIFFERENCE = 1 << 29

#: Lengths are in sixteenths of a space step.
_SUBSTEPS = 16

#: Nodes for which there is capacity at first; it doubles.
_FIRST_CAPACITY = 64

#: Bounds of cos * abs(cos) between the classes of bearings, and the class without a bearing.
BEARING_COSINES = (0.97, 0.75, 0.25, -0.25, -0.75, -0.97)
NO_BEARING = 7


class HalfEdge:
    """One direction of an edge.

    Parameters
    ----------
    start, end : int
        Nodes.
    length : int
        Distance between them, in sixteenths of a space step.
    """

    __slots__ = (
        "continued",
        "end",
        "followers",
        "length",
        "mean_log",
        "opposite",
        "start",
        "traversals",
    )

    #: The other direction.
    opposite: HalfEdge

    def __init__(self, start: int, end: int, length: int) -> None:
        self.start, self.end, self.length = start, end, length
        self.traversals = 0
        self.mean_log = 0  # mean logarithm of the durations
        self.continued = 0  # how often another half-edge was taken right after this one
        self.followers: dict[HalfEdge, int] = {}  # how often each was


class WalkMap:
    """Nodes and half-edges.

    Parameters
    ----------
    dimension : int
        Number of coordinates.
    """

    def __init__(self, dimension: int) -> None:
        self.positions: list[list[int]] = []
        self.departures: list[int] = []  # traversals of the half-edges of each node
        self._half_edges: list[dict[int, HalfEdge]] = []  # of each node, by where they end
        self._places = np.zeros((_FIRST_CAPACITY, dimension), np.int64)
        self._gap_ends = np.zeros(_FIRST_CAPACITY, np.int64)
        self._end_weights = np.zeros(_FIRST_CAPACITY, np.int64)

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def places(self) -> NDArray[np.int64]:
        """Positions of the nodes, shape (V, d)."""
        return self._places[: len(self)]

    @property
    def gap_ends(self) -> NDArray[np.int64]:
        """How often gaps began or ended at each node; may be changed in place."""
        return self._gap_ends[: len(self)]

    @property
    def end_weights(self) -> NDArray[np.int64]:
        """Weight of each node as a start, end or target; may be changed in place."""
        return self._end_weights[: len(self)]

    def add_node(self, position: Sequence[int]) -> int:
        """Add a node; return its number."""
        # Twice the capacity, where it is used up.
        node = len(self)
        if node == len(self._places):
            self._places = np.concatenate([self._places, np.zeros_like(self._places)])
            self._gap_ends = np.concatenate([self._gap_ends, np.zeros_like(self._gap_ends)])
            self._end_weights = np.concatenate(
                [self._end_weights, np.zeros_like(self._end_weights)]
            )

        self.positions.append(list(position))
        self.departures.append(0)
        self._half_edges.append({})
        # A node weighs 1 from the start, so that any node can be chosen.
        self._places[node], self._end_weights[node] = position, 1
        return node

    def half_edges(self, u: int) -> list[HalfEdge]:
        """Half-edges of a node, the newest first."""
        # Dictionaries keep the order of insertion; the format has the newest first.
        return list(reversed(self._half_edges[u].values()))

    def degree(self, u: int) -> int:
        """Number of half-edges of a node."""
        return len(self._half_edges[u])

    def neighbours(self, u: int) -> list[int]:
        """Nodes to which a node has an edge."""
        return list(self._half_edges[u])

    def half_edge(self, u: int, v: int) -> HalfEdge | None:
        """Half-edge from u to v, if there is one."""
        return self._half_edges[u].get(v)

    def take_edge(self, u: int, v: int, incoming: HalfEdge | None) -> HalfEdge:
        """Count a step from u to v, on a new edge if need be, after the half-edge ``incoming``."""
        # The two halves of a new edge.
        edge = self.half_edge(u, v)
        if edge is None:
            length = self.length(u, v)
            edge, back = HalfEdge(u, v, length), HalfEdge(v, u, length)
            edge.opposite, back.opposite = back, edge
            self._half_edges[u][v], self._half_edges[v][u] = edge, back

        # Count the step, and that it followed on the last one.
        edge.traversals += 1
        self.departures[u] += 1
        if incoming is not None:
            incoming.followers[edge] = incoming.followers.get(edge, 0) + 1
            incoming.continued += 1
        return edge

    def length(self, u: int, v: int) -> int:
        """Distance between two nodes in sixteenths of a space step."""
        square = 0
        for a, b in zip(self.positions[u], self.positions[v], strict=True):
            step = min(abs(a - b), _MAX_DIFFERENCE)
            square += step * step
        # The sum is an exact integer. It is rounded once, to the double whose root the format
        # takes.
        return int(_SUBSTEPS * math.sqrt(float(square)))

    def bearing(self, before: int | None, u: int, v: int) -> int:
        """Turn from the step that led to u towards v, in eight classes; 7 without such a step.

        See :func:`gpszip.codec.kernels.step_coder._bearing`.
        """
        # Without a step that led to u, there is no turn.
        if before is None:
            return NO_BEARING

        # Scalar product, and squared lengths.
        dot = step_square = square = 0.0
        positions = self.positions
        for x, y, z in zip(positions[before], positions[u], positions[v], strict=True):
            a, b = float(y - x), float(z - y)
            dot += a * b
            step_square += a * a
            square += b * b
        if step_square == 0 or square == 0:
            return NO_BEARING

        # Count the bounds that cos * |cos| is not above; that takes no square root.
        cosine = dot * abs(dot) / (step_square * square)
        bounds = enumerate(BEARING_COSINES)
        return next((i for i, bound in bounds if cosine > bound), len(BEARING_COSINES))
