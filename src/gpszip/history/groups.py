"""Sums over groups of numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["sum_by"]


def sum_by(
    group: NDArray[np.int64], values: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Sum of the values in each of ``count`` groups.

    Examples
    --------
    >>> sum_by(np.array([0, 2, 0]), np.array([1.0, 5.0, 2.0]), 3).tolist()
    [3.0, 0.0, 5.0]
    """
    return np.bincount(group, weights=values, minlength=count).astype(np.float64)
