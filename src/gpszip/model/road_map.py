"""A road map: the nodes and edges that tracks share (thesis, definition 4.1.8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.directed_edges import DirectedEdges, split_directions
from gpszip.model.grid import Plane
from gpszip.model.html import to_html
from gpszip.model.map_methods import MapMethods
from gpszip.model.projection import map_coordinates
from gpszip.model.text import axes_text, count_text

__all__ = ["RoadMap"]


@dataclass(frozen=True, eq=False, repr=False)
class RoadMap(MapMethods):
    """Nodes and the edges between them, each counted by direction.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Positions in metres.
    edges : int32 array, shape (E, 2)
        Pairs of nodes (u, v), u < v, each pair once, sorted. An edge stands for both directions;
        :meth:`directed` has a row for each.
    forward, backward : int64 array, shape (E,)
        How often the edge was travelled from u to v and from v to u.
    plane : Plane, optional
        Where the nodes lie on the earth, as for :class:`Track`.

    Examples
    --------
    >>> nodes, edges = np.array([[0.0, 0.0], [5.0, 0.0]]), np.array([[0, 1]], np.int32)
    >>> RoadMap(nodes, edges, np.array([3]), np.array([1]))
    RoadMap(2 nodes, 1 edge, 4 traversals, x, y)
    """

    nodes: NDArray[np.float64]
    # Row i of these three is edge i.
    edges: NDArray[np.int32]
    forward: NDArray[np.int64]
    backward: NDArray[np.int64]
    plane: Plane | None = None

    def __repr__(self) -> str:
        facts = (
            count_text(len(self.nodes), "node"),
            count_text(len(self.edges), "edge"),
            count_text(int(self.forward.sum() + self.backward.sum()), "traversal"),
            axes_text(self.nodes.shape[1], self.plane),
        )
        return f"RoadMap({', '.join(facts)})"

    def _repr_html_(self) -> str:
        return to_html("show_map", self)

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """Positions of the nodes in the coordinates of the log, as for :class:`Track`."""
        return map_coordinates(self.nodes, self.plane)

    def directed(self) -> DirectedEdges:
        """One row for each direction in which an edge was travelled, with its count.

        The thesis's map is a directed graph (definition 4.1.8). Here an edge is one object for both
        directions, because that is what a street is: both directions share its geometry, so that a
        round trip costs one line and not two, and a traversal in one direction lets the coder
        predict the way back. The counts by direction lose nothing of the directed graph.

        Returns
        -------
        DirectedEdges
            At most 2 E rows. Directions that were never travelled have none.

        Examples
        --------
        >>> nodes, edges = np.array([[0.0, 0.0], [5.0, 0.0]]), np.array([[0, 1]], np.int32)
        >>> list(RoadMap(nodes, edges, np.array([3]), np.array([1])).directed())
        [(0, 1, 3), (1, 0, 1)]
        """
        return split_directions(self.edges, self.forward, self.backward)
