"""The state of the expectation-maximisation: boundaries, labels and segments, in ticks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums, segment_moments
from gpszip.model import SegmentMean

__all__ = [
    "EMState",
    "interval_costs",
    "to_metres",
    "to_segment_mean",
    "to_ticks",
    "total_cost",
]


@dataclass(frozen=True, eq=False)
class EMState:
    """A (k,m)-segment in ticks.

    Parameters
    ----------
    boundaries : int64 array, shape (k + 1,)
        First sample of each interval, and the number of samples.
    labels : int32 array, shape (k,)
        Segment of each interval.
    starts, ends : float64 array, shape (m, d)
        End points of the segments, in position ticks from the first sample.
    heads : int64 array, shape (r,)
        First interval of each run: a track, or a piece between gaps. No interval crosses from one
        run to the next. By default there is one run.
    """

    boundaries: NDArray[np.int64]
    labels: NDArray[np.int32]
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    heads: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, np.int64))

    @property
    def runs(self) -> Iterator[tuple[int, int]]:
        """First interval of each run, and the one after its last."""
        return pairwise([*self.heads.tolist(), len(self.labels)])


def to_ticks(sums: PrefixSums, metres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert positions in metres to position ticks from the first sample."""
    ticks: NDArray[np.float64] = (
        np.asarray(metres, dtype=np.float64) - sums.first_position
    ) / sums.position_tick
    return ticks


def to_metres(sums: PrefixSums, ticks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert position ticks from the first sample to positions in metres."""
    metres: NDArray[np.float64] = sums.first_position + ticks * sums.position_tick
    return metres


def interval_costs(sums: PrefixSums, state: EMState) -> NDArray[np.float64]:
    """Return the fitting cost of each interval in squared position ticks.

    ``Q - 2 (a M + v N) + W a^2 + 2 U1 a v + U2 v^2`` with the moments in normalised time, and the
    segment ``a + u v`` from the interval's first sample.
    """
    rows = segment_moments(sums, state.boundaries)
    d = sums.p.shape[1]
    # Moments count positions from the interval's first sample, so the segment's start does, too.
    a = state.starts[state.labels] - sums.p[state.boundaries[:-1]]
    v = (state.ends - state.starts)[state.labels]

    quadratic = rows[:, 0] * _dot(a, a) + 2 * rows[:, 1] * _dot(a, v) + rows[:, 2] * _dot(v, v)
    linear = _dot(rows[:, 4 : 4 + d], a) + _dot(rows[:, 4 + d :], v)
    costs: NDArray[np.float64] = np.maximum(rows[:, 3] - 2 * linear + quadratic, 0.0)
    return costs


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the dot products of the rows of two arrays."""
    product: NDArray[np.float64] = (a * b).sum(axis=1)
    return product


def total_cost(sums: PrefixSums, state: EMState) -> float:
    """Return the fitting cost tau in squared position ticks."""
    return float(interval_costs(sums, state).sum())


def to_segment_mean(sums: PrefixSums, state: EMState, costs: list[float]) -> SegmentMean:
    """Convert a state and the costs after each iteration from ticks to metres."""
    costs_in_metres = tuple(cost * sums.position_tick**2 for cost in costs)
    starts, ends = to_metres(sums, state.starts), to_metres(sums, state.ends)
    return SegmentMean(
        state.boundaries,
        state.labels,
        starts,
        ends,
        costs_in_metres[-1],
        costs_in_metres,
        state.heads,
    )
