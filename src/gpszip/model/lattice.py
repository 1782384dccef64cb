"""Map and walks as integers on an archive's lattice: what is coded, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LatticeWalk", "LatticeWalks", "refined"]


@dataclass(frozen=True, eq=False)
class LatticeWalk:
    """One track as a walk over nodes.

    Parameters
    ----------
    nodes : int32 array, shape (k + 1,)
        Node at each knot, k >= 0. The same node twice in a row is a stop.
    cells : int64 array, shape (k + 1,)
        Time cell of each knot, increasing; strictly, save in an archive without times, where all are 0.
    gaps : bool array, shape (k,)
        Parts during which no travel is claimed.
    """

    nodes: NDArray[np.int32]
    cells: NDArray[np.int64]
    gaps: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LatticeWalks:
    """All walks of an archive with the nodes that they share.

    Parameters
    ----------
    nodes : int64 array, shape (V, d)
        Coordinates in quanta, in the order in which the walks first visit them.
    walks : tuple of LatticeWalk
        One for each track.
    timed : bool
        Whether times are kept.
    """

    nodes: NDArray[np.int64]
    walks: tuple[LatticeWalk, ...]
    timed: bool = True


def refined(walks: LatticeWalks, times: int) -> LatticeWalks:
    """Return the same walks on the lattice with both quanta halved so many times.

    Examples
    --------
    >>> walk = LatticeWalk(np.array([0], np.int32), np.array([3]), np.zeros(0, bool))
    >>> refined(LatticeWalks(np.array([[5, -1]]), (walk,)), 2).nodes.tolist()
    [[20, -4]]
    """
    finer = tuple(LatticeWalk(walk.nodes, walk.cells << times, walk.gaps) for walk in walks.walks)
    return LatticeWalks(walks.nodes << times, finer, walks.timed)
