"""Weights of the samples of tracks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.read_only import read_only
from gpszip.model import Track

__all__ = ["sample_weights"]


def sample_weights(track: Track) -> NDArray[np.float64]:
    """Weights of a track's samples, 1 where it has none; the array can't be written to."""
    return read_only(np.ones(len(track))) if track.weights is None else track.weights
