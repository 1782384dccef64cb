"""The (2,m)-segment mean: the best cut of a track against given segments (algorithm 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.segmentation.kernels.shift import NO_CUT, best_cut
from gpszip.segmentation.state import to_ticks

__all__ = ["TwoSegmentMean", "two_segment_mean"]


@dataclass(frozen=True)
class TwoSegmentMean:
    """A track cut into two intervals, each assigned to one of m segments.

    Parameters
    ----------
    cost : float
        Fitting cost in square metres.
    boundary : int
        First sample of the right interval, from 0 (left one empty) to n (right one empty).
    left, right : int
        Segments of the two intervals; 0 for an empty one.
    """

    cost: float
    boundary: int
    left: int
    right: int


def two_segment_mean(
    track: Track, starts: ArrayLike, ends: ArrayLike, *, min_samples: int = 0
) -> TwoSegmentMean:
    """Cut a track where two of m given segments fit best, in time n m.

    As printed, Algorithm 2 tries an empty left interval, but no empty right one; here both are
    candidates.

    Parameters
    ----------
    track : Track
        n samples.
    starts, ends : array_like, shape (m, d)
        End points of the segments in metres.
    min_samples : int, default 0
        Fewest samples of each interval.

    Examples
    --------
    >>> track = Track("bend", [0, 1, 2, 3, 4], [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2]])
    >>> two_segment_mean(track, [[0, 0], [2, 1]], [[2, 0], [2, 2]])
    TwoSegmentMean(cost=0.0, boundary=3, left=0, right=1)
    """
    # The problem in ticks.
    sums = track_sums(track)
    n, d = sums.p.shape
    tick_starts, tick_ends = (
        to_ticks(sums, np.asarray(points, dtype=np.float64).reshape(-1, d))
        for points in (starts, ends)
    )

    # One window: the entire track.
    table = np.empty((n + 1, 2 * d + 4))
    cost, boundary, left, right = best_cut(
        sums, 0, n, min_samples, tick_starts, tick_ends, NO_CUT, 0, 0, table, False
    )
    return TwoSegmentMean(
        max(float(cost), 0.0) * sums.position_tick**2, int(boundary), int(left), int(right)
    )
