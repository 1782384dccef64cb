"""The Markov model of a map: how likely each edge follows another one (thesis, chapter 1.3).

The probability that directed edge b follows a is ``(n(a, b) + s) / (n(a) + s k(a))``: n counts
traversals that go on from a, k(a) is the number of directed edges at the node where a ends, the way
back included, and s is the smoothing. An edge that nobody ever took has a small probability then,
and not zero, so that every log has a likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.history.traversals import Traversals
from gpszip.model import Network

__all__ = ["EdgeTransitions", "RouteLikelihood", "learn_transitions"]

#: Traversals by which each exit of a node counts more than it was taken.
_SMOOTHING = 0.5


@dataclass(frozen=True)
class RouteLikelihood:
    """How likely a log is under a Markov model.

    Parameters
    ----------
    bits : float
        Sum of -log2 of the probabilities of its transitions.
    transitions : int
        Their number; the first edge after a start or a gap is given.
    """

    bits: float
    transitions: int

    @property
    def log_likelihood(self) -> float:
        """Natural logarithm of the probability of all transitions."""
        return -self.bits * float(np.log(2.0))

    @property
    def bits_per_transition(self) -> float:
        """Mean bits of a transition; NaN without any."""
        return self.bits / self.transitions if self.transitions else float("nan")


@dataclass(frozen=True, eq=False)
class EdgeTransitions:
    """Transitions between directed edges, ``2 * edge`` forward and ``2 * edge + 1`` backward.

    Parameters
    ----------
    before, after : int64 array, shape (t,)
        Directed edges of each transition that occurs, sorted by both.
    counts : int64 array, shape (t,)
        How often.
    totals : int64 array, shape (2 E,)
        Transitions from each directed edge.
    exits : int64 array, shape (2 E,)
        Directed edges that begin where it ends, the way back included.
    smoothing : float
        Added to the count of each exit.
    """

    before: NDArray[np.int64]
    after: NDArray[np.int64]
    counts: NDArray[np.int64]
    totals: NDArray[np.int64]
    exits: NDArray[np.int64]
    smoothing: float = _SMOOTHING

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """Probability of each transition that occurs, shape (t,)."""
        return self.probability(self.before, self.after)

    def probability(
        self, before: NDArray[np.int64], after: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Probability that directed edges follow others, at whose ends they begin; shape (n,)."""
        # Look up the pairs among those that occur.
        size = len(self.totals)
        keys, known = before * size + after, self.before * size + self.after
        place = np.minimum(np.searchsorted(known, keys), max(len(known) - 1, 0))
        found = known[place] == keys if len(known) else np.zeros(len(keys), np.bool_)
        counts = np.where(found, self.counts[place] if len(known) else 0, 0)

        # Smooth.
        total = self.totals[before] + self.smoothing * self.exits[before]
        probability: NDArray[np.float64] = (counts + self.smoothing) / total
        return probability

    def likelihood(self, traversals: Traversals) -> RouteLikelihood:
        """How likely traversals of the same network are."""
        at, directed = traversals.follows, traversals.directed
        probability = self.probability(directed[at - 1], directed[at])
        return RouteLikelihood(float(-np.log2(probability).sum()), len(at))


def learn_transitions(
    network: Network, traversals: Traversals, smoothing: float = _SMOOTHING
) -> EdgeTransitions:
    """Count the transitions of all tracks.

    Parameters
    ----------
    network : Network
        The edges.
    traversals : Traversals
        What was travelled on them.
    smoothing : float, default 0.5
        Added to the count of each exit; positive.

    Examples
    --------
    >>> import gpszip
    >>> from gpszip.history.traversals import read_history
    >>> ring = gpszip.testing.ring(4, laps=5)
    >>> history = read_history(gpszip.compress(ring.tracks, max_error=5))
    >>> model = learn_transitions(history.network, history.traversals)
    >>> bool((model.probabilities > 0.7).all())
    True
    """
    # Pairs of successive traversals.
    size = 2 * len(network)
    at, directed = traversals.follows, traversals.directed
    keys, counts = np.unique(directed[at - 1] * size + directed[at], return_counts=True)
    before, after = np.divmod(keys, size)

    # Exits of the node at which each directed edge ends; backward edges end at their start.
    degree = np.bincount(
        np.concatenate([network.starts, network.ends]), minlength=len(network.nodes)
    )
    exits = np.stack([degree[network.ends], degree[network.starts]], axis=1).reshape(-1)
    totals = np.bincount(before, weights=counts, minlength=size).astype(np.int64)
    return EdgeTransitions(before, after, counts.astype(np.int64), totals, exits, smoothing)
