"""The cheapest chain of candidates through the samples of one track."""

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
        Intervals that break every way.
    headings : float64 array, shape (n, 2)
        Unit vectors in which the agent faces, zero where that is not known.
    """

    positions: NDArray[np.float64]
    times: NDArray[np.float64]
    is_gap: NDArray[np.bool_]
    headings: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ViterbiPath:
    """What was chosen at each layer, on directed roads as the kernels count them.

    Parameters
    ----------
    observations : Stretch
        The track.
    sample_indices : int64 array, shape (k,)
        Samples that have a layer.
    roads : int32 array, shape (k,)
        Directed road of each layer, -1 for none.
    transitions : uint8 array, shape (k,)
        How each was reached, see :mod:`gpszip.matching.kernels.candidates`.
    no_road_near : bool array, shape (k,)
        Layers that have no road near.
    confidence : float64 array, shape (k,)
        Probability of what was chosen.
    legs : Legs
        The ways of all pieces.
    leg : int64 array, shape (k,)
        Leg of each layer, -1 for none.
    metres : float64 array, shape (k,)
        Metres on the leg's directed road.
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
        """Metres of each layer along all legs, one after the other; NaN for none."""
        if not len(self.legs.roads):
            return np.full(len(self.leg), np.nan)
        before = np.concatenate(([0.0], np.cumsum(self.legs.end - self.legs.begin)))
        leg = np.maximum(self.leg, 0)
        return np.where(self.leg >= 0, before[leg] + self.metres - self.legs.begin[leg], np.nan)


def find_viterbi_path(
    index: RoadIndex,
    work: Workspace,
    stretch: Observations,
    scales: Scales,
    *,
    with_confidence: bool = True,
) -> ViterbiPath:
    """Find the cheapest chain.

    Parameters
    ----------
    index, work : RoadIndex, Work
        The network, and room to search it.
    observations : Stretch
        The track.
    scales : Scales
        Numbers of the model.
    with_confidence : bool, default True
        Work out the confidence, too.
    """
    positions, model = stretch.positions, model_parameters(scales)
    if not with_confidence:
        model = model._replace(cost_margin=0.0)
    used = select_samples(positions, stretch.is_gap, min_spacing(scales))
    layers = build_trellis(
        positions,
        stretch.times,
        stretch.headings,
        stretch.is_gap,
        used,
        index.roads,
        index.road_grid,
        index.graph,
        model,
        work,
    )
    chain = best_path(layers)
    legs, leg, metres = build_legs(
        positions, stretch.times, used, chain, layers, index.graph, model, work
    )
    confidence = (
        road_probabilities(layers, posterior(layers), legs.roads, leg)
        if with_confidence
        else np.zeros(len(used))
    )
    alone = np.diff(layers.candidate_starts) == 1
    return ViterbiPath(
        stretch,
        used,
        layers.candidates.roads[chain],
        layers.candidates.transitions[chain],
        alone,
        confidence,
        legs,
        leg,
        metres,
    )
