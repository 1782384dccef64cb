"""The trellis of matching one sample at a time: a ring that keeps the last time steps only."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner_uncounted, jit, jit_uncounted
from gpszip.matching.kernels.candidates import (
    Candidates,
    candidates_from,
    empty_candidates,
    find_candidates,
    first_minimum,
    start_paths,
)
from gpszip.matching.kernels.roads import Graph, ModelParameters, RoadGrid, Roads, Workspace
from gpszip.matching.kernels.transitions import advance_paths, is_too_fast, max_path_length

__all__ = [
    "NewestStep",
    "TrellisRing",
    "add_time_step",
    "backtrack",
    "best_candidate",
    "empty_ring",
    "find_convergence",
]


class TrellisRing(NamedTuple):
    """The last time steps of a trellis.

    Time step t has ``counts[t % size]`` candidates, from index ``(t % size) * width`` on, where
    size is the number of time steps kept and width the most candidates of one. ``log_forward`` is
    the logarithm of each candidate's probability given the samples so far, up to a constant.
    ``transition_costs`` is a table for one time step, shape (width, width).
    """

    candidates: Candidates
    counts: NDArray[np.int64]
    log_forward: NDArray[np.float64]
    transition_costs: NDArray[np.float64]


class NewestStep(NamedTuple):
    """The best candidate of the newest time step, and the probability of its road."""

    road: int
    metres: float
    distance: float
    probability: float
    transition: int


@jit
def empty_ring(size: int, width: int) -> TrellisRing:
    """Allocate a ring of ``size`` time steps with at most ``width`` candidates each."""
    return TrellisRing(
        empty_candidates(size * width),
        np.zeros(size, np.int64),
        np.zeros(size * width),
        np.empty((width, width)),
    )


@jit
def add_time_step(
    ring: TrellisRing,
    step: int,
    position: NDArray[np.float64],
    heading: NDArray[np.float64],
    straight: float,
    seconds: float,
    roads: Roads,
    grid: RoadGrid,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> NewestStep:
    """Add a time step to the ring and find its best candidate.

    The sample lies ``straight`` metres and ``seconds`` after the time step before; infinite seconds
    are a gap. The probability of a directed road is that of all candidates on it, given the samples
    so far: the forward algorithm, as in :mod:`gpszip.matching.kernels.posterior`.
    """
    # Candidates.
    size, width = len(ring.counts), len(ring.transition_costs)
    low = (step % size) * width
    after = candidates_from(ring.candidates, low)
    n1 = find_candidates(position, heading, roads, grid, graph, model, after)
    ring.counts[step % size] = n1
    log_forward = ring.log_forward[low : low + n1]

    # Transitions from the time step before, unless the path breaks.
    if step == 0 or seconds == np.inf or is_too_fast(straight, seconds, model):
        start_paths(after, n1, 0 if step == 0 else best_candidate(ring, step - 1))
        log_forward[:] = -after.emission_costs[:n1]
    else:
        last_low = ((step - 1) % size) * width
        n0 = ring.counts[(step - 1) % size]
        advance_paths(
            candidates_from(ring.candidates, last_low),
            n0,
            after,
            n1,
            position,
            straight,
            max_path_length(straight, seconds, model),
            graph,
            model,
            work,
            ring.transition_costs,
        )
        _step_forward(
            ring.log_forward[last_low : last_low + n0], ring.transition_costs, log_forward
        )
        log_forward -= after.emission_costs[:n1]
    log_forward -= log_forward.max()

    # The best candidate, and the probability of its road.
    best = best_candidate(ring, step)
    total = on_road = 0.0
    for j in range(n1):
        total += math.exp(log_forward[j])
        if after.roads[j] == after.roads[best]:
            on_road += math.exp(log_forward[j])
    return NewestStep(
        after.roads[best],
        after.metres[best],
        after.distances[best],
        on_road / total,
        after.transitions[best],
    )


@jit_uncounted
def best_candidate(ring: TrellisRing, step: int) -> int:
    """The candidate of a time step to which the cheapest path leads."""
    slot = step % len(ring.counts)
    low = slot * len(ring.transition_costs)
    return first_minimum(ring.candidates.path_costs[low : low + ring.counts[slot]])


@inner_uncounted
def _step_forward(
    before: NDArray[np.float64], transition_costs: NDArray[np.float64], after: NDArray[np.float64]
) -> None:
    """Log-sum-exp over the candidates of the time step before, for each candidate of this one."""
    for j in range(len(after)):
        greatest = -np.inf
        for i in range(len(before)):
            greatest = max(greatest, before[i] - transition_costs[i, j])
        total = 0.0
        for i in range(len(before)):
            total += math.exp(before[i] - transition_costs[i, j] - greatest)
        after[j] = greatest + math.log(total)


@jit
def find_convergence(ring: TrellisRing, step: int, first: int) -> tuple[int, int]:
    """Find the last time step at which all paths meet, and the candidate where they do.

    Looks at the paths to all candidates of time step ``step``, back to time step ``first``. The
    cheapest path of any later time step passes this candidate. Returns (-1, -1) if there is none.
    """
    # Candidates on any path, from the newest time step back.
    size, width = len(ring.counts), len(ring.transition_costs)
    is_alive, is_alive_before = np.zeros(width, np.bool_), np.zeros(width, np.bool_)
    is_alive[: ring.counts[step % size]] = True
    for here in range(step, first - 1, -1):
        low, count, last = (here % size) * width, 0, 0
        is_alive_before[:] = False
        for j in range(ring.counts[here % size]):
            if is_alive[j]:
                count += 1
                last = j
                is_alive_before[ring.candidates.predecessors[low + j]] = True
        if count == 1:
            return here, last
        is_alive, is_alive_before = is_alive_before, is_alive
    return -1, -1


@jit
def backtrack(ring: TrellisRing, step: int, candidate: int, first: int) -> NDArray[np.int64]:
    """Follow the cheapest path to a candidate back to step ``first``; indices into the ring."""
    size, width = len(ring.counts), len(ring.transition_costs)
    path = np.empty(step - first + 1, np.int64)
    for here in range(step, first - 1, -1):
        path[here - first] = (here % size) * width + candidate
        candidate = ring.candidates.predecessors[path[here - first]]
    return path
