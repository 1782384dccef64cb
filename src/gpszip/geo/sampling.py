"""The sampling interval of a log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.steps import steps_between
from gpszip.model import Track

__all__ = ["sampling_interval"]

#: Share of the distance that was travelled in steps no longer than the sampling interval.
_DISTANCE_SHARE = 0.75


def sampling_interval(tracks: Sequence[Track], gaps: Sequence[NDArray[np.bool_]]) -> float | None:
    """Return the third quartile of the intervals between samples, weighted by distance.

    Steps are weighted by metres, not counted: a parked receiver may log rarely or often without
    effect, and in a mixed fleet the vehicles that log rarely determine the interval.

    Parameters
    ----------
    tracks : sequence of Track
        The log.
    gaps : sequence of bool array, shape (n - 1,)
        For each track, the steps that are gaps.

    Returns
    -------
    float or None
        Seconds; None if there is no movement.

    Examples
    --------
    >>> track = Track("a", [0, 1, 2, 3, 60], [[0.0], [9.0], [18.0], [27.0], [28.0]])
    >>> sampling_interval([track], [np.zeros(4, bool)])
    1.0
    """
    # Seconds and metres of all steps that are no gaps.
    if not tracks:
        return None
    is_known = ~np.concatenate(list(gaps))
    intervals = steps_between([track.times for track in tracks])[is_known]
    steps = steps_between([track.positions for track in tracks])[is_known]
    distances = np.linalg.norm(steps, axis=1)

    # Weighted quantile.
    order = np.argsort(intervals, kind="stable")
    cumulative = np.cumsum(distances[order])
    if not len(cumulative) or not cumulative[-1] > 0:
        return None
    # The first step, from the shortest interval on, at which the share is reached.
    quantile_step = np.searchsorted(cumulative, _DISTANCE_SHARE * cumulative[-1])
    return float(intervals[order][quantile_step])
