"""Partition of a whole track against given segments (remark 6.3.1, with pruning that makes it affordable)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels import partition as kernels
from gpszip.kernels.shift import cuts
from gpszip.kernels.sums import Sums

__all__ = ["Partition", "exact_partition", "penalised_partition"]

#: ``(boundaries, labels)`` of a partition.
Partition = tuple[NDArray[np.int64], NDArray[np.int32]]

#: Samples up to which the full table of all parts is affordable.
_TABLE = 1200

#: Runs of the penalised partition in search of a penalty that gives k parts.
_RUNS = 14


def penalised_partition(
    sums: Sums, starts: NDArray[np.float64], ends: NDArray[np.float64], penalty: float, *, shortest: int = 1
) -> Partition:
    """Partition with the least cost + penalty * parts, exactly, in nearly linear time; all in ticks."""
    _, origin, label = kernels.penalised(sums, starts, ends, float(penalty), shortest)
    firsts, b = [], len(sums.t)
    while b > 0:
        firsts.append(b)
        b = int(origin[b])
    boundaries = np.array([0, *firsts[::-1]], dtype=np.int64)
    return boundaries, label[boundaries[1:]].astype(np.int32)


def exact_partition(sums: Sums, starts: NDArray[np.float64], ends: NDArray[np.float64], k: int, *, shortest: int = 1) -> Partition:
    """Partition into exactly k parts: the best one on a short track, else a penalised one with parts split to k.

    A penalty reaches only the partitions on the lower convex hull of cost over k. Between two of them the one with
    fewer parts is taken, and its parts are split where that gains most.
    """
    if len(sums.t) <= _TABLE:
        _, boundaries, labels = kernels.layered(sums, starts, ends, k, shortest)
        return boundaries, labels
    return _split_to(sums, starts, ends, _bisected(sums, starts, ends, k, shortest), k, shortest)


def _bisected(sums: Sums, starts: NDArray[np.float64], ends: NDArray[np.float64], k: int, shortest: int) -> Partition:
    low, high = 0.0, np.inf
    penalty = float(np.square(np.ptp(sums.p, axis=0)).sum()) + 1.0
    best: Partition | None = None
    runs = 0
    while runs < _RUNS or best is None:
        found = penalised_partition(sums, starts, ends, penalty, shortest=shortest)
        parts = len(found[1])
        if parts == k:
            return found
        if parts < k:
            high, best = penalty, found if best is None or parts > len(best[1]) else best
        else:
            low = penalty
        penalty = _between(low, high)
        runs += 1
    return best


def _between(low: float, high: float) -> float:
    if high == np.inf:
        return 16.0 * low
    return float(np.sqrt(low * high)) if low > 0 else high / 16.0


def _split_to(sums: Sums, starts: NDArray[np.float64], ends: NDArray[np.float64], partition: Partition, k: int, shortest: int) -> Partition:
    boundaries, labels = partition
    while len(labels) < k:
        gains, at, left, right = cuts(sums, boundaries, labels, starts, ends, shortest)
        best = np.argsort(-gains, kind="stable")[: k - len(labels)]
        best = np.sort(best[np.isfinite(gains[best])])
        labels = labels.copy()
        labels[best] = left[best]
        boundaries, labels = np.insert(boundaries, best + 1, at[best]), np.insert(labels, best + 1, right[best])
    return boundaries, labels
