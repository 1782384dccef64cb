"""Initial partition by bottom-up merging on the cost of best lines, and its relaxation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import bottom_up as kernel
from gpszip.segmentation.kernels.shift import shift_free_boundaries

__all__ = ["bottom_up", "relax_boundaries"]

#: Samples of an initial block, where the track is long enough for two blocks an interval.
_BLOCK_SAMPLES = 8


def bottom_up(
    sums: PrefixSums, k: int, *, min_samples: int = 1, sweeps: int = 20
) -> NDArray[np.int64]:
    """Cut a track into exactly k intervals: merge small blocks, then relax the boundaries.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    k : int
        Number of intervals, at most n / min_samples.
    min_samples : int, default 1
        Fewest samples of an interval.
    sweeps : int, default 20
        Most rounds of relaxation.

    Returns
    -------
    int64 array, shape (k + 1,)
        Boundaries of the intervals. On typical logs their cost is within 0.1 % of the optimum
        for k free lines.
    """
    n = len(sums.t)
    # Two blocks or more for each interval where min_samples allows it: merging needs a choice.
    block = max(min_samples, min(_BLOCK_SAMPLES, n // (2 * k)))
    firsts = np.arange(n // block, dtype=np.int64) * block
    boundaries = kernel.bottom_up(sums, firsts, k)
    return relax_boundaries(sums, boundaries, min_samples=min_samples, sweeps=sweeps)


def relax_boundaries(
    sums: PrefixSums, boundaries: NDArray[np.int64], *, min_samples: int = 1, sweeps: int = 20
) -> NDArray[np.int64]:
    """Shift boundaries to where best lines on both sides cost least, until none moves.

    A sweep shifts the even boundaries, then the odd ones.
    """
    boundaries = boundaries.copy()
    for _ in range(sweeps):
        gain = shift_free_boundaries(sums, boundaries, 2, min_samples)
        gain += shift_free_boundaries(sums, boundaries, 1, min_samples)
        if gain <= 0:
            break
    return boundaries
