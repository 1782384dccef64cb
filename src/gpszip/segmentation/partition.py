"""Optimal partition of a track against given segments.

Source: the thesis, remark 6.3.1, with pruning that makes it affordable.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import partition as kernels
from gpszip.segmentation.kernels.shift import best_cuts

__all__ = ["Partition", "exact_partition", "penalised_partition"]

#: Samples up to which the full table of all intervals is affordable: 1200^2 entries.
_MAX_TABLE_SAMPLES = 1200

#: Fewest samples of a longer track at which intervals may start.
_MIN_CUTS = 4000

#: Samples at which intervals may start, for each of the k intervals.
_CUTS_PER_INTERVAL = 12

#: Runs of the penalised partition in search of a penalty that gives k intervals.
_MAX_RUNS = 10

#: Share of the k intervals that may be missing at the end of the search.
_MAX_MISSING = 0.01


class Partition(NamedTuple):
    """A partition of a track.

    Parameters
    ----------
    boundaries : int64 array, shape (k + 1,)
        First sample of each interval, and the number of samples.
    labels : int32 array, shape (k,)
        Segment of each interval.
    """

    boundaries: NDArray[np.int64]
    labels: NDArray[np.int32]


def penalised_partition(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    penalty: float,
    *,
    min_samples: int = 1,
    stride: int = 1,
) -> Partition:
    """Find the partition with the least cost + penalty * intervals, in nearly linear time.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    starts, ends : float64 array, shape (m, d)
        The segments in position ticks.
    penalty : float
        Cost of an interval in squared position ticks.
    min_samples : int, default 1
        Fewest samples of an interval.
    stride : int, default 1
        Intervals start at every ``stride``-th sample only, which takes about stride^2 times less
        work.

    Returns
    -------
    Partition
    """
    # Best start and segment of the interval that ends at each cut.
    n = len(sums.t)
    cuts = np.append(np.arange(0, n, stride, dtype=np.int64), n)
    origin, label = kernels.optimal_penalised_partition(
        sums, cuts, starts, ends, float(penalty), min_samples
    )

    # Trace back from the end.
    chosen = [len(cuts) - 1]
    while chosen[-1] > 0:
        chosen.append(int(origin[chosen[-1]]))
    return Partition(cuts[chosen[::-1]], label[chosen[-2::-1]].astype(np.int32))


def exact_partition(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    k: int,
    *,
    min_samples: int = 1,
    penalty: float | None = None,
) -> Partition:
    """Partition a track into exactly k intervals.

    Up to 1200 samples the partition is optimal. Longer tracks get a penalised partition, whose
    penalty is found by bisection. Penalties reach only the partitions on the lower convex hull of
    cost over k; of two neighbours on it, the one with fewer intervals is chosen, and intervals
    are split where that gains most. Its intervals start at about 4000 equally spaced samples, or
    12 k if that is more.

    Parameters
    ----------
    sums : PrefixSums
        The track in ticks.
    starts, ends : float64 array, shape (m, d)
        The segments in position ticks.
    k : int
        Number of intervals.
    min_samples : int, default 1
        Fewest samples of an interval.
    penalty : float, optional
        First guess of the penalty in squared position ticks. Default: the squared extent of the
        track over k.

    Returns
    -------
    Partition
    """
    if len(sums.t) <= _MAX_TABLE_SAMPLES:
        _, boundaries, labels = kernels.optimal_k_partition(sums, starts, ends, k, min_samples)
        return Partition(boundaries, labels)

    guess = penalty or float(np.square(np.ptp(sums.p, axis=0)).sum()) / k + 1.0
    partition = _bisect_penalty(sums, starts, ends, k, min_samples, guess)
    return _split_intervals(sums, starts, ends, partition, k, min_samples)


def _bisect_penalty(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    k: int,
    min_samples: int,
    penalty: float,
) -> Partition:
    """Return a penalised partition with k intervals or up to 1 % fewer; after ten runs, any fewer.

    A higher penalty gives fewer intervals.
    """
    # Thin the cuts to a number that suffices for k intervals, and bisect the penalty.
    stride = max(1, len(sums.t) // max(_MIN_CUTS, _CUTS_PER_INTERVAL * k))
    low, high, runs = 0.0, np.inf, 0
    best: Partition | None = None
    while runs < _MAX_RUNS or best is None:
        partition = penalised_partition(
            sums, starts, ends, penalty, min_samples=min_samples, stride=stride
        )
        intervals = len(partition.labels)
        if k * (1 - _MAX_MISSING) <= intervals <= k:
            return partition

        # Keep the one with the most intervals below k.
        if intervals < k:
            high = penalty
            if best is None or intervals > len(best.labels):
                best = partition
        else:
            low = penalty
        penalty = _next_penalty(low, high)
        runs += 1
    return best


def _next_penalty(low: float, high: float) -> float:
    """Return a penalty between two bounds; beyond one of them while the other is unknown."""
    # Penalties may differ by orders of magnitude: a factor of 4 while a bound is unknown, then the
    # geometric mean.
    if high == np.inf:
        return 4.0 * low
    return float(np.sqrt(low * high)) if low > 0 else high / 4.0


def _split_intervals(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    partition: Partition,
    k: int,
    min_samples: int,
) -> Partition:
    """Split intervals where that lowers the cost most, until there are k."""
    boundaries, labels = partition
    while len(labels) < k:
        # The best intervals to split, at most as many as are missing.
        gains, cuts, left, right = best_cuts(sums, boundaries, labels, starts, ends, min_samples)
        best = np.argsort(-gains, kind="stable")[: k - len(labels)]
        best = np.sort(best[np.isfinite(gains[best])])

        # Split them all.
        labels = labels.copy()
        labels[best] = left[best]
        boundaries = np.insert(boundaries, best + 1, cuts[best])
        labels = np.insert(labels, best + 1, right[best])
    return Partition(boundaries, labels)
