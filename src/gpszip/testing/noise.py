"""Position errors of receivers: errors that drift, and smooth random curves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["drift", "smooth"]

Floats = NDArray[np.float64]


def drift(
    points: int, noise: float, memory: float, rng: np.random.Generator, dimension: int = 2
) -> Floats:
    """Return position errors of a first-order autoregressive process, by a truncated filter.

    Parameters
    ----------
    points : int
        Number of samples.
    noise : float
        Standard deviation along each axis, in metres.
    memory : float
        Samples after which the correlation has fallen to 1/e.
    rng : numpy.random.Generator
        Random numbers.
    dimension : int
        Number of coordinates.
    """
    weights = np.exp(-np.arange(int(8 * memory)) / memory)
    scale = noise / np.sqrt((weights**2).sum())
    shocks = rng.normal(0, scale, (points + len(weights) - 1, dimension))
    return np.column_stack([np.convolve(column, weights, mode="valid") for column in shocks.T])


def smooth(values: Floats, sigma: float) -> Floats:
    """Gaussian smoothing over sigma samples; the end values are repeated beyond the ends."""
    reach = int(4 * sigma)
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), window / window.sum(), mode="valid")
