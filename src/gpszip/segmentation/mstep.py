"""The maximisation step: the best m segments for given intervals and labels (section 6.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.lines import best_lines, pooled_lines
from gpszip.segmentation.state import EMState, interval_costs

__all__ = ["fit_segments", "maximize"]


def maximize(sums: PrefixSums, state: EMState) -> EMState:
    """Fit every segment to all its intervals; tau never rises.

    The fit is pooled least squares in each interval's own time from 0 to 1. Neither the mean of
    the intervals' own lines nor a fit in seconds is the same; those may raise tau. An unused
    segment takes the best line of a badly fitted interval.
    """
    starts, ends = fit_segments(sums, state.boundaries, state.labels, len(state.starts))
    fitted = replace(state, starts=starts, ends=ends)
    unused = np.flatnonzero(np.bincount(state.labels, minlength=len(starts)) == 0)
    return _reseed_unused(sums, fitted, unused) if len(unused) else fitted


def fit_segments(
    sums: PrefixSums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], m: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return start and end of the best line of each label in position ticks."""
    _, starts, slopes = pooled_lines(sums, boundaries, labels, m)
    return starts, starts + slopes


def _reseed_unused(sums: PrefixSums, state: EMState, unused: NDArray[np.intp]) -> EMState:
    """Give unused segments the best lines of the intervals that would gain most by them.

    Labels stay; the next expectation step may assign intervals to the new segments.
    """
    # Gain of each interval if it had a segment to itself.
    _, starts, slopes = best_lines(sums, state.boundaries)
    labels = np.arange(len(starts), dtype=np.int32)
    free = replace(state, labels=labels, starts=starts, ends=starts + slopes)
    gains = interval_costs(sums, state) - interval_costs(sums, free)

    worst = np.argsort(-gains, kind="stable")[: len(unused)]
    new_starts, new_ends = state.starts.copy(), state.ends.copy()
    new_starts[unused], new_ends[unused] = free.starts[worst], free.ends[worst]
    return replace(state, starts=new_starts, ends=new_ends)
