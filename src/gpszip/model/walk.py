"""A walk: one track as a sequence of nodes of the road map."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text
from gpszip.model.timestamps import format_span

__all__ = ["Walk", "cut_at_gaps"]


@dataclass(frozen=True, eq=False, repr=False)
class Walk:
    """The nodes that one track visits, the thesis's path Q, with the time at each.

    Parameters
    ----------
    id : str
        Name of the track.
    nodes : int32 array, shape (k + 1,)
        Nodes of the road map. The same node twice running is a stop.
    times : float64 array, shape (k + 1,), or None
        Seconds at each node, strictly increasing, counted from the log's zero; None for a track
        without times.
    gaps : bool array, shape (k,)
        Whether each segment is a gap, in which no travel is claimed.
    time_ranges : float64 array, shape (pieces, 2), optional
        Seconds at which travel begins and ends in each piece between gaps: not before the first
        knot of the piece and not after the last. None where pieces begin and end at their knots.

    Examples
    --------
    >>> Walk("bus", np.array([0, 1, 0], np.int32), np.array([0.0, 5.0, 9.0]), np.zeros(2, bool))
    Walk('bus', 3 knots, 0 s to 9 s)
    """

    id: str
    nodes: NDArray[np.int32]
    times: NDArray[np.float64] | None
    gaps: NDArray[np.bool_]
    time_ranges: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        facts = [repr(self.id), count_text(len(self.nodes), "knot")]
        if self.gaps.any():
            facts.append(count_text(int(self.gaps.sum()), "gap"))
        if self.times is None:
            facts.append("no times")
        # An empty walk has no span.
        elif len(self.times):
            facts.append(format_span(float(self.times[0]), float(self.times[-1])))
        return f"Walk({', '.join(facts)})"


def cut_at_gaps(walk: Walk) -> list[slice]:
    """Knots of each piece of a walk.

    Examples
    --------
    >>> walk = Walk("a", np.arange(3, dtype=np.int32), None, np.array([False, True]))
    >>> cut_at_gaps(walk)
    [slice(0, 2, None), slice(2, 3, None)]
    """
    gaps = walk.gaps.nonzero()[0]
    if not len(gaps):
        return [slice(0, len(walk.nodes))]
    bounds = [0, *(gaps + 1).tolist(), len(walk.nodes)]
    return [slice(first, after) for first, after in pairwise(bounds)]
