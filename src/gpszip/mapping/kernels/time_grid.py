"""Arrays of the E-step's kernels: the time grid with its samples, and the table of one window."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["DPTable", "TimeGridArrays"]


class TimeGridArrays(NamedTuple):
    """Slots of all tracks with prefix sums and samples; positions are in grid steps."""

    sums: NDArray[np.int64]  # over the samples before each slot
    ticks: NDArray[np.int64]  # time of each slot, in ticks
    centers: NDArray[np.int64]  # position of the log at each slot, in ticks
    positions: NDArray[np.float64]  # the same in grid steps
    ticks_per_step: float  # position ticks of a grid step
    ends: NDArray[np.int64]  # number of samples before each slot
    times: NDArray[np.float64]  # of the samples, in time steps
    sample_positions: NDArray[np.float64]
    time_steps: NDArray[np.float64]  # time of each slot, in time steps
    directions: NDArray[np.float64]  # unit vectors along which distances are limited
    max_distance: float  # of a sample along each direction; 0 for no limit


class DPTable(NamedTuple):
    """Dynamic-programming table of one window: a row for each slot, a column for each candidate."""

    candidates: NDArray[np.int64]  # nodes
    counts: NDArray[np.int64]  # number of candidates of each slot
    positions: NDArray[np.float64]  # of the candidates, in grid steps
    numbers: NDArray[np.int64]  # of the candidates, as rows and columns of ``step_bits``
    step_bits: NDArray[np.float64]  # bits of a step between two candidates
    arrivals: NDArray[np.float64]  # least bits of a step to each candidate, with its duration
    bits: NDArray[np.float64]  # least bits to reach each candidate
    parent_rows: NDArray[np.int64]  # row from which the cheapest path reaches it
    parent_choices: NDArray[np.int64]  # column of the same
