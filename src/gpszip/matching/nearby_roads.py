"""Roads near a place, for the few places that begin or end a gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Network

__all__ = ["NearbyRoads"]

Floats = NDArray[np.float64]

#: Bits of road longer than this are filed at several places; the same in metres and in usual lengths.
_BIT = 2.0


class NearbyRoads:
    """A spatial index on the bits of road between vertices.

    Parameters
    ----------
    network : Network
        The roads.

    Examples
    --------
    >>> points, both = np.array([[0.0, 0.0], [100.0, 0.0]]), np.ones(1, bool)
    >>> road = Network(points, np.zeros(1, np.int32), np.ones(1, np.int32), np.array([0, 2]), points, both, both, np.full(1, np.nan))
    >>> [found.round(1).tolist() for found in NearbyRoads(road).near(np.array([30.0, 4.0]), 5.0)]
    [[0], [30.0], [4.0], [[1.0, 0.0]]]
    """

    def __init__(self, network: Network) -> None:
        from scipy.spatial import cKDTree

        self.network = network
        points = network.points[:, :2]
        first = np.flatnonzero(
            np.diff(np.repeat(np.arange(len(network)), np.diff(network.offsets))) == 0
        )
        sizes = np.linalg.norm(points[first + 1] - points[first], axis=1)
        self._size = max(_BIT * float(np.median(sizes)), 1e-3)
        pieces = np.maximum(np.ceil(sizes / self._size), 1).astype(np.int64)
        self._bit = np.repeat(first, pieces)
        number = np.arange(len(self._bit)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        share = ((number + 0.5) / np.repeat(pieces, pieces))[:, None]
        self._tree = cKDTree(points[self._bit] * (1 - share) + points[self._bit + 1] * share)

    def near(self, place: Floats, reach: float) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Roads within so many metres, nearest first: number, offset, distance, and direction of the road there."""
        network = self.network
        bits = np.unique(self._bit[self._tree.query_ball_point(place[:2], reach + self._size / 2)])
        a, b = network.points[bits, :2], network.points[bits + 1, :2]
        step = b - a
        size = np.maximum(np.linalg.norm(step, axis=1), 1e-12)
        share = np.clip(((place[:2] - a) * step).sum(axis=1) / size**2, 0, 1)
        distance = np.linalg.norm(a + share[:, None] * step - place[:2], axis=1)
        order = np.argsort(distance, kind="stable")
        order = order[distance[order] <= reach]
        road = np.searchsorted(network.offsets, bits[order], side="right") - 1
        _, once = np.unique(road, return_index=True)
        once.sort()
        order = order[once]
        offset = network.along[bits[order]] + share[order] * size[order]
        return road[once], offset, distance[order], step[order] / size[order, None]
