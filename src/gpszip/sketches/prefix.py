"""Moments of any interval of a track in constant time, exact at epoch seconds and UTM metres.

:mod:`gpszip.kernels.sums` describes the method; this module applies it to tracks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.kernels.sums import PrefixSums, segment_moments

__all__ = ["interval_moments"]


def interval_moments(sums: PrefixSums, boundaries: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the moments of consecutive intervals, each in its own time u from 0 to 1.

    Positions r are relative to the first sample of the interval.

    Parameters
    ----------
    sums : PrefixSums
        A track, from :func:`gpszip.kernels.sums.track_sums`.
    boundaries : int64 array, shape (k + 1,)
        Increasing indices; interval j has samples ``boundaries[j]`` to ``boundaries[j + 1] - 1``.

    Returns
    -------
    float64 array, shape (k, 2 d + 4)
        ``W, U1, U2, Q, M_1..M_d, N_1..N_d``: sums of w, w u, w u^2, w |r|^2, w r and w u r, with
        r in position ticks.

    Raises
    ------
    OptionError
        If the boundaries don't increase or leave the track.

    Examples
    --------
    >>> from gpszip.kernels.sums import track_sums
    >>> from gpszip.model import Track
    >>> sums = track_sums(Track("walk", [0, 1, 2], [[0], [1], [2]]))
    >>> interval_moments(sums, np.array([0, 3]))[0, :3].tolist()
    [3.0, 1.5, 1.25]
    """
    boundaries = np.asarray(boundaries, dtype=np.int64)
    if (
        len(boundaries) < 1
        or boundaries[0] < 0
        or boundaries[-1] > len(sums.t)
        or (np.diff(boundaries) < 1).any()
    ):
        raise OptionError(f"boundaries must increase from 0 or more to {len(sums.t)} or less")
    return segment_moments(sums, boundaries)
