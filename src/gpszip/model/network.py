"""A road network: a graph with shapes, directions and speeds on a metric plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpszip.model.grid import Plane
from gpszip.model.text import axes_text, count_text

__all__ = ["Network"]


@dataclass(frozen=True, eq=False)
class Network:
    """Roads between crossings, each with its shape and the directions in which it may be travelled.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Crossings and dead ends in metres on the plane.
    starts, ends : int32 array, shape (E,)
        Nodes at which each road begins and ends.
    offsets : int64 array, shape (E + 1,)
        Road e has the vertices ``points[offsets[e]:offsets[e + 1]]``, at least two.
    points : float64 array, shape (N, d)
        Vertices of all roads in metres, from the start node of a road to its end node, both
        included.
    forward, backward : bool array, shape (E,)
        Whether a road may be travelled from its start to its end, and from its end to its start.
    speeds : float64 array, shape (E,)
        Expected speed in metres a second, NaN where unknown.
    ids : sequence of str, optional
        Id of each road in the source; roads that were split share one.
    plane : Plane, optional
        The planes of a network in degrees; None for one in x and y.
    names : sequence of str, optional
        Street names, empty where a road has none; None where the source has no names at all.
    error : float, optional
        Error in metres of a map that was learned from logs: what is much farther from all roads is
        off the map. None for roads of another source.

    Examples
    --------
    >>> corner = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]])
    >>> start, end, offsets = np.zeros(1, np.int32), np.ones(1, np.int32), np.array([0, 3])
    >>> yes, speed = np.array([True]), np.array([8.0])
    >>> network = Network(corner[[0, 2]], start, end, offsets, corner, yes, yes, speed)
    >>> len(network), network.lengths.tolist(), network.road(0).tolist()
    (1, [70.0], [[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]])
    """

    nodes: NDArray[np.float64]
    starts: NDArray[np.int32]
    ends: NDArray[np.int32]
    offsets: NDArray[np.int64]
    points: NDArray[np.float64]
    forward: NDArray[np.bool_]
    backward: NDArray[np.bool_]
    speeds: NDArray[np.float64]
    ids: Sequence[str] | None = None
    plane: Plane | None = None
    names: Sequence[str] | None = None
    error: float | None = None

    def __repr__(self) -> str:
        facts = (
            count_text(len(self.nodes), "node"),
            count_text(len(self), "road"),
            f"{float(self.lengths.sum()) / 1000:,.1f} km",
            axes_text(self.dimension, self.plane),
        )
        return f"Network({', '.join(facts)})"

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return int(self.points.shape[1])

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Metres along each road, shape (E,)."""
        # The last vertex of a road is as far along it as the road is long.
        along = self.along
        lengths: NDArray[np.float64] = along[self.offsets[1:] - 1] - along[self.offsets[:-1]]
        return lengths

    @cached_property
    def along(self) -> NDArray[np.float64]:
        """Metres from the start of its road to each vertex, shape (N,)."""
        # Distance from the vertex before. At the first vertex of a road that would be the way from
        # the last road, which nobody drives, so it is 0.
        steps = np.zeros(len(self.points))
        # A network without roads has no vertices to measure.
        if len(steps):
            steps[1:] = np.sqrt((np.diff(self.points, axis=0) ** 2).sum(axis=1))
            steps[self.offsets[:-1]] = 0.0

        # Sum up over all roads at once, and take off what was summed up before each road.
        total = np.cumsum(steps)
        along: NDArray[np.float64] = total - np.repeat(
            total[self.offsets[:-1]], np.diff(self.offsets)
        )
        return along

    @property
    def one_way(self) -> NDArray[np.bool_]:
        """Whether each road may be travelled in one direction only, shape (E,)."""
        one_way: NDArray[np.bool_] = self.forward != self.backward
        return one_way

    def two_way(self) -> Network:
        """The same roads, those open in one direction open in both, as for pedestrians."""
        # A road that is closed in both directions stays closed.
        is_open = self.forward | self.backward
        return replace(self, forward=is_open, backward=is_open)

    def label(self, index: int) -> str:
        """The name of a road for people: its street name, else its id, else its number."""
        # OpenStreetMap has many roads without a name, such as link roads and paths.
        name = self.names[index] if self.names is not None else ""
        return name or (self.ids[index] if self.ids is not None else str(index))

    def road(self, index: int) -> NDArray[np.float64]:
        """Vertices of one road, shape (n, d), from its start node to its end node."""
        return self.points[self.offsets[index] : self.offsets[index + 1]]

    def middle(self, index: int) -> NDArray[np.float64]:
        """Position halfway along one road, shape (d,)."""
        line, along = self.road(index), self.along[self.offsets[index] : self.offsets[index + 1]]
        return np.array([np.interp(0.5 * along[-1], along, axis) for axis in line.T])
