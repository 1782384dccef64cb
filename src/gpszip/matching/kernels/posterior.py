"""How sure the model is of what it chose."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit
from gpszip.matching.kernels.trellis import Lattice

__all__ = ["posterior", "way_share"]


@jit
def posterior(lattice: Lattice) -> NDArray[np.float64]:
    """Probability of every candidate given all samples: the forward-backward recursion on prices."""
    layers = len(lattice.begins) - 1
    ahead = np.zeros(lattice.begins[layers])
    for layer in range(layers):
        low, high = lattice.begins[layer], lattice.begins[layer + 1]
        if lattice.starts[layer + 1] > lattice.starts[layer]:
            _arrive(lattice, layer, ahead)
        ahead[low:high] -= lattice.all.prices[low:high]
        ahead[low:high] -= ahead[low:high].max()
    behind = np.zeros(lattice.begins[layers])
    for layer in range(layers - 1, 0, -1):
        if lattice.starts[layer + 1] > lattice.starts[layer]:
            _return(lattice, layer, behind)
    for layer in range(layers):
        low, high = lattice.begins[layer], lattice.begins[layer + 1]
        here = ahead[low:high] + behind[low:high]
        here = np.exp(here - here.max())
        ahead[low:high] = here / here.sum()
    return ahead


@jit
def _arrive(lattice: Lattice, layer: int, ahead: NDArray[np.float64]) -> None:
    """Logarithm of the probability of reaching each candidate of a layer."""
    last, low, high = lattice.begins[layer - 1], lattice.begins[layer], lattice.begins[layer + 1]
    for j in range(low, high):
        at = lattice.starts[layer] + j - low
        most = -np.inf
        for i in range(last, low):
            most = max(most, ahead[i] - lattice.moves[at + (i - last) * (high - low)])
        total = 0.0
        for i in range(last, low):
            total += math.exp(ahead[i] - lattice.moves[at + (i - last) * (high - low)] - most)
        ahead[j] = most + math.log(total)


@jit
def _return(lattice: Lattice, layer: int, behind: NDArray[np.float64]) -> None:
    """Logarithm of the probability of all that comes after each candidate of the layer before."""
    last, low, high = lattice.begins[layer - 1], lattice.begins[layer], lattice.begins[layer + 1]
    after = behind[low:high] - lattice.all.prices[low:high]
    for i in range(last, low):
        at = lattice.starts[layer] + (i - last) * (high - low)
        most = -np.inf
        for j in range(high - low):
            most = max(most, after[j] - lattice.moves[at + j])
        total = 0.0
        for j in range(high - low):
            total += math.exp(after[j] - lattice.moves[at + j] - most)
        behind[i] = most + math.log(total)
    behind[last:low] -= behind[last:low].max()


@jit
def way_share(lattice: Lattice, share: NDArray[np.float64], roads: NDArray[np.int32], leg: NDArray[np.int64]) -> NDArray[np.float64]:
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
        for j in range(lattice.begins[layer], lattice.begins[layer + 1]):
            for one in range(first, last + 1):
                if roads[one] == lattice.all.roads[j]:
                    out[layer] += share[j]
                    break
    return np.minimum(out, 1.0)
