"""Initial partition by Douglas-Peucker with the synchronised distance (thesis, algorithm 1, line 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import douglas_peucker as kernel

__all__ = ["douglas_peucker"]


def douglas_peucker(sums: PrefixSums, k: int) -> NDArray[np.int64]:
    """Cut a track into exactly k parts, best first: always at the sample farthest from its chord at its own time.

    Parameters
    ----------
    sums : Sums
        The track in ticks.
    k : int
        Number of parts, at most n.

    Returns
    -------
    int64 array, shape (k + 1,)
        Boundaries of the parts. Time n log k on typical logs.
    """
    boundaries: NDArray[np.int64] = kernel.douglas_peucker(sums.t, sums.p, k)
    return boundaries
