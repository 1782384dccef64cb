"""The Markov model of a segment mean: which segment follows which, and how far samples are off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.grid import Plane
from gpszip.model.text import count_text

__all__ = ["Likelihood", "MarkovModel"]


@dataclass(frozen=True, eq=False, repr=False)
class MarkovModel:
    """A Markov chain over m segments, and the spread of samples about them.

    The thesis's hidden Markov model (abstract, problem 4.2.1): the state is the segment that a part
    of a track follows, and samples are normally distributed about the position on it.

    Parameters
    ----------
    starts, ends : float64 array, shape (m, d)
        End points of the segments in metres.
    firsts : int64 array, shape (m,)
        Number of runs that begin with each segment.
    transitions : int32 array, shape (a, 2)
        Each pair of segments that followed each other, once, sorted.
    counts : int64 array, shape (a,)
        How often they did.
    sigma : float
        Standard deviation of each coordinate about the position on the segment, in metres.
    plane : Plane or None
        Where the positions lie on the earth.
    """

    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    firsts: NDArray[np.int64]
    transitions: NDArray[np.int32]
    counts: NDArray[np.int64]
    sigma: float
    plane: Plane | None = None

    def __repr__(self) -> str:
        transitions = count_text(len(self.counts), "transition")
        return f"MarkovModel(m={self.m}, {transitions}, sigma {self.sigma:.3g} m)"

    @property
    def m(self) -> int:
        """Number of segments."""
        return len(self.starts)

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return int(self.starts.shape[1])

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """Probability of each transition, given its first segment: the most likely ones.

        Those from one segment add up to 1.

        Examples
        --------
        >>> points = np.zeros((2, 1))
        >>> pairs, counts = np.array([[0, 0], [0, 1], [1, 0]], np.int32), np.array([1, 3, 2])
        >>> MarkovModel(points, points, np.array([1, 0]), pairs, counts, 1.0).probabilities.tolist()
        [0.25, 0.75, 1.0]
        """
        totals = self._totals()[self.transitions[:, 0]]
        shares: NDArray[np.float64] = self.counts / np.maximum(totals, 1.0)
        return shares

    def log_probability(self, labels: NDArray[np.int32], heads: NDArray[np.int64]) -> float:
        """Return the natural logarithm of the probability of segments in the order of travel.

        To each segment, one passage more is added that is spread evenly over all m, so that no
        transition is impossible: ``(count + 1 / m) / (total + 1)``.

        Parameters
        ----------
        labels : int32 array, shape (k,)
            Segments.
        heads : int64 array, shape (r,)
            Those that begin a run, whose probability is that of beginning one.
        """
        # Transitions by the number of their pair.
        follows = np.ones(len(labels), np.bool_)
        follows[heads] = False
        before, after = labels[:-1][follows[1:]], labels[1:][follows[1:]]
        totals = self._totals()[before]
        logs = np.log(self._counts_of(before, after) + 1 / self.m) - np.log(totals + 1)

        # Beginnings of runs.
        begins = np.log(self.firsts[labels[heads]] + 1 / self.m) - np.log(self.firsts.sum() + 1)
        return float(logs.sum() + begins.sum())

    def _totals(self) -> NDArray[np.float64]:
        """How often each segment was followed by any, shape (m,)."""
        totals: NDArray[np.float64] = np.bincount(
            self.transitions[:, 0], weights=self.counts, minlength=self.m
        ).astype(np.float64)
        return totals

    def _counts_of(
        self, before: NDArray[np.int32], after: NDArray[np.int32]
    ) -> NDArray[np.float64]:
        """How often pairs of segments followed each other; 0 for those that never did."""
        known = self.transitions[:, 0].astype(np.int64) * self.m + self.transitions[:, 1]
        wanted = before.astype(np.int64) * self.m + after
        if not len(known):
            return np.zeros(len(wanted))
        places = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
        counts: NDArray[np.float64] = self.counts[places] * (known[places] == wanted)
        return counts


@dataclass(frozen=True)
class Likelihood:
    """Log-likelihood of tracks under a :class:`MarkovModel`, in natural logarithms.

    Parameters
    ----------
    transitions : float
        Log-probability of the segments in their order.
    samples : float
        Log-density of the samples about the positions on them, in metres.
    count : int
        Number of samples.
    """

    transitions: float
    samples: float
    count: int

    @property
    def total(self) -> float:
        """Log-likelihood of transitions and samples together."""
        return self.transitions + self.samples

    @property
    def per_sample(self) -> float:
        """Share of one sample, which compares logs of different lengths."""
        return self.total / self.count
