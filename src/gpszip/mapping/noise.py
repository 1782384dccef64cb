"""Suggested error bounds, for a log whose user gives none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model.track import Track

__all__ = ["estimate_noise", "extent_rmse", "suggest_rmse"]

#: Ratio of the suggested bound to the noise: such a bound keeps the path and drops the noise.
_BOUND_PER_NOISE = 1.5

#: Lower limit of the bound, as a share of the log's extent: a smaller bound shows nobody more.
_MIN_EXTENT_SHARE = 1 / 400
#: Upper limit of the bound, as a share of the log's extent: a larger one loses the path itself.
_MAX_EXTENT_SHARE = 1 / 200

#: Lower limit of the bound of a GPS log, in metres. Receivers smooth their output, so that samples
#: look less noisy than they are.
_MIN_GEOGRAPHIC = 3.0
#: Upper limit of the bound of a GPS log, in metres.
_MAX_GEOGRAPHIC = 10.0

#: Least bound, in metres.
_MIN_BOUND = 1e-3

#: Differences up to this many metres are taken as 0: the agent stands still.
_STANDSTILL = 1e-9

#: Median of the absolute value of a standard normal variable.
_MEDIAN_NORMAL = 0.6744897501960817


def estimate_noise(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float:
    """Root mean square distance between the samples and the path that they follow, in metres.

    Each sample is compared with the point between its two neighbours at its own time. On a straight
    path, with independent noise of deviation s on each axis, the difference has the deviation
    s * sqrt(1 + u^2 + (1 - u)^2), where u is the share of the time between the neighbours. The
    median makes the estimate robust to corners and outliers. Differences of exactly 0, of an agent
    that stands still, do not count.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.

    Returns
    -------
    float
        Metres over all axes together; 0 where all samples are on straight lines.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(0, 0.3, (5000, 2))
    >>> track = Track("a", np.arange(5000.0), noise + np.arange(5000.0)[:, None])
    >>> round(estimate_noise([track], [np.zeros(4999, bool)]), 2)  # in truth 0.3 * sqrt(2)
    0.43
    """
    differences = [
        _scaled_differences(track, gap)
        for track, gap in zip(tracks, gaps, strict=True)
        if len(track) > 2
    ]
    pooled = np.concatenate([np.zeros(0), *differences])
    pooled = pooled[pooled > _STANDSTILL]
    if len(pooled) == 0:
        return 0.0
    return float(np.median(pooled)) / _MEDIAN_NORMAL * math.sqrt(tracks[0].dimension)


def suggest_rmse(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float:
    """RMSE in metres that keeps the path of a log and drops its noise.

    It is 1.5 times the noise. Positions of robots drift slowly, which no comparison of neighbours
    shows: a log in x and y gets at least 1/400 of its extent or the distance travelled in one
    second, whichever is smaller. It never gets more than 1/200 of its extent. A log in degrees gets
    3 to 10 m. The number is rounded to two digits, and is at least 1 mm.

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
    noise = _BOUND_PER_NOISE * estimate_noise(tracks, gaps)
    if tracks[0].plane is not None:
        return _round_to_two_digits(min(max(noise, _MIN_GEOGRAPHIC), _MAX_GEOGRAPHIC))

    # Limit the bound by the diagonal of the bounding box.
    low = np.min([track.positions.min(axis=0) for track in tracks], axis=0)
    high = np.max([track.positions.max(axis=0) for track in tracks], axis=0)
    extent = float(np.linalg.norm(high - low))
    least = min(_MIN_EXTENT_SHARE * extent, _median_speed(tracks, gaps))
    return _round_to_two_digits(max(min(max(noise, least), _MAX_EXTENT_SHARE * extent), _MIN_BOUND))


def extent_rmse(tracks: Sequence[Track]) -> float:
    """Root mean square distance of all samples from their mean, in metres.

    A single node holds any larger bound.

    Examples
    --------
    >>> extent_rmse([Track("a", [0, 1], [[0.0], [2.0]]), Track("b", [0, 1], [[0.0], [2.0]])])
    1.0
    """
    positions = np.concatenate([track.positions for track in tracks])
    return float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _median_speed(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float:
    """Median speed in m/s of the steps that move."""
    speeds = [
        (np.linalg.norm(np.diff(track.positions, axis=0), axis=1) / np.diff(track.times))[~gap]
        for track, gap in zip(tracks, gaps, strict=True)
    ]
    pooled = np.concatenate(speeds)
    moving = pooled[pooled > 0]
    return float(np.median(moving)) if len(moving) else 0.0


def _scaled_differences(track: Track, gaps: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of each coordinate from its neighbours' line, in metres of noise."""
    times, positions = track.times, track.positions
    share = ((times[1:-1] - times[:-2]) / (times[2:] - times[:-2]))[:, None]
    between = (1 - share) * positions[:-2] + share * positions[2:]
    scaled = np.abs(positions[1:-1] - between) / np.sqrt(1 + share**2 + (1 - share) ** 2)
    differences: NDArray[np.float64] = scaled[~(gaps[:-1] | gaps[1:])].reshape(-1)
    return differences


def _round_to_two_digits(value: float) -> float:
    return float(f"{value:.2g}")
