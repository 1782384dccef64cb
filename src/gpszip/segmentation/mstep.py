"""The maximisation step: the best m segments for given parts and labels (thesis, section 6.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import PrefixSums
from gpszip.segmentation.lines import best_lines, pooled_lines
from gpszip.segmentation.state import EMState, interval_costs

__all__ = ["fit_segments", "maximize"]


def maximize(sums: PrefixSums, state: EMState) -> EMState:
    """Refit every segment to all its parts; an unused one takes the line of a badly fitted part. Tau never rises.

    The fit is pooled least squares in each part's own time from 0 to 1, which is neither the mean of the parts' own
    lines nor a fit in seconds: those may raise tau.
    """
    starts, ends = fit_segments(sums, state.boundaries, state.labels, len(state.starts))
    unused = np.flatnonzero(np.bincount(state.labels, minlength=len(starts)) == 0)
    fitted = replace(state, starts=starts, ends=ends)
    return _reseed_unused(sums, fitted, unused) if len(unused) else fitted


def fit_segments(
    sums: PrefixSums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], m: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Start and end points in place ticks of the best line of each label."""
    _, starts, slopes = pooled_lines(sums, boundaries, labels, m)
    return starts, starts + slopes


def _reseed_unused(sums: PrefixSums, state: EMState, unused: NDArray[np.intp]) -> EMState:
    """Give unused segments the own lines of the parts that would gain most; the next expectation step may use them."""
    _, starts, slopes = best_lines(sums, state.boundaries)
    own = EMState(state.boundaries, np.arange(len(starts), dtype=np.int32), starts, starts + slopes)
    gain = interval_costs(sums, state) - interval_costs(sums, own)
    worst = np.argsort(-gain, kind="stable")[: len(unused)]
    new_starts, new_ends = state.starts.copy(), state.ends.copy()
    new_starts[unused], new_ends[unused] = own.starts[worst], own.ends[worst]
    return replace(state, starts=new_starts, ends=new_ends)
