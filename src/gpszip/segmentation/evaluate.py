"""Positions and errors of a segment mean at a track's own times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.model import SegmentMean, Track

__all__ = ["distances", "positions_at", "rmse"]


def positions_at(mean: SegmentMean, track: Track) -> NDArray[np.float64]:
    """Return the positions f(t) at the track's sample times, in metres, shape (n, d).

    Examples
    --------
    >>> import numpy as np
    >>> starts, ends = np.array([[0.0]]), np.array([[4.0]])
    >>> mean = SegmentMean(np.array([0, 3]), np.array([0]), starts, ends, 0.0)
    >>> positions_at(mean, Track("walk", [0, 1, 2], [[0], [0], [4]])).ravel().tolist()
    [0.0, 2.0, 4.0]
    """
    # Time within the interval, from 0 to 1.
    lengths = np.diff(mean.boundaries)
    first, last = track.times[mean.boundaries[:-1]], track.times[mean.boundaries[1:] - 1]
    # An interval of one sample lies at the start of its segment.
    duration = np.where(last > first, last - first, 1.0)
    u = (track.times - np.repeat(first, lengths)) / np.repeat(duration, lengths)

    # Position on the interval's segment.
    labels = np.repeat(mean.labels, lengths)
    positions: NDArray[np.float64] = (
        mean.starts[labels] + u[:, None] * (mean.ends - mean.starts)[labels]
    )
    return positions


def distances(mean: SegmentMean, track: Track) -> NDArray[np.float64]:
    """Return the synchronised distance of each sample in metres, shape (n,)."""
    errors: NDArray[np.float64] = np.sqrt(
        np.square(positions_at(mean, track) - track.positions).sum(axis=1)
    )
    return errors


def rmse(mean: SegmentMean, track: Track) -> float:
    """Return the root of the weighted mean squared synchronised distance in metres."""
    return float(np.sqrt(np.average(np.square(distances(mean, track)), weights=track.weights)))
