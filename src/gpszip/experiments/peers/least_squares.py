"""The line of least squares with knots at the times of some samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from gpszip.experiments.peers.knots import Knots
from gpszip.model import Track

__all__ = ["fit_line"]

#: Weight of the sample at a knot, which decides where no other does.
_RIDGE = 1e-3

Ints = NDArray[np.int64]


def fit_line(track: Track, kept: Ints) -> Knots:
    """Return the line of least squared synchronised distances, with knots at the times of samples.

    Sample i lies between knots j and j + 1 at the share w of that interval, so that the line has
    ``(1 - w) v_j + w v_{j+1}`` there. The normal equations for the vertices v have three diagonals.

    Parameters
    ----------
    track : Track
        n samples.
    kept : int64 array
        Samples at whose times the knots are, among them both ends.

    Examples
    --------
    >>> track = Track("a", range(9), [[t, max(t - 4.0, 0.0)] for t in range(9)])
    >>> fit_line(track, np.array([0, 4, 8])).positions.round(6).tolist()
    [[0.0, 0.0], [4.0, 0.0], [8.0, 4.0]]
    """
    # Where each sample lies.
    knots = track.times[kept]
    count = len(knots)
    owner = np.clip(np.searchsorted(knots, track.times, side="right") - 1, 0, count - 2)
    w = (track.times - knots[owner]) / np.diff(knots)[owner]

    # The diagonal, the one beside it, and the right sides.
    def add(weights: NDArray[np.float64], at: Ints) -> NDArray[np.float64]:
        return np.bincount(at, weights=weights, minlength=count).astype(np.float64)

    diagonal = add((1 - w) ** 2, owner) + add(w**2, owner + 1) + _RIDGE
    beside = add(w * (1 - w), owner)
    right = np.column_stack(
        [add((1 - w) * axis, owner) + add(w * axis, owner + 1) for axis in track.positions.T]
    )
    right += _RIDGE * track.positions[kept]

    # Solve.
    banded = np.vstack([diagonal, beside])
    return Knots(knots, solveh_banded(banded, right, lower=True))
