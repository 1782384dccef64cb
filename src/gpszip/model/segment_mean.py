"""A (k,m)-segment mean: k parts of a track labelled with m segments (thesis, definition 4.1.7)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text

__all__ = ["SegmentMean"]


@dataclass(frozen=True, eq=False, repr=False)
class SegmentMean:
    """k consecutive parts of one track or several, each travelled along one of m directed segments.

    Part j holds the samples ``boundaries[j]`` to ``boundaries[j + 1] - 1``. It runs at constant
    speed from the start of its segment, at its first sample's time, to the end, at its last
    sample's time. (Parts and segments are the thesis's words.)

    Parameters
    ----------
    boundaries : int64 array, shape (k + 1,)
        Increasing, from 0 to the number of samples.
    labels : int32 array, shape (k,)
        Segment of each part, in [0, m).
    starts, ends : float64 array, shape (m, d)
        End points of the segments in metres.
    cost : float
        The fitting cost tau in square metres: sum of weight times squared synchronised distance.
    costs : tuple of float
        The fitting cost before the first and after every iteration of the search.
    heads : int64 array, shape (r,)
        First part of each run: a track, or a piece between two gaps. The track does not travel from
        the part before to such a part. By default there is one run.
    """

    boundaries: NDArray[np.int64]
    labels: NDArray[np.int32]
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    cost: float
    costs: tuple[float, ...] = ()
    heads: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, np.int64))

    def __repr__(self) -> str:
        samples = count_text(int(self.boundaries[-1]), "sample")
        return f"SegmentMean(k={self.k}, m={self.m}, {samples}, cost {self.cost:.6g} m^2)"

    @property
    def k(self) -> int:
        """Number of parts."""
        # Boundaries are one more: they hold the end of the last part, too.
        return len(self.labels)

    @property
    def m(self) -> int:
        """Number of segments."""
        return len(self.starts)
