"""The cheapest chain of candidates through the samples of one track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.matching.index import RoadIndex
from gpszip.matching.kernels.backtrace import Legs, best_chain, trace
from gpszip.matching.kernels.posterior import posterior, way_share
from gpszip.matching.kernels.roads import Work
from gpszip.matching.kernels.trellis import lattice, thin
from gpszip.matching.parameters import apart, model_of
from gpszip.model.match import Scales

__all__ = ["Chain", "Stretch", "follow"]


@dataclass(frozen=True, eq=False)
class Stretch:
    """A track as the kernels take it.

    Parameters
    ----------
    positions, times : float64 array, shape (n, d) and (n,)
        Metres in the coordinates of the index, and seconds.
    silent : bool array, shape (n - 1,)
        Intervals that break every way.
    headings : float64 array, shape (n, 2)
        Unit vectors in which the agent faces, zero where that is not known.
    """

    positions: NDArray[np.float64]
    times: NDArray[np.float64]
    silent: NDArray[np.bool_]
    headings: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chain:
    """What was chosen at each layer, on directed roads as the kernels count them.

    Parameters
    ----------
    stretch : Stretch
        The track.
    used : int64 array, shape (k,)
        Samples that have a layer.
    roads : int32 array, shape (k,)
        Directed road of each layer, -1 for none.
    kinds : uint8 array, shape (k,)
        How each was reached, see :mod:`gpszip.matching.kernels.candidates`.
    alone : bool array, shape (k,)
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

    stretch: Stretch
    used: NDArray[np.int64]
    roads: NDArray[np.int32]
    kinds: NDArray[np.uint8]
    alone: NDArray[np.bool_]
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


def follow(index: RoadIndex, work: Work, stretch: Stretch, scales: Scales, *, sure: bool = True) -> Chain:
    """Find the cheapest chain.

    Parameters
    ----------
    index, work : RoadIndex, Work
        The network, and room to search it.
    stretch : Stretch
        The track.
    scales : Scales
        Numbers of the model.
    sure : bool, default True
        Work out the confidence, too.
    """
    positions, model = stretch.positions, model_of(scales)
    if not sure:
        model = model._replace(margin=0.0)
    used = thin(positions, stretch.silent, apart(scales))
    layers = lattice(positions, stretch.times, stretch.headings, stretch.silent, used, index.roads, index.cells, index.graph, model, work)
    chain = best_chain(layers)
    legs, leg, metres = trace(positions, stretch.times, used, chain, layers, index.graph, model, work)
    confidence = way_share(layers, posterior(layers), legs.roads, leg) if sure else np.zeros(len(used))
    alone = np.diff(layers.begins) == 1
    return Chain(stretch, used, layers.all.roads[chain], layers.all.kinds[chain], alone, confidence, legs, leg, metres)
