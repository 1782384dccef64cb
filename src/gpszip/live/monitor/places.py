"""Places where an agent has stayed: a single fix at one of them is no error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.live.fix import Fix, distance
from gpszip.live.monitor.json_times import time_from_json, time_to_json

__all__ = ["VisitedPlaces"]

#: Places of an agent; of more, the one that was visited least recently is forgotten.
_MAX_PLACES = 256

Floats = NDArray[np.float64]


class VisitedPlaces:
    """Centres of the places where an agent has stayed, the last visited one last.

    Parameters
    ----------
    radius : float
        Metres around a centre that belong to a place.
    geographic : bool
        Whether positions are in degrees.

    Examples
    --------
    >>> places = VisitedPlaces(100.0, geographic=False)
    >>> places.add((0.0, 0.0), 10.0), places.add((500.0, 0.0), 20.0), places.add((8.0, 0.0), 30.0)
    (True, True, False)
    >>> places.coordinates().tolist()
    [[500.0, 0.0], [4.0, 0.0]]
    """

    def __init__(self, radius: float, *, geographic: bool) -> None:
        self._radius, self._geographic = radius, geographic
        self._centres: list[tuple[tuple[float, ...], int]] = []

        #: Time of the last stay that was added.
        self.until = float("-inf")

    def add(self, position: tuple[float, ...], time: float) -> bool:
        """Add a stay that was seen; return whether its place is new."""
        # A visit of a known place moves its centre.
        self.until = time
        centre, count = position, 1
        for number, (other, visits) in enumerate(self._centres):
            if self._metres(other, position) <= self._radius and len(other) == len(position):
                # Means of visits far from the antimeridian, where a place is at most a radius wide.
                share = 1 / (visits + 1)
                if max(abs(a - b) for a, b in zip(other, position, strict=True)) < 180:
                    pairs = zip(other, position, strict=True)
                    centre = tuple((1 - share) * a + share * b for a, b in pairs)
                count = visits + 1
                del self._centres[number]
                break

        # Places that were visited last are kept.
        self._centres.append((centre, count))
        del self._centres[:-_MAX_PLACES]
        return count == 1

    def coordinates(self) -> Floats:
        """Centres, shape (k, d)."""
        dimension = min((len(centre) for centre, _ in self._centres), default=2)
        rows = [centre[:dimension] for centre, _ in self._centres]
        return np.array(rows, np.float64).reshape(-1, dimension)

    def _metres(self, one: tuple[float, ...], other: tuple[float, ...]) -> float:
        length = min(len(one), len(other))
        fixes = [Fix("", "", 0.0, 0.0, each[:length], self._geographic) for each in (one, other)]
        return distance(*fixes)

    def to_row(self) -> list[Any]:
        """Return the state as a value of JSON."""
        return [time_to_json(self.until), self._centres]

    def restore(self, row: Sequence[Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        until, centres = row
        self.until = time_from_json(until)
        self._centres = [(tuple(centre), count) for centre, count in centres]
