"""Segment means learned from a coreset, and bounds on their cost at the samples of the log."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import SegmentMean, Track
from gpszip.run.executor import Executor
from gpszip.segmentation.em import Problem, SegmentMeanOptions
from gpszip.segmentation.evaluate import distances
from gpszip.segmentation.evaluate import rmse as rmse_of
from gpszip.segmentation.runs import join_tracks
from gpszip.sketches.coreset import Coreset, Cost
from gpszip.sketches.kernels.blocks import WEIGHT
from gpszip.sketches.pieces import PiecewiseLinear
from gpszip.sketches.stand_ins import stand_ins

__all__ = ["CoresetProblem"]

#: Stand-ins of a block: parts begin at one of so many samples of it.
_STAND_INS = 8


class CoresetProblem(Problem):
    """Segment means of the log of a coreset.

    The search works on samples that stand for the blocks. Boundaries count the samples of the log;
    within a block, samples are taken to come at even times. The cost is what
    :meth:`gpszip.sketches.coreset.Coreset.cost` estimates from the moments, with strict bounds.

    Parameters
    ----------
    coreset : Coreset
        B blocks.
    samples : Track, optional
        The samples of the log, joined, where they are at hand: errors are measured at them then.
    **options
        As for :func:`gpszip.segmentation.em.segment_mean`.
    """

    def __init__(
        self,
        coreset: Coreset,
        samples: Track | None = None,
        **options: Unpack[SegmentMeanOptions],
    ) -> None:
        found = stand_ins(coreset, _STAND_INS)
        super().__init__(*join_tracks(found.tracks), **options)
        self.coreset = coreset
        self.samples = samples
        self.numbers = np.append(found.numbers, coreset.samples)

    def key(self) -> str:
        """Hash by which a memo knows the coreset and the options."""
        return f"coreset-{super().key()}"

    def solve(self, k: int, m: int, *, executor: Executor | None = None) -> SegmentMean:
        """Return the segment mean with k parts and m segments.

        Raises
        ------
        OptionError
            If k or m doesn't fit the coreset.
        """
        found = super().solve(k, m, executor=executor)
        boundaries = self.numbers[found.boundaries]
        mean = SegmentMean(
            boundaries, found.labels, found.starts, found.ends, found.cost, (), found.heads
        )
        cost = self.cost(mean).estimate
        return SegmentMean(
            boundaries, found.labels, found.starts, found.ends, cost, (cost,), found.heads
        )

    def cost(self, mean: SegmentMean) -> Cost:
        """Estimate and strict bounds of the cost of a segment mean at the samples of the log."""
        starts, ends = self.times(mean)
        estimate, lower, upper = 0.0, 0.0, 0.0
        for head, after in pairwise([*mean.heads.tolist(), mean.k]):
            labels = mean.labels[head:after]
            function = PiecewiseLinear(
                starts[head:after], ends[head:after], mean.starts[labels], mean.ends[labels]
            )
            number = int(np.searchsorted(self._first_samples(), mean.boundaries[head], "right")) - 1
            cost = self.coreset.cost(function, track=self.coreset.tracks[number])
            estimate, lower, upper = (
                estimate + cost.estimate,
                lower + cost.lower,
                upper + cost.upper,
            )
        return Cost(estimate, lower, upper)

    def times(self, mean: SegmentMean) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times of the first and the last sample of each part, even within blocks."""
        return self._times_of(mean.boundaries[:-1]), self._times_of(mean.boundaries[1:] - 1)

    def rmse(self, mean: SegmentMean) -> float:
        """Root mean square error in metres: at the samples, or the most that the coreset allows."""
        if self.samples is not None:
            return rmse_of(mean, self.samples)
        return math.sqrt(self.cost(mean).upper / float(self.coreset.rows[:, WEIGHT].sum()))

    def max_error(self, mean: SegmentMean) -> float:
        """Largest error of the samples in metres.

        Raises
        ------
        OptionError
            If the samples are not at hand.
        """
        if self.samples is None:
            raise OptionError(
                "a coreset has no samples whose maximum error could be bounded",
                remedy="give an RMSE, or the log itself",
            )
        return float(distances(mean, self.samples).max())

    def _first_samples(self) -> NDArray[np.int64]:
        """First sample of each track."""
        blocks = np.searchsorted(self.coreset.owners, np.arange(len(self.coreset.tracks)))
        counts = self.coreset.counts
        firsts: NDArray[np.int64] = (np.cumsum(counts) - counts)[blocks]
        return firsts

    def _times_of(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Times of samples of the log by their numbers."""
        counts, edges = self.coreset.counts, self.coreset.edges
        firsts = np.cumsum(counts) - counts
        blocks = np.searchsorted(firsts, numbers, side="right") - 1
        shares = (numbers - firsts[blocks]) / np.maximum(counts[blocks] - 1, 1)
        times: NDArray[np.float64] = edges[blocks, 0] + shares * (
            edges[blocks, 1] - edges[blocks, 0]
        )
        return times
