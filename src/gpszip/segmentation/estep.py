"""The expectation step: better boundaries and labels for given segments (thesis, section 6.3).

All forms keep the number of parts and never raise tau. They cut a window of two parts anew with Algorithm 2, whose
printed form lacks the empty right part; here both ends are candidates, no part becomes shorter than asked, and the
present state is the candidate to beat, without which descent would be lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.run.executor import Executor
from gpszip.segmentation.kernels.shift import shift_boundaries
from gpszip.segmentation.partition import exact_partition
from gpszip.segmentation.state import EMState, total_cost

__all__ = ["exact", "linear", "naive", "odd_even"]

#: Boundaries that are shifted as one piece of work; does not depend on the number of workers.
_BATCH = 64


def naive(sums: PrefixSums, state: EMState, *, min_samples: int = 1) -> EMState:
    """Walk over the boundaries, summing each candidate up anew (section 6.3.1); time n^2 m / k."""
    return _shift_one_by_one(sums, state, min_samples, naive=True)


def linear(sums: PrefixSums, state: EMState, *, min_samples: int = 1) -> EMState:
    """Walk over the boundaries with the incremental 2-segment mean (section 6.3.2); the same result in time n m."""
    return _shift_one_by_one(sums, state, min_samples, naive=False)


def _shift_one_by_one(
    sums: PrefixSums, state: EMState, min_samples: int, *, naive: bool
) -> EMState:
    boundaries, labels = state.boundaries.copy(), state.labels.copy()
    shift_boundaries(
        sums, boundaries, labels, state.starts, state.ends, 1, len(labels), 1, min_samples, naive
    )
    return replace(state, boundaries=boundaries, labels=labels)


def odd_even(
    sums: PrefixSums, state: EMState, *, min_samples: int = 1, executor: Executor | None = None
) -> EMState:
    """Shift all even boundaries, then all odd ones (section 6.3.3); those of one kind don't touch each other."""
    return _shift_every_second(
        sums, _shift_every_second(sums, state, 2, min_samples, executor), 1, min_samples, executor
    )


def _shift_every_second(
    sums: PrefixSums, state: EMState, first: int, min_samples: int, executor: Executor | None
) -> EMState:
    boundaries, labels = state.boundaries.copy(), state.labels.copy()
    work = partial(_shift_batch, sums, state, min_samples)
    for low, part_boundaries, part_labels in (executor or _BuiltinMap()).map(
        work, _batches(first, len(labels), executor)
    ):
        boundaries[low : low + len(part_boundaries)] = part_boundaries
        labels[low - 1 : low - 1 + len(part_labels)] = part_labels
    return replace(state, boundaries=boundaries, labels=labels)


class _BuiltinMap:
    map = staticmethod(map)


def _batches(first: int, k: int, executor: Executor | None) -> Iterator[tuple[int, int]]:
    """Ranges of boundaries that begin with one to be shifted."""
    step = 2 * _BATCH if executor else k + k % 2 + 2
    return ((low, min(low + step, k)) for low in range(first, k, step))


def _shift_batch(
    sums: PrefixSums, state: EMState, min_samples: int, batch: tuple[int, int]
) -> tuple[int, NDArray[np.int64], NDArray[np.int32]]:
    """Boundaries from ``low`` on and labels from ``low - 1`` on, every second boundary shifted."""
    low, high = batch
    last = low + (high - 1 - low) // 2 * 2
    boundaries, labels = (
        state.boundaries[low - 1 : last + 2].copy(),
        state.labels[low - 1 : last + 1].copy(),
    )
    shift_boundaries(
        sums, boundaries, labels, state.starts, state.ends, 1, len(labels), 2, min_samples, False
    )
    return low, boundaries[1:-1], labels


def exact(
    sums: PrefixSums, state: EMState, *, min_samples: int = 1, executor: Executor | None = None
) -> EMState:
    """Partition the whole track anew with k parts; at least as good as the odd/even shifts."""
    shifted = odd_even(sums, state, min_samples=min_samples, executor=executor)
    k = len(state.labels)
    penalty = total_cost(sums, state) / (
        4 * k
    )  # what a part more gains is some share of what a part costs
    boundaries, labels = exact_partition(
        sums, state.starts, state.ends, k, min_samples=min_samples, penalty=penalty
    )
    whole = odd_even(
        sums,
        replace(state, boundaries=boundaries, labels=labels),
        min_samples=min_samples,
        executor=executor,
    )
    return min(shifted, whole, key=partial(total_cost, sums))
