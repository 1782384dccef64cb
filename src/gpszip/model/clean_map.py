"""A clean map: ways between junctions, with how they were travelled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.grid import Plane

__all__ = ["CleanMap"]


@dataclass(frozen=True, eq=False)
class CleanMap:
    """Ways, which are lines between junctions or ends, and what the walks tell of each.

    Parameters
    ----------
    junctions : float64 array, shape (J, d)
        Where ways end, in metres. A ring on its own starts and ends at one of its points.
    ends : int32 array, shape (w, 2)
        Junctions u and v at which each way starts and ends.
    offsets : int64 array, shape (w + 1,)
        Way i runs through ``points[offsets[i]:offsets[i + 1]]``, from its junction u to its junction v.
    points : float64 array, shape (n, d)
        Metres.
    length : float64 array, shape (w,)
        Metres.
    forward, backward : int64 array, shape (w,)
        Traversals from u to v and from v to u.
    speed : float64 array, shape (w, 3)
        Lower quartile, median and upper quartile of the speed in m/s, over the metres travelled; NaN where no times are kept.
    hourly : float64 array, shape (w, b)
        Median speed in m/s in each of b equal parts of the day (UTC); NaN where nobody travelled. b is 0 where the log's times
        don't tell the time of day.
    width : float64 array, shape (w,)
        Root mean square distance in metres between the way and the knots of the walks on it; NaN where there is no knot.
    plane : Plane, optional
        Where the points lie on the earth, as for :class:`Track`.
    """

    junctions: NDArray[np.float64]
    ends: NDArray[np.int32]
    offsets: NDArray[np.int64]
    points: NDArray[np.float64]
    length: NDArray[np.float64]
    forward: NDArray[np.int64]
    backward: NDArray[np.int64]
    speed: NDArray[np.float64]
    hourly: NDArray[np.float64]
    width: NDArray[np.float64]
    plane: Plane | None = None

    def __len__(self) -> int:
        return len(self.length)

    def __getitem__(self, way: int) -> NDArray[np.float64]:
        """Points of one way, shape (n, d)."""
        return self.points[self.offsets[way] : self.offsets[way + 1]]
