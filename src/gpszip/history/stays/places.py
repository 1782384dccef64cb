"""Places: stops of all tracks and days that lie together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["group_stops"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def group_stops(
    positions: ArrayLike, weights: ArrayLike, noise: ArrayLike, radius: float
) -> tuple[Integers, Floats]:
    """Group stops to places.

    The heaviest stop that has no place yet makes one, with all stops within the radius; then each
    place moves to the mean of its stops, where exact stops count more, and each stop goes to the
    place nearest to it. Stops of errors larger than the radius make no places of their own where
    others are within these errors.

    Parameters
    ----------
    positions : array_like, shape (n, d)
        Metres.
    weights : array_like, shape (n,)
        Positive: seconds.
    noise : array_like, shape (n,)
        Errors of the positions in metres.
    radius : float
        Metres around the centre of a place that belong to it.

    Returns
    -------
    int64 array, shape (n,)
        Number of the place of each stop. Places are numbered from 0 by their weight, the heaviest
        first.
    float64 array, shape (k, d)
        Their centres.

    Examples
    --------
    >>> places, centres = group_stops([[0.0], [500.0], [40.0]], [1, 9, 1], [10, 10, 10], 100.0)
    >>> places.tolist(), centres.tolist()
    ([1, 0, 1], [[500.0], [20.0]])
    """
    from scipy.spatial import cKDTree

    positions, weights = np.asarray(positions, np.float64), np.asarray(weights, np.float64)
    noise = np.asarray(noise, np.float64)
    if not len(positions):
        return np.zeros(0, np.int64), positions

    # The heaviest stop and those around it.
    label = np.full(len(positions), -1)
    is_exact = noise <= radius
    leaders = _lead(
        positions, np.flatnonzero(is_exact), weights, np.full(len(noise), radius), label
    )

    # Stops of large errors: at the place nearest to them, or at places of their own.
    rest = np.flatnonzero(~is_exact)
    if len(rest) and leaders:
        distance, nearest = cKDTree(positions[leaders]).query(positions[rest])
        within = distance <= radius + noise[rest]
        label[rest[within]] = np.asarray(nearest)[within]
        rest = rest[~within]
    leaders = _lead(positions, rest, weights, radius + noise, label, leaders)

    # Places at the means of their stops, as exact as these are; each exact stop at the nearest.
    shares = weights / np.maximum(noise, 1.0) ** 2
    centres = _means(positions, shares, label, len(leaders))
    distance, nearest = cKDTree(centres).query(positions)
    label = np.where(is_exact & (distance <= radius), nearest, label)

    # Numbers by weight, without those that lost all stops.
    mass = np.bincount(label, weights, len(leaders))
    order = np.argsort(-mass, kind="stable")[: int((mass > 0).sum())]
    rank = np.zeros(len(leaders), np.int64)
    rank[order] = np.arange(len(order))
    label = rank[label]
    return label, _means(positions, shares, label, len(order))


def _lead(
    positions: Floats,
    rows: Integers,
    weights: Floats,
    reach: Floats,
    label: Integers,
    leaders: Sequence[int] = (),
) -> list[int]:
    """Label some stops by the heaviest one within the reach of which they lie; return all leaders.

    Labels go on after those of earlier leaders.
    """
    from scipy.spatial import cKDTree

    found = list(leaders)
    if not len(rows):
        return found
    tree = cKDTree(positions[rows])
    for stop in rows[np.argsort(-weights[rows], kind="stable")].tolist():
        if label[stop] < 0:
            around = rows[tree.query_ball_point(positions[stop], reach[stop])]
            label[around[label[around] < 0]] = len(found)
            found.append(stop)
    return found


def _means(positions: Floats, weights: Floats, label: Integers, count: int) -> Floats:
    mass = np.bincount(label, weights, count)
    sums = np.stack([np.bincount(label, weights * axis, count) for axis in positions.T], axis=1)
    means: Floats = sums / np.maximum(mass, 1e-300)[:, None]
    return means
