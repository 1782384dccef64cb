"""Initial partition by Douglas-Peucker with the synchronised distance (thesis, algorithm 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import douglas_peucker as kernel

__all__ = ["douglas_peucker"]


def douglas_peucker(sums: PrefixSums, k: int) -> NDArray[np.int64]:
    """Cut a track into exactly k intervals, always at the sample farthest from its chord.

    The distance of a sample is taken to the position on the chord at the sample's own time.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    k : int
        Number of intervals, at most n.

    Returns
    -------
    int64 array, shape (k + 1,)
        Boundaries of the intervals. Time n log k on typical logs.
    """
    # Splits are in order of distance: put them in order of time.
    return np.sort(kernel.douglas_peucker(sums.t, sums.p, k))
