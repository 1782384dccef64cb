"""Rounding of the M-step's positions to the quantisation grid, node by node."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit_uncounted

__all__ = ["round_node_positions"]


@jit_uncounted
def round_node_positions(
    offsets: NDArray[np.int32],
    columns: NDArray[np.int32],
    values: NDArray[np.float64],
    right: NDArray[np.float64],
    positions: NDArray[np.float64],
    sweeps: int,
) -> None:
    """Round the minimiser of x'Kx - 2x'r to whole numbers, in place.

    Coordinate descent: each node v takes the whole number that is nearest to its optimum,
    given its neighbours, ``x[v] = rint((r[v] - sum over w != v of K[v, w] x[w]) / K[v, v])``.

    Parameters
    ----------
    offsets, columns, values : arrays
        The symmetric matrix K in CSR form.
    right : float64 array, shape (V, d)
        The right-hand side r.
    positions : float64 array, shape (V, d)
        The minimiser x, in grid steps; changed in place.
    sweeps : int
        Passes over all nodes.
    """
    # Round one node after the other, so that each optimum allows for the nodes rounded before.
    for _ in range(sweeps):
        for v in range(len(positions)):
            for axis in range(positions.shape[1]):
                # Take the neighbours' terms out of row v, and keep its diagonal.
                residual = right[v, axis]
                diagonal = 0.0
                for i in range(offsets[v], offsets[v + 1]):
                    w = columns[i]
                    if w == v:
                        diagonal += values[i]
                    else:
                        residual -= values[i] * positions[w, axis]

                # A node without samples has no optimum and keeps its position.
                if diagonal > 0.0:
                    positions[v, axis] = np.rint(residual / diagonal)
