"""A walk: one track as a sequence of nodes of the road map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Walk"]


@dataclass(frozen=True, eq=False)
class Walk:
    """The nodes that one track visits, the thesis's path Q, with the time at each.

    Parameters
    ----------
    id : str
        Name of the track.
    nodes : int32 array, shape (k + 1,)
        Nodes of the road map. The same node twice in a row is a stop.
    times : float64 array, shape (k + 1,), or None
        Seconds at each node in the log's own zero, strictly increasing; None in an archive without times.
    gaps : bool array, shape (k,)
        Parts during which no travel is claimed.
    spans : float64 array, shape (pieces, 2), optional
        Seconds at which travel begins and ends in each piece between gaps, at or after its first knot and at or before its last;
        None where that is at the knots.
    """

    id: str
    nodes: NDArray[np.int32]
    times: NDArray[np.float64] | None
    gaps: NDArray[np.bool_]
    spans: NDArray[np.float64] | None = None
