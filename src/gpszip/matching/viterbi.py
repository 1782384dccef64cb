"""The Viterbi path of one track: the cheapest sequence of candidates through its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import Legs, best_path, build_legs
from gpszip.matching.kernels.posterior import posterior, road_probabilities
from gpszip.matching.kernels.roads import Workspace
from gpszip.matching.kernels.trellis import build_trellis, select_samples
from gpszip.matching.parameters import min_spacing, model_parameters
from gpszip.model.match import Scales

__all__ = ["Observations", "ViterbiPath", "find_viterbi_path"]


@dataclass(frozen=True, eq=False)
class Observations:
    """A track as the kernels take it.

    Parameters
    ----------
    positions, times : float64 array, shape (n, d) and (n,)
        Metres in the coordinates of the index, and seconds.
    is_gap : bool array, shape (n - 1,)
        Intervals that break every path.
    headings : float64 array, shape (n, 2)
        Unit vectors in which the agent faces, zero where that is not known.
    """

    positions: NDArray[np.float64]
    times: NDArray[np.float64]
    is_gap: NDArray[np.bool_]
    headings: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ViterbiPath:
    """The candidate chosen at each time step of the hidden Markov model.

    A time step is a sample that the model takes; samples near it are placed afterwards. Directed
    road 2e leads along road e, 2e + 1 against it. A leg is the part of a directed road that a route
    takes.

    Parameters
    ----------
    observations : Observations
        The track.
    sample_indices : int64 array, shape (k,)
        Samples that make a time step.
    roads : int32 array, shape (k,)
        Directed road of each time step, -1 for none.
    transitions : uint8 array, shape (k,)
        How each was reached, see :mod:`gpszip.matching.kernels.candidates`.
    no_road_near : bool array, shape (k,)
        Time steps without a road within the search radius.
    confidence : float64 array, shape (k,)
        Probability of the route at each time step.
    legs : Legs
        Legs of the routes of all pieces, one after the other.
    leg : int64 array, shape (k,)
        Leg of each time step, -1 for none.
    metres : float64 array, shape (k,)
        Metres along the leg's directed road.
    """

    observations: Observations
    sample_indices: NDArray[np.int64]
    roads: NDArray[np.int32]
    transitions: NDArray[np.uint8]
    no_road_near: NDArray[np.bool_]
    confidence: NDArray[np.float64]
    legs: Legs
    leg: NDArray[np.int64]
    metres: NDArray[np.float64]

    @property
    def along(self) -> NDArray[np.float64]:
        """Metres of each time step along all legs, one after the other; NaN for none."""
        if not len(self.legs.roads):
            return np.full(len(self.leg), np.nan)
        before = np.concatenate(([0.0], np.cumsum(self.legs.end - self.legs.begin)))
        leg = np.maximum(self.leg, 0)
        return np.where(self.leg >= 0, before[leg] + self.metres - self.legs.begin[leg], np.nan)


def find_viterbi_path(
    index: RoadIndex,
    work: Workspace,
    observations: Observations,
    scales: Scales,
    *,
    with_confidence: bool = True,
) -> ViterbiPath:
    """Find the Viterbi path of a track.

    Parameters
    ----------
    index, work : RoadIndex, Workspace
        The network, and arrays for its searches.
    observations : Observations
        The track.
    scales : Scales
        Scales of the model.
    with_confidence : bool, default True
        Whether to compute the confidence. Without it the search ignores all paths that cost more
        than the best, which is faster.
    """
    # Trellis.
    model = model_parameters(scales)
    if not with_confidence:
        model = model._replace(cost_margin=0.0)
    samples = select_samples(observations.positions, observations.is_gap, min_spacing(scales))
    trellis = build_trellis(
        observations.positions,
        observations.times,
        observations.headings,
        observations.is_gap,
        samples,
        index.roads,
        index.road_grid,
        index.graph,
        model,
        work,
    )

    # Cheapest path, and its legs.
    path = best_path(trellis)
    legs, leg, metres = build_legs(
        observations.positions,
        observations.times,
        samples,
        path,
        trellis,
        index.graph,
        model,
        work,
    )
    confidence = (
        road_probabilities(trellis, posterior(trellis), legs.roads, leg)
        if with_confidence
        else np.zeros(len(samples))
    )

    # a time step whose only candidate is off the roads has no road near
    return ViterbiPath(
        observations,
        samples,
        trellis.candidates.roads[path],
        trellis.candidates.transitions[path],
        np.diff(trellis.candidate_starts) == 1,
        confidence,
        legs,
        leg,
        metres,
    )
