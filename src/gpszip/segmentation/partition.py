"""Partition of a whole track against given segments (remark 6.3.1, with pruning that makes it affordable)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.kernels import partition as kernels
from gpszip.segmentation.kernels.shift import best_cuts

__all__ = ["Partition", "exact_partition", "penalised_partition"]

#: ``(boundaries, labels)`` of a partition.
Partition = tuple[NDArray[np.int64], NDArray[np.int32]]

#: Samples up to which the full table of all parts is affordable.
_MAX_TABLE_SAMPLES = 1200

#: Cuts that a longer track is offered at least, and per part, before its boundaries are shifted on its samples.
_MIN_CUTS, _CUTS_PER_INTERVAL = 4000, 12

#: Runs of the penalised partition in search of a penalty that gives k parts, and how many parts it may lack in the end.
_MAX_RUNS, _MAX_MISSING = 10, 0.01


def penalised_partition(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    penalty: float,
    *,
    min_samples: int = 1,
    stride: int = 1,
) -> Partition:
    """Partition with the least cost + penalty * parts, exactly, in nearly linear time; all in ticks.

    Parameters
    ----------
    sums : Sums
        The track in ticks.
    starts, ends : float64 array, shape (m, d)
        The segments in place ticks.
    penalty : float
        Cost of a part in squared place ticks.
    min_samples : int, default 1
        Samples in a part at least.
    stride : int, default 1
        Parts begin at every ``stride``-th sample only, which takes about stride^2 times less work.
    """
    n = len(sums.t)
    cuts = np.append(np.arange(0, n, stride, dtype=np.int64), n)
    origin, label = kernels.optimal_penalised_partition(
        sums, cuts, starts, ends, float(penalty), min_samples
    )
    chosen = [len(cuts) - 1]
    while chosen[-1] > 0:
        chosen.append(int(origin[chosen[-1]]))
    return cuts[chosen[::-1]], label[chosen[-2::-1]].astype(np.int32)


def exact_partition(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    k: int,
    *,
    min_samples: int = 1,
    penalty: float | None = None,
) -> Partition:
    """Partition into exactly k parts: the best one on a short track, else a penalised one with parts split to k.

    A penalty reaches only the partitions on the lower convex hull of cost over k. Between two of them the one with
    fewer parts is taken, and its parts are split where that gains most. Above 1200 samples parts begin at some 4000
    samples, or 12 for each part.

    Parameters
    ----------
    sums : Sums
        The track in ticks.
    starts, ends : float64 array, shape (m, d)
        The segments in place ticks.
    k : int
        Number of parts.
    min_samples : int, default 1
        Samples in a part at least.
    penalty : float, optional
        Where the search for the penalty begins, in squared place ticks.
    """
    if len(sums.t) <= _MAX_TABLE_SAMPLES:
        _, boundaries, labels = kernels.optimal_k_partition(sums, starts, ends, k, min_samples)
        return boundaries, labels
    guess = penalty or float(np.square(np.ptp(sums.p, axis=0)).sum()) / k + 1.0
    return _split_intervals(
        sums,
        starts,
        ends,
        _bisect_penalty(sums, starts, ends, k, min_samples, guess),
        k,
        min_samples,
    )


def _bisect_penalty(
    sums: PrefixSums,
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    k: int,
    min_samples: int,
    penalty: float,
) -> Partition:
    """Partition of k parts or somewhat fewer, by bisection of the penalty."""
    stride = max(1, len(sums.t) // max(_MIN_CUTS, _CUTS_PER_INTERVAL * k))
    low, high, runs = 0.0, np.inf, 0
    best: Partition | None = None
    while runs < _MAX_RUNS or best is None:
        found = penalised_partition(
            sums, starts, ends, penalty, min_samples=min_samples, stride=stride
        )
        parts = len(found[1])
        if k * (1 - _MAX_MISSING) <= parts <= k:
            return found
        if parts < k:
            high, best = penalty, found if best is None or parts > len(best[1]) else best
        else:
            low = penalty
        penalty = _next_penalty(low, high)
        runs += 1
    return best


def _next_penalty(low: float, high: float) -> float:
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
    boundaries, labels = partition
    while len(labels) < k:
        gains, at, left, right = best_cuts(sums, boundaries, labels, starts, ends, min_samples)
        best = np.argsort(-gains, kind="stable")[: k - len(labels)]
        best = np.sort(best[np.isfinite(gains[best])])
        labels = labels.copy()
        labels[best] = left[best]
        boundaries, labels = (
            np.insert(boundaries, best + 1, at[best]),
            np.insert(labels, best + 1, right[best]),
        )
    return boundaries, labels
