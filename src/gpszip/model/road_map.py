"""A road map: the places and ways that tracks share (thesis, definition 4.1.8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.grid import Plane

__all__ = ["RoadMap"]


@dataclass(frozen=True, eq=False)
class RoadMap:
    """Nodes and the ways between them, each counted by direction.

    Parameters
    ----------
    nodes : float64 array, shape (V, d)
        Positions in metres.
    edges : int32 array, shape (E, 2)
        Pairs of nodes (u, v), u < v, each pair once, sorted. An edge is one object, travelled both ways.
    forward, backward : int64 array, shape (E,)
        How often the edge was travelled from u to v and from v to u.
    plane : Plane, optional
        Where the nodes lie on the earth, as for :class:`Track`.
    """

    nodes: NDArray[np.float64]
    edges: NDArray[np.int32]
    forward: NDArray[np.int64]
    backward: NDArray[np.int64]
    plane: Plane | None = None
