"""Choose the plane of a log larger than memory from a sample of its positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.planes import choose_plane
from gpszip.model import Plane

__all__ = ["PlaneSample"]

#: Positions in the regular sample; above it, every second one is dropped. They take 16 MiB.
_MAX_SAMPLE = 1 << 20

#: Width of a cell in degrees; one position of each cell is kept besides the regular sample.
_CELL_DEGREES = 0.5

#: Cells in the direction of longitude are numbered below this: 720 cells go around the globe.
_CELL_STRIDE = 10_000

Floats = NDArray[np.float64]


class PlaneSample:
    """A sample of positions from which the plane is chosen.

    It holds every k-th position, and one position of each cell of half a degree, so that a short
    trip to a far country counts, too.
    """

    def __init__(self) -> None:
        self._sample: list[Floats] = []
        self._sample_size = 0
        self._stride = 1  # k
        self._seen = 0
        self._cells: dict[tuple[int, int], Floats] = {}

    def add(self, degrees: Floats) -> None:
        """Add latitudes and longitudes in degrees, shape (n, 2)."""
        # Take every k-th position, counted over all batches.
        # The start is the first row of the batch whose number among all rows is a multiple of k.
        regular = degrees[-self._seen % self._stride :: self._stride]
        self._seen += len(degrees)
        self._sample.append(regular.copy())
        self._sample_size += len(regular)

        # Take the first position of each cell.
        cells = np.floor(degrees / _CELL_DEGREES).astype(np.int64)
        _, first = np.unique(cells[:, 0] * _CELL_STRIDE + cells[:, 1], return_index=True)
        for i in first.tolist():
            self._cells.setdefault((int(cells[i, 0]), int(cells[i, 1])), degrees[i].copy())

        # Halve a sample that is too large.
        if self._sample_size > _MAX_SAMPLE:
            self._sample = [np.concatenate(self._sample)[::2]]
            self._sample_size = len(self._sample[0])
            self._stride = 2 * self._stride

    def plane(self) -> Plane:
        """Choose the plane for all positions."""
        cells = (position[None] for position in self._cells.values())
        degrees = np.concatenate([*self._sample, *cells])
        return choose_plane(degrees[:, 0], degrees[:, 1])
