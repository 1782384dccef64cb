"""Map and walks as integers on an archive's lattice: what is coded, bit for bit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LatticeWalk", "LatticeWalks"]


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
