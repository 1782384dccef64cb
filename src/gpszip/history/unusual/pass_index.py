"""How others went from one edge of a route to a later one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PassIndex", "Support", "index_passes"]

#: Latest passes over an edge that are looked at.
_MAX_PASSES = 2_000

#: Edges by which another way may be longer.
_LONGER = 12

Ints = NDArray[np.int64]


class Support(NamedTuple):
    """How often others went from an edge to another one.

    Parameters
    ----------
    all : int
        By any way of about as many edges.
    same : int
        By exactly the same edges.
    """

    all: int
    same: int


class PassIndex(NamedTuple):
    """Directed edges of a history with the places at which each was passed.

    Parameters
    ----------
    directed : int64 array, shape (n,)
        Directed edges, route after route.
    route_end : int64 array, shape (n,)
        Index after the last edge of each one's route.
    places : int64 array, shape (n,)
        Indices of ``directed``, sorted by edge.
    bounds : int64 array, shape (2 E + 1,)
        Edge e was passed at ``places[bounds[e]:bounds[e + 1]]``, increasing.
    """

    directed: Ints
    route_end: Ints
    places: Ints
    bounds: Ints

    def count_paths(self, route: Sequence[int], first: int, last: int) -> Support:
        """How often others went from one edge of a route to a later one.

        Parameters
        ----------
        route : sequence of int
            Directed edges.
        first, last : int
            Indices of both edges, first < last.

        Examples
        --------
        >>> starts = np.array([True, False, False, True, False, False, False])
        >>> index = index_passes(np.array([0, 2, 4, 0, 6, 8, 4]), starts, 10)
        >>> index.count_paths([0, 2, 4], 0, 2)
        Support(all=2, same=1)
        """
        return self.count_all_paths(route, first, [last])[0]

    def count_all_paths(
        self, route: Sequence[int], first: int, lasts: Sequence[int]
    ) -> list[Support]:
        """How often others went from one edge of a route to each of some later ones.

        As :meth:`count_paths`, at once for all of ``lasts``, which increase.
        """
        # What followed each pass over the first edge in its route: shape (passes, edges).
        begins = self._passes(route[first])[-_MAX_PASSES:]
        steps = np.array(lasts, np.int64) - first
        ahead = np.arange(1, int(steps[-1]) + _LONGER + 1)
        place = begins[:, None] + ahead
        is_inside = place < self.route_end[begins][:, None]
        edges = np.where(is_inside, self.directed.take(place, mode="clip"), -1)

        # The next pass over each last edge: shape (passes, lasts, edges).
        way = np.array(route[first + 1 : lasts[-1] + 1])
        arrives = (edges[:, None] == way[steps - 1][:, None]) & (ahead <= steps[:, None] + _LONGER)
        taken = arrives.argmax(axis=2) + 1
        counts = arrives.any(axis=2)

        # Of several passes over the first edge before the same arrival, the last one counts.
        arrival = begins[:, None] + taken
        counts[:-1] &= ~(counts[1:] & (arrival[1:] == arrival[:-1]))

        # Those by the same edges.
        is_same = np.logical_and.accumulate(edges[:, : len(way)] == way, axis=1)[:, steps - 1]
        same = counts & (taken == steps) & is_same
        return [
            Support(*both)
            for both in zip(counts.sum(axis=0).tolist(), same.sum(axis=0).tolist(), strict=True)
        ]

    def passes(self, edge: int) -> int:
        """Return how often a directed edge was passed."""
        return int(self.bounds[edge + 1] - self.bounds[edge])

    def _passes(self, edge: int) -> Ints:
        return self.places[self.bounds[edge] : self.bounds[edge + 1]]


def index_passes(directed: Ints, starts: NDArray[np.bool_], edges: int) -> PassIndex:
    """Index the passes over each of ``edges`` directed edges.

    Parameters
    ----------
    directed : int64 array, shape (n,)
        Directed edges, route after route.
    starts : bool array, shape (n,)
        Whether a route begins with the edge.
    edges : int
        Number of directed edges of the network.
    """
    after = np.append(np.flatnonzero(starts)[1:], len(directed))
    route_end = after[np.cumsum(starts) - 1] if len(directed) else after[:0]
    places = np.argsort(directed, kind="stable")
    bounds = np.searchsorted(directed[places], np.arange(edges + 1))
    return PassIndex(directed, route_end, places, bounds)
