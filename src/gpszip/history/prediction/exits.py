"""What may follow each directed edge of a network: the edges that leave its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Network

__all__ = ["Exits", "list_exits"]

#: Fills the rows of directed edges with fewer exits than others.
_NONE = -1


@dataclass(frozen=True, eq=False, repr=False)
class Exits:
    """Directed edges that may follow each directed edge, and the angles of the turns.

    A directed edge is one number: ``2 * edge``, plus 1 where it is travelled backward.

    Parameters
    ----------
    options : int64 array, shape (2 E, D)
        Directed edges that leave the end of each, in increasing order, then -1. The same edge
        backward, a turn back, is one of them.
    cosines : float64 array, shape (2 E, D)
        Cosine of the angle of each turn: 1 straight on, -1 back; 0 where there is no exit.
    heads : int64 array, shape (2 E,)
        Node at the end of each directed edge.
    """

    options: NDArray[np.int64]
    cosines: NDArray[np.float64]
    heads: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.heads)

    @property
    def exists(self) -> NDArray[np.bool_]:
        """Whether there is an exit, shape (2 E, D)."""
        exists: NDArray[np.bool_] = self.options != _NONE
        return exists

    @property
    def turns_back(self) -> NDArray[np.bool_]:
        """Whether each exit is the same edge in the other direction, shape (2 E, D)."""
        turns_back: NDArray[np.bool_] = self.options == (np.arange(len(self)) ^ 1)[:, None]
        return turns_back


def list_exits(network: Network) -> Exits:
    """List the exits of each directed edge of a network.

    Parameters
    ----------
    network : Network
        Roads. A direction that is closed is no exit, unless an edge has no other one.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> exits = list_exits(ring(4).network)
    >>> exits.options[0].tolist(), exits.cosines[0].round().tolist()
    ([1, 4], [-1.0, 0.0])
    """
    # Nodes and directions at both ends of each directed edge.
    directed = 2 * len(network)
    tails = np.stack((network.starts, network.ends), axis=1).ravel().astype(np.int64)
    heads = np.stack((network.ends, network.starts), axis=1).ravel().astype(np.int64)
    is_open = np.stack((network.forward, network.backward), axis=1).ravel()
    first, last = _directions(network)

    # Edges by their tails; one that is closed serves where nothing else leaves a node.
    serves = is_open | ~np.isin(tails, tails[is_open])
    leaving = np.flatnonzero(serves)
    leaving = leaving[np.argsort(tails[leaving], kind="stable")]
    bounds = np.searchsorted(tails[leaving], np.arange(len(network.nodes) + 1))

    # A row for each directed edge, as wide as the most exits.
    counts = np.diff(bounds)[heads] if directed else np.zeros(0, np.int64)
    column = np.arange(counts.max(initial=1))
    index = np.minimum(bounds[heads][:, None] + column, max(len(leaving) - 1, 0))
    options = np.where(column < counts[:, None], leaving[index], _NONE)
    cosines = (last[:, None] * first[options]).sum(axis=2)
    return Exits(options, np.where(options == _NONE, 0.0, cosines), heads)


def _directions(network: Network) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors in which directed edges begin and end; 0 where two vertices coincide."""
    points, bounds = network.points, network.offsets
    begin = points[bounds[:-1] + 1] - points[bounds[:-1]]
    end = points[bounds[1:] - 1] - points[bounds[1:] - 2]
    first = np.stack((begin, -end), axis=1).reshape(-1, network.dimension)
    last = np.stack((end, -begin), axis=1).reshape(-1, network.dimension)
    return _unit(first), _unit(last)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    norms = np.linalg.norm(vectors, axis=1, keepdims=True)
    # A vector of length zero stays one.
    unit: NDArray[np.float64] = vectors / np.where(norms > 0, norms, 1.0)
    return unit
