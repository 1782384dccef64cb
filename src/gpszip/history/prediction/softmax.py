"""Mixing the opinions of several experts: a softmax of weighted features."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Feature", "fit_weights", "mix", "softmax"]

#: Precision of the normal prior about the first weights. With 1 in place of 30, logs of a few
#: thousand decisions take 6 % more bits.
_PRIOR_PRECISION = 30.0

#: Most steps of the search; it converges in 20 to 60.
_MAX_STEPS = 80

#: Least probability whose logarithm is taken.
_MIN_PROBABILITY = 1e-12

Floats = NDArray[np.float64]


class Feature(NamedTuple):
    """What one expert says of each exit at each decision.

    Parameters
    ----------
    values : float64 array, shape (m, D)
        Such as the logarithm of a probability; 0 where there is no exit.
    kind : int64 array, shape (m,)
        Class of each decision; each class has a weight.
    kinds : int
        Number of classes.
    start : float
        What the weights are near to, unless the decisions say otherwise.
    """

    values: Floats
    kind: NDArray[np.int64]
    kinds: int
    start: float


def softmax(scores: Floats, exists: NDArray[np.bool_]) -> Floats:
    """Probabilities ``exp(score) / sum(exp(score))`` over the exits that exist, in each row.

    Examples
    --------
    >>> softmax(np.array([[0.0, 0.0, 9.0]]), np.array([[True, True, False]])).tolist()
    [[0.5, 0.5, 0.0]]
    """
    scores = np.where(exists, scores, -np.inf)
    weights = np.exp(scores - scores.max(axis=1, keepdims=True))
    probabilities: Floats = weights / weights.sum(axis=1, keepdims=True)
    return probabilities


def mix(features: list[Feature], weights: Floats) -> Floats:
    """Sum of the weighted features, shape (m, D)."""
    bounds = np.cumsum([feature.kinds for feature in features])[:-1]
    total = np.zeros_like(features[0].values)
    for feature, own in zip(features, np.split(weights, bounds), strict=True):
        total += own[feature.kind][:, None] * feature.values
    return total


def fit_weights(
    features: list[Feature], exists: NDArray[np.bool_], chosen: NDArray[np.int64]
) -> Floats:
    """Find the weights that make the exits taken the most probable.

    They maximise ``sum(log p) - c/2 |w - w0|^2`` with p the :func:`softmax` of :func:`mix`, which
    is concave.

    Parameters
    ----------
    features : list of Feature
        One for each expert.
    exists : bool array, shape (m, D)
        Whether there is an exit.
    chosen : int64 array, shape (m,)
        The exit taken.

    Returns
    -------
    float64 array
        Weights of the classes of all features, one after the other.

    Examples
    --------
    >>> values, kind = np.tile([[1.0, 0.0]], (900, 1)), np.zeros(900, np.int64)
    >>> feature, chosen = Feature(values, kind, 1, 0.0), np.arange(900) % 3 // 2
    >>> fit_weights([feature], values >= 0, chosen).round(2).tolist()  # log 2, less the prior
    [0.6]
    """
    from scipy.optimize import minimize

    # Where the search begins, and what was taken.
    begin = np.concatenate([np.full(feature.kinds, feature.start) for feature in features])
    if not len(chosen):
        return begin
    rows = np.arange(len(chosen))
    taken = np.zeros(exists.shape)
    taken[rows, chosen] = 1.0

    def cost(weights: Floats) -> tuple[float, Floats]:
        probabilities = softmax(mix(features, weights), exists)
        error = probabilities - taken
        slope = [
            np.bincount(feature.kind, (feature.values * error).sum(axis=1), feature.kinds)
            for feature in features
        ]
        away = weights - begin
        bits = -np.log(np.maximum(probabilities[rows, chosen], _MIN_PROBABILITY)).sum()
        return (
            bits + 0.5 * _PRIOR_PRECISION * float(away @ away),
            np.concatenate(slope) + _PRIOR_PRECISION * away,
        )

    found = minimize(cost, begin, jac=True, method="L-BFGS-B", options={"maxiter": _MAX_STEPS})
    return np.asarray(found.x, np.float64)
