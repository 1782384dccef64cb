"""Error budgets: groups of samples, each with a bound of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ErrorBudgets"]


@dataclass(frozen=True, eq=False)
class ErrorBudgets:
    """Groups of samples, each with a bound on its error.

    Parameters
    ----------
    groups : int64 array, shape (n,)
        Group of each sample; all samples of a piece have the same.
    rms : float64 array, shape (G,)
        Largest root mean square error of each group by the samples' weights, in grid steps.
    """

    groups: NDArray[np.int64]
    rms: NDArray[np.float64]

    def sum_by_group(self, values: NDArray[np.float64] | NDArray[np.int64]) -> NDArray[np.float64]:
        """Sum values over the samples of each group."""
        sums: NDArray[np.float64] = np.bincount(
            self.groups, weights=values, minlength=len(self.rms)
        ).astype(np.float64)
        return sums
