"""The plane of a log larger than memory, chosen from a share of its positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import choose_plane
from gpszip.model import Plane

__all__ = ["PlaneSample"]

#: Samples from which the plane is chosen, and cells of so many degrees of which each has one besides.
_MAX_SAMPLE, _CELL_DEGREES = 1 << 20, 0.5

Floats = NDArray[np.float64]


class PlaneSample:
    """A share of all positions, and one of each place where there are any, from which the planes are chosen."""

    def __init__(self) -> None:
        self._kept: list[Floats] = []
        self._stride, self._seen, self._count = 1, 0, 0
        self._cells: dict[tuple[int, int], Floats] = {}

    def add(self, degrees: Floats) -> None:
        """Take in positions, shape (n, 2)."""
        own = degrees[-self._seen % self._stride :: self._stride]
        self._seen += len(degrees)
        self._kept.append(own.copy())
        self._count += len(own)
        cells = np.floor(degrees / _CELL_DEGREES).astype(np.int64)
        _, first = np.unique(cells[:, 0] * 10_000 + cells[:, 1], return_index=True)
        for i in first.tolist():
            self._cells.setdefault((int(cells[i, 0]), int(cells[i, 1])), degrees[i].copy())
        if self._count > _MAX_SAMPLE:
            self._kept = [np.concatenate(self._kept)[::2]]
            self._count, self._stride = len(self._kept[0]), 2 * self._stride

    def plane(self) -> Plane:
        """Choose the plane for all that was taken in."""
        degrees = np.concatenate([*self._kept, *(place[None] for place in self._cells.values())])
        return choose_plane(degrees[:, 0], degrees[:, 1])
