"""Groups of samples, each of which keeps to an error of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ErrorBudgets"]


@dataclass(frozen=True, eq=False)
class ErrorBudgets:
    """Groups of samples, each of which keeps to an error of its own.

    Parameters
    ----------
    groups : int64 array, shape (n,)
        Group of each sample; all of a piece have the same.
    rms : float64 array, shape (G,)
        Largest root mean square error of each group by the samples' weights, in quanta.
    """

    groups: NDArray[np.int64]
    rms: NDArray[np.float64]

    def sums(self, values: NDArray[np.float64] | NDArray[np.int64]) -> NDArray[np.float64]:
        """Sums over the samples of each group."""
        summed: NDArray[np.float64] = np.bincount(
            self.groups, weights=values, minlength=len(self.rms)
        ).astype(np.float64)
        return summed
