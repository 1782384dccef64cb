"""The (2,m)-segment mean: the best cut of a track against given segments (thesis, algorithm 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpszip.model import Track
from gpszip.segmentation.kernels.shift import best_cut
from gpszip.segmentation.state import to_ticks, track_sums

__all__ = ["TwoSegmentMean", "two_segment_mean"]


@dataclass(frozen=True)
class TwoSegmentMean:
    """A track cut in two, each side travelled along one of m segments.

    Parameters
    ----------
    cost : float
        Fitting cost in square metres.
    boundary : int
        First sample of the right part, from 0 (left part empty) to n (right part empty).
    left, right : int
        Segments of the two parts; 0 for an empty part.
    """

    cost: float
    boundary: int
    left: int
    right: int


def two_segment_mean(
    track: Track, starts: ArrayLike, ends: ArrayLike, *, min_samples: int = 0
) -> TwoSegmentMean:
    """Cut a track where two of m given segments fit best, in time n m.

    As printed, Algorithm 2 tries an empty left part, but no empty right one; here both ends are candidates.

    Parameters
    ----------
    track : Track
        n samples.
    starts, ends : array_like, shape (m, d)
        End points of the segments in metres.
    min_samples : int, default 0
        Samples in each part at least.

    Examples
    --------
    >>> track = Track("bend", [0, 1, 2, 3, 4], [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2]])
    >>> two_segment_mean(track, [[0, 0], [2, 1]], [[2, 0], [2, 2]])
    TwoSegmentMean(cost=0.0, boundary=3, left=0, right=1)
    """
    sums = track_sums(track)
    n, d = sums.p.shape
    heads, tails = (
        to_ticks(sums, np.asarray(points, dtype=np.float64).reshape(-1, d))
        for points in (starts, ends)
    )
    table = np.empty((n + 1, 2 * d + 4))
    cost, boundary, left, right = best_cut(
        sums, 0, n, min_samples, heads, tails, -1, 0, 0, table, False
    )
    return TwoSegmentMean(
        max(float(cost), 0.0) * sums.position_tick**2, int(boundary), int(left), int(right)
    )
