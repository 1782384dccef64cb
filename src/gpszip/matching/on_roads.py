"""Which layers of a matched track lie on the roads that were chosen for them, and which only near: two kinds of distance, told apart."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["DistanceMixture", "fit_mixture"]

#: At least this share of what was matched is taken to lie on its roads: what most layers do is the rule, the rest the exception.
#: Without it, a few layers that happen to lie very near would pass for the only ones on roads.
_LEAST_SHARE = 0.5

#: Steps of expectation and maximisation; the error moves by less than one in a hundred in the last of them.
_STEPS = 30

Floats = NDArray[np.float64]


class DistanceMixture(NamedTuple):
    """How far layers are from the roads chosen for them.

    A ``share`` is on these roads, so that the distances are as those of a normal error with root mean square ``error``; the rest is
    anywhere within ``far`` metres of them.
    """

    share: float
    error: float
    far: float

    def on_roads(self, distances: Floats) -> Floats:
        """Probability that a layer so far off is on its road, 0 where the distance is NaN.

        Examples
        --------
        >>> DistanceMixture(0.7, 5.0, 50.0).on_roads(np.array([0.0, 5.0, 12.0, 20.0, np.nan])).round(2).tolist()
        [0.95, 0.92, 0.51, 0.01, 0.0]
        """
        near = (
            self.share
            * math.sqrt(2 / math.pi)
            / self.error
            * np.exp(-0.5 * (distances / self.error) ** 2)
        )
        return np.nan_to_num(near / (near + (1 - self.share) / self.far))


def fit_mixture(distances: Floats, start: DistanceMixture, prior: float = 0.0) -> DistanceMixture:
    """Fit the two kinds to the distances of layers, by expectation and maximisation.

    Parameters
    ----------
    distances : float64 array, shape (k,)
        Metres from layers to their roads, NaN where none was chosen.
    start : Distances
        Where to begin; how far a layer may be is kept.
    prior : float, default 0
        ``start`` counts as much as so many layers.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> far = fit_mixture(np.append(np.abs(rng.normal(0, 4, 600)), rng.uniform(0, 80, 400)), DistanceMixture(0.5, 8.0, 80.0))
    >>> round(far.share, 1), round(far.error)
    (0.6, 4)
    """
    known = distances[np.isfinite(distances)]
    fit = start
    if not len(known):
        return fit
    for _ in range(_STEPS):
        on = fit.on_roads(known)
        layers = float(on.sum()) + prior
        if not layers:
            return fit
        square = (float(on @ known**2) + prior * start.error**2) / layers
        share = (float(on.sum()) + prior * start.share) / (len(known) + prior)
        fit = DistanceMixture(
            max(share, _LEAST_SHARE), max(math.sqrt(square), 1e-6 * start.far), start.far
        )
    return fit
