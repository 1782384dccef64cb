"""Trips on edges: travel between stops of five minutes or more, and between gaps.

These trips are cut from traversals alone, so that the trips of an archive and a route that is
still under way are cut by one rule: a long stop ends a trip, whatever comes next.
:mod:`gpszip.history.stays`, for ``gpszip trips``, looks at the positions before and after: it
joins trips around short pauses and tells stays from places where a receiver lies still. Its trips
may therefore hold several of these.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.history.traversals import Traversals
from gpszip.model import Network

__all__ = ["MIN_STOP", "Trips", "cut_trips", "nearest_ends"]

#: Seconds for which an agent stands where a trip ends.
MIN_STOP = 300.0


@dataclass(frozen=True, eq=False, repr=False)
class Trips:
    """Trips as slices of traversals.

    Parameters
    ----------
    first, after : int64 array, shape (t,)
        Trip i has the traversals ``first[i]`` to ``after[i] - 1``.
    of : int64 array, shape (n,)
        Trip of each traversal.
    """

    first: NDArray[np.int64]
    after: NDArray[np.int64]
    of: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.first)


def cut_trips(traversals: Traversals) -> Trips:
    """Cut travel where a track has a gap or leaves the map, and after each stop.

    Parameters
    ----------
    traversals : Traversals
        In the order of travel. An edge on which an agent stood for MIN_STOP seconds or more is the
        last one of its trip.
    """
    stood = np.nan_to_num(traversals.standing) >= MIN_STOP
    begins = traversals.starts | np.append(True, stood)[: len(traversals)]
    first = np.flatnonzero(begins)
    after = np.append(first[1:], len(traversals)) if len(first) else first
    return Trips(first, after, np.cumsum(begins) - 1)


def nearest_ends(
    network: Network, traversals: Traversals, rows: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Node nearest to the place at which each of some traversals ends."""
    edge = traversals.edge[rows]
    is_past_middle = traversals.end[rows] > 0.5 * network.lengths[edge]
    nodes: NDArray[np.int64] = np.where(is_past_middle, network.ends[edge], network.starts[edge])
    return nodes.astype(np.int64)
