"""Rounding of a least-squares solution to whole numbers, node by node."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

__all__ = ["round_node_positions"]


@jit
def round_node_positions(
    offsets: NDArray[np.int32],
    columns: NDArray[np.int32],
    values: NDArray[np.float64],
    right: NDArray[np.float64],
    positions: NDArray[np.float64],
    sweeps: int,
) -> None:
    """Round the minimiser of x'Kx - 2x'r in place, K symmetric in CSR form, each node given its neighbours, ``sweeps`` times."""
    for _ in range(sweeps):
        for v in range(len(positions)):
            for axis in range(positions.shape[1]):
                rest = right[v, axis]
                own = 0.0
                for i in range(offsets[v], offsets[v + 1]):
                    w = columns[i]
                    if w == v:
                        own += values[i]
                    else:
                        rest -= values[i] * positions[w, axis]
                if own > 0.0:
                    positions[v, axis] = np.rint(rest / own)
