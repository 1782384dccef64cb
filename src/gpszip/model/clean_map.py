"""A clean map: one edge for each street between junctions, with how it was travelled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.directed_edges import DirectedEdges, split_directions
from gpszip.model.grid import Plane
from gpszip.model.map_methods import MapMethods
from gpszip.model.projection import map_coordinates
from gpszip.model.text import axes_text, count_text

__all__ = ["CleanMap"]


@dataclass(frozen=True, eq=False, repr=False)
class CleanMap(MapMethods):
    """Edges, which are lines between junctions or dead ends, and what the walks say of each.

    Parameters
    ----------
    junctions : float64 array, shape (J, d)
        Where edges end, in metres. A ring on its own starts and ends at one of its points.
    ends : int32 array, shape (E, 2)
        Junctions u and v at which each edge starts and ends.
    offsets : int64 array, shape (E + 1,)
        Edge i runs through ``points[offsets[i]:offsets[i + 1]]``, from its junction u to its
        junction v.
    points : float64 array, shape (n, d)
        Metres.
    length : float64 array, shape (E,)
        Metres.
    forward, backward : int64 array, shape (E,)
        Traversals from u to v and from v to u.
    speed : float64 array, shape (E, 3)
        Lower quartile, median and upper quartile of the speed in m/s, over the metres travelled;
        NaN where no times are kept.
    hourly : float64 array, shape (E, b)
        Median speed in m/s in each of b equal parts of the day (UTC); NaN where nobody travelled.
        b is 0 where the log's times don't count from 1970.
    width : float64 array, shape (E,)
        Root mean square distance in metres between the edge and the knots of the walks on it; NaN
        where there is no knot.
    plane : Plane, optional
        Where the points lie on the earth, as for :class:`Track`.
    """

    junctions: NDArray[np.float64]
    ends: NDArray[np.int32]
    offsets: NDArray[np.int64]
    points: NDArray[np.float64]
    # Row i of each of these is edge i.
    length: NDArray[np.float64]
    forward: NDArray[np.int64]
    backward: NDArray[np.int64]
    speed: NDArray[np.float64]
    hourly: NDArray[np.float64]
    width: NDArray[np.float64]
    plane: Plane | None = None

    def __repr__(self) -> str:
        facts = (
            count_text(len(self.junctions), "junction"),
            count_text(len(self), "edge"),
            f"{self.length.sum():,.0f} m",
            axes_text(self.points.shape[1], self.plane),
        )
        return f"CleanMap({', '.join(facts)})"

    def __len__(self) -> int:
        return len(self.length)

    def __getitem__(self, edge: int) -> NDArray[np.float64]:
        """Points of one edge in metres, shape (n, d)."""
        return self.points[self.offsets[edge] : self.offsets[edge + 1]]

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """All ``points`` in the coordinates of the log, as for :class:`Track`."""
        return map_coordinates(self.points, self.plane)

    def directed(self) -> DirectedEdges:
        """One row for each direction in which an edge was travelled, with its count.

        Both directions of a street share one edge and one line, see :meth:`RoadMap.directed`;
        the line of a row that isn't ``forward`` runs from its end to its start.
        """
        return split_directions(self.ends, self.forward, self.backward)
