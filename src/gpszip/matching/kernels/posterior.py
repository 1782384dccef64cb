"""Posterior probabilities of the hidden Markov model: how certain the roads of a track are."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit
from gpszip.matching.kernels.trellis import Trellis

__all__ = ["posterior", "road_probabilities"]


@jit
def posterior(trellis: Trellis) -> NDArray[np.float64]:
    """Probability of every candidate given all samples, by the forward-backward algorithm.

    With the emission cost e, the transition cost a, and all sums over the candidates i of one time
    step (Rabiner 1989, in logarithms)::

        log_forward_t(j)  = log sum_i exp(log_forward_(t-1)(i) - a_t(i, j)) - e_t(j)
        log_backward_t(i) = log sum_j exp(log_backward_(t+1)(j) - e_(t+1)(j) - a_(t+1)(i, j))
        p_t(i)            proportional to exp(log_forward_t(i) + log_backward_t(i))

    The greatest logarithm of a time step is subtracted from all of them, so that none overflows.
    """
    # Forward.
    starts = trellis.candidate_starts
    steps = len(starts) - 1
    log_forward = np.zeros(starts[steps])
    for step in range(steps):
        low, high = starts[step], starts[step + 1]
        if trellis.cost_starts[step + 1] > trellis.cost_starts[step]:
            _step_forward(trellis, step, log_forward)
        log_forward[low:high] -= trellis.candidates.emission_costs[low:high]
        log_forward[low:high] -= _greatest(log_forward, low, high)

    # Backward.
    log_backward = np.zeros(starts[steps])
    for step in range(steps - 1, 0, -1):
        if trellis.cost_starts[step + 1] > trellis.cost_starts[step]:
            _step_backward(trellis, step, log_backward)

    # Probabilities, in place of log_forward.
    for step in range(steps):
        low, high = starts[step], starts[step + 1]
        logs = log_forward[low:high] + log_backward[low:high]
        weights = np.exp(logs - _greatest(logs, 0, len(logs)))
        log_forward[low:high] = weights / weights.sum()
    return log_forward


@inner_uncounted
def _greatest(values: NDArray[np.float64], low: int, high: int) -> float:
    """Greatest of the values from ``low`` to before ``high``."""
    greatest = -np.inf
    for i in range(low, high):
        greatest = max(greatest, values[i])
    return greatest


@inner_uncounted
def _step_forward(trellis: Trellis, step: int, log_forward: NDArray[np.float64]) -> None:
    """Log-sum-exp over the candidates of the time step before, for each candidate of this one."""
    last = trellis.candidate_starts[step - 1]
    low = trellis.candidate_starts[step]
    high = trellis.candidate_starts[step + 1]
    for j in range(low, high):
        column = trellis.cost_starts[step] + j - low
        greatest = -np.inf
        for i in range(last, low):
            cost = trellis.transition_costs[column + (i - last) * (high - low)]
            greatest = max(greatest, log_forward[i] - cost)
        total = 0.0
        for i in range(last, low):
            cost = trellis.transition_costs[column + (i - last) * (high - low)]
            total += math.exp(log_forward[i] - cost - greatest)
        log_forward[j] = greatest + math.log(total)


@inner
def _step_backward(trellis: Trellis, step: int, log_backward: NDArray[np.float64]) -> None:
    """Log-sum-exp over the candidates of this time step, for each candidate of the one before."""
    # Backward recursion ``b_(t-1)(i) = log(sum_j exp(b_t(j) - e(j) - a(i, j)))``, with the greatest
    # exponent taken out of the sum, since all of them may be too small for exp.
    last = trellis.candidate_starts[step - 1]
    low = trellis.candidate_starts[step]
    high = trellis.candidate_starts[step + 1]
    after = log_backward[low:high] - trellis.candidates.emission_costs[low:high]
    for i in range(last, low):
        row = trellis.cost_starts[step] + (i - last) * (high - low)
        greatest = -np.inf
        for j in range(high - low):
            greatest = max(greatest, after[j] - trellis.transition_costs[row + j])
        total = 0.0
        for j in range(high - low):
            total += math.exp(after[j] - trellis.transition_costs[row + j] - greatest)
        log_backward[i] = greatest + math.log(total)

    # Only differences matter.
    log_backward[last:low] -= _greatest(log_backward, last, low)


@jit
def road_probabilities(
    trellis: Trellis,
    probabilities: NDArray[np.float64],
    leg_roads: NDArray[np.int32],
    leg_of: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Probability at each time step of the route there; 0 off the roads.

    It is the sum over the candidates on the legs from the time step before to the one after: at a
    crossing several roads are equally near, and those on the route don't compete.
    """
    # Time steps off the roads keep the probability 0.
    steps = len(leg_of)
    out = np.zeros(steps)
    for step in range(steps):
        if leg_of[step] < 0:
            continue

        # Legs beside the time step.
        first = last = leg_of[step]
        if step > 0 and leg_of[step - 1] >= 0:
            first = leg_of[step - 1]
        if step + 1 < steps and leg_of[step + 1] >= 0:
            last = leg_of[step + 1]

        # Candidates on them.
        for j in range(trellis.candidate_starts[step], trellis.candidate_starts[step + 1]):
            for leg in range(first, last + 1):
                if leg_roads[leg] == trellis.candidates.roads[j]:
                    out[step] += probabilities[j]
                    break
    return np.minimum(out, 1.0)
