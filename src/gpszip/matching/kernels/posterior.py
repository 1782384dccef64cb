"""How sure the model is of what it chose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.trellis import Trellis

__all__ = ["posterior", "road_probabilities"]


@jit
def posterior(trellis: Trellis) -> NDArray[np.float64]:
    """Probability of every candidate given all samples: the forward-backward recursion on prices."""
    layers = len(trellis.candidate_starts) - 1
    ahead = np.zeros(trellis.candidate_starts[layers])
    for layer in range(layers):
        low, high = trellis.candidate_starts[layer], trellis.candidate_starts[layer + 1]
        if trellis.cost_starts[layer + 1] > trellis.cost_starts[layer]:
            _arrive(trellis, layer, ahead)
        ahead[low:high] -= trellis.candidates.emission_costs[low:high]
        ahead[low:high] -= ahead[low:high].max()
    behind = np.zeros(trellis.candidate_starts[layers])
    for layer in range(layers - 1, 0, -1):
        if trellis.cost_starts[layer + 1] > trellis.cost_starts[layer]:
            _return(trellis, layer, behind)
    for layer in range(layers):
        low, high = trellis.candidate_starts[layer], trellis.candidate_starts[layer + 1]
        here = ahead[low:high] + behind[low:high]
        here = np.exp(here - here.max())
        ahead[low:high] = here / here.sum()
    return ahead


@jit
def _arrive(trellis: Trellis, layer: int, ahead: NDArray[np.float64]) -> None:
    """Logarithm of the probability of reaching each candidate of a layer."""
    last, low, high = (
        trellis.candidate_starts[layer - 1],
        trellis.candidate_starts[layer],
        trellis.candidate_starts[layer + 1],
    )
    for j in range(low, high):
        at = trellis.cost_starts[layer] + j - low
        most = -np.inf
        for i in range(last, low):
            most = max(most, ahead[i] - trellis.transition_costs[at + (i - last) * (high - low)])
        total = 0.0
        for i in range(last, low):
            total += math.exp(
                ahead[i] - trellis.transition_costs[at + (i - last) * (high - low)] - most
            )
        ahead[j] = most + math.log(total)


@jit
def _return(trellis: Trellis, layer: int, behind: NDArray[np.float64]) -> None:
    """Logarithm of the probability of all that comes after each candidate of the layer before."""
    last, low, high = (
        trellis.candidate_starts[layer - 1],
        trellis.candidate_starts[layer],
        trellis.candidate_starts[layer + 1],
    )
    after = behind[low:high] - trellis.candidates.emission_costs[low:high]
    for i in range(last, low):
        at = trellis.cost_starts[layer] + (i - last) * (high - low)
        most = -np.inf
        for j in range(high - low):
            most = max(most, after[j] - trellis.transition_costs[at + j])
        total = 0.0
        for j in range(high - low):
            total += math.exp(after[j] - trellis.transition_costs[at + j] - most)
        behind[i] = most + math.log(total)
    behind[last:low] -= behind[last:low].max()


@jit
def road_probabilities(
    trellis: Trellis, share: NDArray[np.float64], roads: NDArray[np.int32], leg: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Probability at each layer of the candidates on the way from the layer before to the one after; 0 off the roads.

    At a crossing several roads are equally near: they are one way if it leads over them.
    """
    layers = len(leg)
    out = np.zeros(layers)
    for layer in range(layers):
        if leg[layer] < 0:
            continue
        first = leg[layer - 1] if layer > 0 and leg[layer - 1] >= 0 else leg[layer]
        last = leg[layer + 1] if layer + 1 < layers and leg[layer + 1] >= 0 else leg[layer]
        for j in range(trellis.candidate_starts[layer], trellis.candidate_starts[layer + 1]):
            for one in range(first, last + 1):
                if roads[one] == trellis.candidates.roads[j]:
                    out[layer] += share[j]
                    break
    return np.minimum(out, 1.0)
