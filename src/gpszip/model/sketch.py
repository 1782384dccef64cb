"""A sketch: the moments of a block of samples (thesis, definition 6.2.8, 1-segment coreset)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text

__all__ = ["Sketch"]


@dataclass(frozen=True, eq=False, repr=False)
class Sketch:
    """The moments from which the fitting cost of a block against any line follows.

    The thesis keeps (C, E, F) = (A'A, P'A, P'P) about zero, which loses all digits at epoch
    seconds. These are the same moments about the mean of the block. The fitting cost needs 2 d + 4
    numbers; the cross moments of the positions are kept as well, because the fitting matrix D
    (definition 6.2.1) needs them.

    Parameters
    ----------
    weight : float
        W, the sum of weights; 0 for an empty block.
    time : float
        Weighted mean of the times in seconds.
    place : float64 array, shape (d,)
        Weighted mean of the positions in metres.
    spread : float
        Sum of w (t - time)^2 in s^2.
    drift : float64 array, shape (d,)
        Sum of w (t - time) (p - place) in m s.
    scatter : float64 array, shape (d, d)
        Sum of w (p - place) (p - place)' in m^2.
    first, last : float
        Times of the first and the last sample in seconds; inf and -inf for an empty block.
    count : int
        Number of samples.
    """

    # Moments of order 0 (the weight), 1 (the means) and 2 (spread, drift and scatter).
    weight: float
    time: float
    place: NDArray[np.float64]
    spread: float
    drift: NDArray[np.float64]
    scatter: NDArray[np.float64]
    # Moments don't tell when the block begins and ends, which a line through it needs.
    first: float
    last: float
    count: int

    def __repr__(self) -> str:
        samples = count_text(self.count, "sample")
        return f"Sketch({samples}, weight {self.weight:g}, {self.first:.10g} to {self.last:.10g} s)"

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return len(self.place)
