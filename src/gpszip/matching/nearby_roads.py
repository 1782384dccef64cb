"""Roads near a position, for the few positions at which a gap begins or ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Network

__all__ = ["NearbyRoads"]

Floats = NDArray[np.float64]

#: Line segments longer than this many medians are entered in the index several times.
_MAX_LENGTH = 2.0

#: Least length in metres of an entry of the index.
_MIN_ENTRY = 1e-3

#: Least length in metres of a segment by which is divided.
_MIN_LENGTH = 1e-12


class NearbyRoads:
    """A spatial index over the line segments of roads: a k-d tree of their middles.

    Parameters
    ----------
    network : Network
        The roads.

    Examples
    --------
    >>> points, both = np.array([[0.0, 0.0], [100.0, 0.0]]), np.ones(1, bool)
    >>> start, end, speed = np.zeros(1, np.int32), np.ones(1, np.int32), np.full(1, np.nan)
    >>> road = Network(points, start, end, np.array([0, 2]), points, both, both, speed)
    >>> columns = NearbyRoads(road).near(np.array([30.0, 4.0]), 5.0)
    >>> [column.round(1).tolist() for column in columns]
    [[0], [30.0], [4.0], [[1.0, 0.0]]]
    """

    def __init__(self, network: Network) -> None:
        from scipy.spatial import cKDTree

        # Line segments of roads, by their first vertices.
        self.network = network
        points = network.points[:, :2]
        road_of = np.repeat(np.arange(len(network)), np.diff(network.offsets))
        first = np.flatnonzero(np.diff(road_of) == 0)
        lengths = np.linalg.norm(points[first + 1] - points[first], axis=1)

        # Long ones cut into entries of equal length.
        self._max_length = max(_MAX_LENGTH * float(np.median(lengths)), _MIN_ENTRY)
        entries = np.maximum(np.ceil(lengths / self._max_length), 1).astype(np.int64)
        self._vertex = np.repeat(first, entries)
        number = np.arange(len(self._vertex)) - np.repeat(np.cumsum(entries) - entries, entries)
        fraction = ((number + 0.5) / np.repeat(entries, entries))[:, None]
        self._tree = cKDTree(
            points[self._vertex] * (1 - fraction) + points[self._vertex + 1] * fraction
        )

    def near(
        self, position: Floats, radius: float
    ) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Find the roads within a radius in metres, nearest first.

        Returns number, offset, distance, and unit vector of each road there.
        """
        # Segments whose middles are near, and their nearest points.
        network = self.network
        near = self._tree.query_ball_point(position[:2], radius + self._max_length / 2)
        vertices = np.unique(self._vertex[near])
        a, b = network.points[vertices, :2], network.points[vertices + 1, :2]
        step = b - a
        length = np.maximum(np.linalg.norm(step, axis=1), _MIN_LENGTH)
        fraction = np.clip(((position[:2] - a) * step).sum(axis=1) / length**2, 0, 1)
        distance = np.linalg.norm(a + fraction[:, None] * step - position[:2], axis=1)

        # The nearest segment of each road.
        order = np.argsort(distance, kind="stable")
        order = order[distance[order] <= radius]
        road = np.searchsorted(network.offsets, vertices[order], side="right") - 1
        _, nearest = np.unique(road, return_index=True)
        nearest.sort()
        order = order[nearest]
        offset = network.along[vertices[order]] + fraction[order] * length[order]
        return road[nearest], offset, distance[order], step[order] / length[order, None]
