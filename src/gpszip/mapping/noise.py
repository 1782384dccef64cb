"""What error is sensible for a log of which the user has said nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model.track import Track

__all__ = ["estimate_noise", "extent_rmse", "suggest_rmse"]

#: A bound this many times the noise leaves the way and drops the noise.
_ABOVE_NOISE = 1.5

#: Shares of the log's extent: a bound above the larger loses the way itself, one below the smaller shows nobody more.
_EXTENT_SHARES = (1 / 400, 1 / 200)

#: Metres; receivers smooth what they tell, so that their samples look less noisy than they are.
_GEOGRAPHIC = (3.0, 10.0)

#: Median of the absolute value of a standard normal variable.
_MEDIAN_NORMAL = 0.6744897501960817


def estimate_noise(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float:
    """Root mean square distance between samples and the way that they follow, in metres.

    Each sample is compared with the point between its two neighbours at its own time. Were the way straight and the
    noise of the samples independent with deviation s on each axis, the difference would have the deviation
    s * sqrt(1 + u^2 + (1 - u)^2), u being the share of the time between the neighbours. The median makes the estimate
    deaf to corners and spikes; the differences that are exactly 0, of an agent that stands still, don't count.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.

    Returns
    -------
    float
        Metres over all axes together; 0 where no sample differs from the straight way.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(0, 0.3, (5000, 2))
    >>> track = Track("a", np.arange(5000.0), noise + np.arange(5000.0)[:, None])
    >>> round(estimate_noise([track], [np.zeros(4999, bool)]), 2)  # in truth 0.3 * sqrt(2)
    0.43
    """
    differences = [
        _differences(track, gap) for track, gap in zip(tracks, gaps, strict=True) if len(track) > 2
    ]
    pooled = np.concatenate([np.zeros(0), *differences])
    pooled = pooled[pooled > 1e-9]
    if len(pooled) == 0:
        return 0.0
    return float(np.median(pooled)) / _MEDIAN_NORMAL * math.sqrt(tracks[0].dimension)


def suggest_rmse(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float:
    """RMSE in metres that keeps the ways of a log and drops its noise.

    It is 1.5 times the noise. Positions of robots drift slowly, which no neighbours tell, so that a log in x and y gets
    no less than 1/400 of its extent or one second's way, whichever is smaller; and never more than 1/200 of its extent.
    A log in degrees gets 3 to 10 m. The number is rounded to two digits, and 1 mm is the least.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.

    Returns
    -------
    float
        Metres.
    """
    noise = _ABOVE_NOISE * estimate_noise(tracks, gaps)
    if tracks[0].plane is not None:
        return _two_digits(min(max(noise, _GEOGRAPHIC[0]), _GEOGRAPHIC[1]))
    low = np.min([track.positions.min(axis=0) for track in tracks], axis=0)
    high = np.max([track.positions.max(axis=0) for track in tracks], axis=0)
    least, most = (share * float(np.linalg.norm(high - low)) for share in _EXTENT_SHARES)
    return _two_digits(max(min(max(noise, min(least, _speed(tracks, gaps))), most), 1e-3))


def extent_rmse(tracks: Sequence[Track]) -> float:
    """Root mean square distance of all samples from their mean in metres: a coarser bound is held by a single place.

    Examples
    --------
    >>> extent_rmse([Track("a", [0, 1], [[0.0], [2.0]]), Track("b", [0, 1], [[0.0], [2.0]])])
    1.0
    """
    positions = np.concatenate([track.positions for track in tracks])
    return float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _speed(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float:
    """Median speed in m/s of the steps that lead somewhere."""
    speeds = [
        (np.linalg.norm(np.diff(track.positions, axis=0), axis=1) / np.diff(track.times))[~gap]
        for track, gap in zip(tracks, gaps, strict=True)
    ]
    pooled = np.concatenate(speeds)
    moving = pooled[pooled > 0]
    return float(np.median(moving)) if len(moving) else 0.0


def _differences(track: Track, gaps: NDArray[np.bool_]) -> NDArray[np.float64]:
    times, positions = track.times, track.positions
    share = ((times[1:-1] - times[:-2]) / (times[2:] - times[:-2]))[:, None]
    between = (1 - share) * positions[:-2] + share * positions[2:]
    scaled = np.abs(positions[1:-1] - between) / np.sqrt(1 + share**2 + (1 - share) ** 2)
    known: NDArray[np.float64] = scaled[~(gaps[:-1] | gaps[1:])].reshape(-1)
    return known


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")
