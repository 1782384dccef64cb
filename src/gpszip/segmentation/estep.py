"""The expectation step: better boundaries and labels for given segments (thesis, section 6.3).

All forms keep the number of intervals and never raise tau. They cut windows of two neighbouring
intervals again with Algorithm 2. As printed, it lacks the empty right interval; here both ends
are candidates, no interval becomes shorter than ``min_samples``, and the current state is a
candidate, too, without which tau could rise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.run.executor import Executor, Serial
from gpszip.segmentation.kernels.shift import shift_boundaries
from gpszip.segmentation.partition import exact_partition
from gpszip.segmentation.state import EMState, total_cost

__all__ = ["exact", "linear", "naive", "odd_even"]

#: Boundaries that a worker shifts at a time. The result doesn't depend on it.
_BATCH = 64


def naive(sums: PrefixSums, state: EMState, *, min_samples: int = 1) -> EMState:
    """Shift the boundaries in turn, with new sums for each candidate (6.3.1); time n^2 m / k."""
    return _shift_one_by_one(sums, state, min_samples, naive=True)


def linear(sums: PrefixSums, state: EMState, *, min_samples: int = 1) -> EMState:
    """Shift the boundaries in turn with the incremental 2-segment mean (6.3.2); time n m.

    The result is that of :func:`naive`.
    """
    return _shift_one_by_one(sums, state, min_samples, naive=False)


def _shift_one_by_one(
    sums: PrefixSums, state: EMState, min_samples: int, *, naive: bool
) -> EMState:
    """Shift all boundaries from left to right."""
    boundaries, labels = state.boundaries.copy(), state.labels.copy()
    segments = (state.starts, state.ends)
    for head, after in state.runs:
        shift_boundaries(
            sums, boundaries, labels, *segments, head + 1, after, 1, min_samples, naive
        )
    return replace(state, boundaries=boundaries, labels=labels)


def odd_even(
    sums: PrefixSums, state: EMState, *, min_samples: int = 1, executor: Executor | None = None
) -> EMState:
    """Shift all even boundaries, then all odd ones (6.3.3).

    The windows of even boundaries don't overlap, nor do those of odd ones, so that they can be
    shifted in parallel.
    """
    even = _shift_every_second(sums, state, 2, min_samples, executor)
    return _shift_every_second(sums, even, 1, min_samples, executor)


def _shift_every_second(
    sums: PrefixSums, state: EMState, first: int, min_samples: int, executor: Executor | None
) -> EMState:
    """Shift every second boundary from ``first``, in batches."""
    boundaries, labels = state.boundaries.copy(), state.labels.copy()
    batches = _batches(first, state, executor)
    shifted = (executor or Serial()).map(partial(_shift_batch, sums, state, min_samples), batches)
    for low, new_boundaries, new_labels in shifted:
        boundaries[low : low + len(new_boundaries)] = new_boundaries
        labels[low - 1 : low - 1 + len(new_labels)] = new_labels
    return replace(state, boundaries=boundaries, labels=labels)


def _batches(first: int, state: EMState, executor: Executor | None) -> Iterator[tuple[int, int]]:
    """Yield ranges of boundaries that start with one to be shifted; one for a run if serial.

    The boundary between two runs is in no range.
    """
    # An even step, so that each range starts with a boundary of the same parity.
    k = len(state.labels)
    step = 2 * _BATCH if executor else k + k % 2 + 2
    for head, after in state.runs:
        for low in range(head + first, after, step):
            yield low, min(low + step, after)


def _shift_batch(
    sums: PrefixSums, state: EMState, min_samples: int, batch: tuple[int, int]
) -> tuple[int, NDArray[np.int64], NDArray[np.int32]]:
    """Shift every second boundary of the range (low, high).

    Returns low, the boundaries from ``low`` on and the labels from ``low - 1`` on.
    """
    # The boundaries to be shifted, and their neighbours on both sides.
    low, high = batch
    last = low + (high - 1 - low) // 2 * 2
    boundaries = state.boundaries[low - 1 : last + 2].copy()
    labels = state.labels[low - 1 : last + 1].copy()
    shift_boundaries(
        sums, boundaries, labels, state.starts, state.ends, 1, len(labels), 2, min_samples, False
    )
    return low, boundaries[1:-1], labels


def exact(
    sums: PrefixSums, state: EMState, *, min_samples: int = 1, executor: Executor | None = None
) -> EMState:
    """Partition the entire track again into k intervals; at least as good as :func:`odd_even`.

    There is one run only.
    """
    shifted = odd_even(sums, state, min_samples=min_samples, executor=executor)

    # First guess of the penalty: one more interval gains a share of the cost of an interval.
    k = len(state.labels)
    penalty = total_cost(sums, state) / (4 * k)
    boundaries, labels = exact_partition(
        sums, state.starts, state.ends, k, min_samples=min_samples, penalty=penalty
    )

    # On long tracks the partition is at some samples only: shift its boundaries, too.
    partitioned = replace(state, boundaries=boundaries, labels=labels)
    partitioned = odd_even(sums, partitioned, min_samples=min_samples, executor=executor)
    return min(shifted, partitioned, key=partial(total_cost, sums))
