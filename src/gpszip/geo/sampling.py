"""How far apart in time the samples of a log are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["sampling_interval"]

#: This share of the way was travelled in steps that took no longer.
_DISTANCE_SHARE = 0.75


def sampling_interval(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float | None:
    """Seconds between two samples in which three quarters of the way were travelled, or less.

    Metres count rather than samples: a parked receiver may log seldom or often, and of a mixed fleet the rarer samples matter.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.

    Returns
    -------
    float or None
        Seconds; None where nobody moved.

    Examples
    --------
    >>> track = Track("a", [0, 1, 2, 3, 60], [[0.0], [9.0], [18.0], [27.0], [28.0]])
    >>> sampling_interval([track], [np.zeros(4, bool)])
    1.0
    """
    steps = [np.diff(track.times)[~gap] for track, gap in zip(tracks, gaps, strict=True)]
    metres = [
        np.linalg.norm(np.diff(track.positions, axis=0), axis=1)[~gap]
        for track, gap in zip(tracks, gaps, strict=True)
    ]
    seconds, way = np.concatenate([np.zeros(0), *steps]), np.concatenate([np.zeros(0), *metres])
    order = np.argsort(seconds, kind="stable")
    run = np.cumsum(way[order])
    if not len(run) or not run[-1] > 0:
        return None
    return float(seconds[order][np.searchsorted(run, _DISTANCE_SHARE * run[-1])])
