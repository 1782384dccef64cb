"""The trellis of the hidden Markov model: candidates and transitions of all time steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, jit
from gpszip.matching.kernels.candidates import (
    Candidates,
    candidates_from,
    empty_candidates,
    find_candidates,
    first_minimum,
    start_paths,
)
from gpszip.matching.kernels.roads import (
    Graph,
    ModelParameters,
    RoadGrid,
    Roads,
    Workspace,
    distance_between,
    resized,
)
from gpszip.matching.kernels.transitions import advance_paths, is_too_fast, max_path_length

__all__ = ["Trellis", "build_trellis", "select_samples"]

#: First capacity, in candidates for each time step and transition costs for each candidate; the
#: arrays double when they are full.
_FIRST_CAPACITY = 8


class Trellis(NamedTuple):
    """Candidates and transition costs of all time steps of a track.

    Time step t has the candidates ``candidate_starts[t]`` to ``candidate_starts[t + 1]``, and
    ``transition_costs[cost_starts[t]:cost_starts[t + 1]]`` from each candidate of time step t - 1
    to each of its own, by rows; there are none after a break.
    """

    candidate_starts: NDArray[np.int64]
    candidates: Candidates
    cost_starts: NDArray[np.int64]
    transition_costs: NDArray[np.float32]


@jit
def select_samples(
    positions: NDArray[np.float64], is_gap: NDArray[np.bool_], min_spacing: float
) -> NDArray[np.int64]:
    """Select the samples that make a time step.

    These are the first sample, each that lies ``min_spacing`` metres from the last one selected,
    and both ends of a gap (Newson and Krumm 2009 skip samples that lie near, too).
    """
    # Select samples in the order of time; a gap begins a new run.
    n = len(positions)
    selected, count = np.empty(n, np.int64), 0
    run_start = 0  # of ``selected``, after the last gap
    for i in range(n):
        is_first = i == 0 or is_gap[i - 1]
        is_last = i == n - 1 or is_gap[i]
        if is_first:
            run_start = count
        is_selected = is_first or distance_between(positions, i, selected[count - 1]) >= min_spacing

        # The end before a gap replaces a sample that is near.
        if is_last and not is_selected:
            if count - run_start > 1:
                count -= 1
            is_selected = True
        if is_selected:
            selected[count] = i
            count += 1
    return selected[:count]


@jit
def build_trellis(
    positions: NDArray[np.float64],
    times: NDArray[np.float64],
    headings: NDArray[np.float64],
    is_gap: NDArray[np.bool_],
    samples: NDArray[np.int64],
    roads: Roads,
    grid: RoadGrid,
    graph: Graph,
    model: ModelParameters,
    work: Workspace,
) -> Trellis:
    """Build the trellis of a track, with the cheapest path to each candidate.

    ``samples`` are those that make a time step. The recursion is that of ``advance_paths``.
    """
    # Arrays that grow with the candidates.
    steps = len(samples)
    max_candidates = 2 * model.max_candidates + 1  # both directions, and off the roads
    candidate_starts = np.zeros(steps + 1, np.int64)
    cost_starts = np.zeros(steps + 1, np.int64)
    capacity = max_candidates + _FIRST_CAPACITY * steps
    candidates = empty_candidates(capacity)
    step_costs = np.empty((max_candidates, max_candidates))
    all_costs = np.empty(_FIRST_CAPACITY * capacity, np.float32)

    # Add a time step at a time, with the cheapest path to each of its candidates.
    for step in range(steps):
        # Candidates of the time step.
        low = candidate_starts[step]
        if low + max_candidates > capacity:
            capacity = 2 * capacity
            candidates = _resized_candidates(candidates, capacity)
        after = candidates_from(candidates, low)
        sample = samples[step]
        n1 = find_candidates(positions[sample], headings[sample], roads, grid, graph, model, after)
        candidate_starts[step + 1] = low + n1
        filled = cost_starts[step]
        cost_starts[step + 1] = filled
        if step == 0:
            start_paths(after, n1, -1)
            continue

        # a break: paths begin anew
        last_low, last_sample = candidate_starts[step - 1], samples[step - 1]
        straight = distance_between(positions, last_sample, sample)
        seconds = times[sample] - times[last_sample]
        if is_gap[last_sample:sample].any() or is_too_fast(straight, seconds, model):
            start_paths(after, n1, first_minimum(candidates.path_costs[last_low:low]))
            continue

        # Transitions from the time step before.
        n0 = low - last_low
        advance_paths(
            candidates_from(candidates, last_low),
            n0,
            after,
            n1,
            positions[sample],
            straight,
            max_path_length(straight, seconds, model),
            graph,
            model,
            work,
            step_costs,
        )

        # Keep their costs for the posterior probabilities.
        if filled + n0 * n1 > len(all_costs):
            all_costs = resized(all_costs, 2 * len(all_costs) + n0 * n1)
        for i in range(n0):
            for j in range(n1):
                all_costs[filled + i * n1 + j] = step_costs[i, j]
        cost_starts[step + 1] = filled + n0 * n1
    return Trellis(candidate_starts, candidates_from(candidates, 0), cost_starts, all_costs)


@inner
def _resized_candidates(candidates: Candidates, size: int) -> Candidates:
    return Candidates(
        resized(candidates.roads, size),
        resized(candidates.metres, size),
        resized(candidates.distances, size),
        resized(candidates.emission_costs, size),
        resized(candidates.path_costs, size),
        resized(candidates.predecessors, size),
        resized(candidates.transitions, size),
    )
