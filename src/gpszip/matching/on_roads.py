"""Which time steps of a matched track lie on the roads chosen for them, and which only near.

The distances to the roads are a mixture of two distributions: those on the roads have normal
errors, the others are anywhere within the search radius.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["DistanceMixture", "fit_mixture"]

#: Least share of time steps that lie on their roads. Without it, a few time steps that happen to
#: lie very near would pass for the only ones on roads.
_MIN_SHARE = 0.5

#: Iterations of expectation maximisation; the last changes the error by less than one in a hundred.
_ITERATIONS = 30

#: Least error, as a fraction of the search radius, so that the density stays finite.
_MIN_ERROR = 1e-6

Floats = NDArray[np.float64]


class DistanceMixture(NamedTuple):
    """Distribution of the distances from time steps to the roads chosen for them.

    A ``share`` of the time steps is on these roads: their distances are those of a normal error
    with root mean square ``error``. The distances of the others are uniform up to ``far`` metres.
    """

    share: float
    error: float
    far: float

    def on_roads(self, distances: Floats) -> Floats:
        """Probability that a time step at a distance is on its road, 0 where it is NaN.

        Examples
        --------
        >>> mixture = DistanceMixture(0.7, 5.0, 50.0)
        >>> mixture.on_roads(np.array([0.0, 5.0, 12.0, 20.0, np.nan])).round(2).tolist()
        [0.95, 0.92, 0.51, 0.01, 0.0]
        """
        return np.where(np.isnan(distances), 0.0, self.on_roads_by_square(distances**2))

    def on_roads_by_square(self, squares: Floats) -> Floats:
        """Probabilities as of :meth:`on_roads`, of squares of distances."""
        near = (
            self.share
            * math.sqrt(2 / math.pi)
            / self.error
            * np.exp(-0.5 / self.error**2 * squares)
        )
        both = near + (1 - self.share) / self.far
        on_roads: Floats = np.divide(near, both, out=np.zeros(len(squares)), where=both > 0)
        return on_roads


def fit_mixture(distances: Floats, start: DistanceMixture, prior: float = 0.0) -> DistanceMixture:
    """Fit the mixture to the distances of time steps, by expectation maximisation.

    Parameters
    ----------
    distances : float64 array, shape (k,)
        Metres from time steps to their roads, NaN where none was chosen.
    start : DistanceMixture
        Where to begin; its ``far`` is kept.
    prior : float, default 0
        Number of time steps as which ``start`` counts.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> near, far = np.abs(rng.normal(0, 4, 600)), rng.uniform(0, 80, 400)
    >>> mixture = fit_mixture(np.append(near, far), DistanceMixture(0.5, 8.0, 80.0))
    >>> round(mixture.share, 1), round(mixture.error)
    (0.6, 4)
    """
    # Time steps without a road tell nothing about the errors.
    squares = distances[np.isfinite(distances)] ** 2
    mixture = start
    if not len(squares):
        return mixture
    for _ in range(_ITERATIONS):
        # Expectation.
        probability = mixture.on_roads_by_square(squares)
        steps = float(probability.sum()) + prior
        if not steps:
            return mixture

        # Maximisation. A product of matrices would wake threads that cost more than it.
        square = (float(np.einsum("i,i", probability, squares)) + prior * start.error**2) / steps
        share = (float(probability.sum()) + prior * start.share) / (len(squares) + prior)
        mixture = DistanceMixture(
            max(share, _MIN_SHARE), max(math.sqrt(square), _MIN_ERROR * start.far), start.far
        )
    return mixture
