"""The maximisation step: the best m segments for given parts and labels (thesis, section 6.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.sums import Sums
from gpszip.segmentation.lines import own_lines, pooled_lines
from gpszip.segmentation.state import State, costs_of_parts

__all__ = ["maximize", "segments_of"]


def maximize(sums: Sums, state: State) -> State:
    """Refit every segment to all its parts; an unused one takes the line of a badly fitted part. Tau never rises.

    The fit is pooled least squares in each part's own time from 0 to 1, which is neither the mean of the parts' own
    lines nor a fit in seconds: those may raise tau.
    """
    starts, ends = segments_of(sums, state.boundaries, state.labels, len(state.starts))
    unused = np.flatnonzero(np.bincount(state.labels, minlength=len(starts)) == 0)
    fitted = replace(state, starts=starts, ends=ends)
    return _reseed(sums, fitted, unused) if len(unused) else fitted


def segments_of(
    sums: Sums, boundaries: NDArray[np.int64], labels: NDArray[np.int32], m: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Start and end points in place ticks of the best line of each label."""
    _, starts, slopes = pooled_lines(sums, boundaries, labels, m)
    return starts, starts + slopes


def _reseed(sums: Sums, state: State, unused: NDArray[np.intp]) -> State:
    """Give unused segments the own lines of the parts that would gain most; the next expectation step may use them."""
    _, starts, slopes = own_lines(sums, state.boundaries)
    own = State(state.boundaries, np.arange(len(starts), dtype=np.int32), starts, starts + slopes)
    gain = costs_of_parts(sums, state) - costs_of_parts(sums, own)
    worst = np.argsort(-gain, kind="stable")[: len(unused)]
    new_starts, new_ends = state.starts.copy(), state.ends.copy()
    new_starts[unused], new_ends[unused] = own.starts[worst], own.ends[worst]
    return replace(state, starts=new_starts, ends=new_ends)
