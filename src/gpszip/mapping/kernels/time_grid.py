"""What the windows of the E-step are settled on: slots, samples and limits; and the board on which one window is played."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["DPTable", "TimeGridArrays"]


class TimeGridArrays(NamedTuple):
    """The slots of all tracks with the sums and the samples between them. No limit on a sample's distance where ``reach`` is 0."""

    sums: NDArray[np.int64]  # over the samples before each slot
    ticks: NDArray[np.int64]  # time of each slot, in ticks
    centers: NDArray[np.int64]  # where the log is at each slot, in ticks
    positions: NDArray[np.float64]  # the same, in quanta
    ticks_per_step: NDArray[np.float64]  # ticks of a quantum
    ends: NDArray[np.int64]  # samples before each slot
    times: NDArray[np.float64]  # of the samples, in cells
    sample_positions: NDArray[np.float64]  # of the samples, in quanta
    time_steps: NDArray[np.float64]  # time of each slot, in cells
    directions: NDArray[np.float64]  # along which distances are limited
    reach: NDArray[np.float64]


class DPTable(NamedTuple):
    """Candidate nodes of each slot of a window, and the cheapest way to reach each."""

    candidates: NDArray[np.int64]  # nodes
    counts: NDArray[np.int64]  # how many candidates a slot has
    spot: NDArray[np.float64]  # places of the candidates, in quanta
    local: NDArray[np.int64]  # their indices in ``table``
    table: NDArray[np.float64]  # bits of a step between two candidates
    best: NDArray[np.float64]  # least bits to reach a candidate
    parent_row: NDArray[np.int64]  # slot and candidate from which it is reached so
    parent_choice: NDArray[np.int64]
