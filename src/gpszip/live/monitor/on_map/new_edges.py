"""Paths off the map that are travelled again: edges that the map does not have."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.live.monitor.known import Finding
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.model.projection import map_coordinates

__all__ = ["NewEdges"]

#: Metres of a path, at least: shorter ones are errors of the receiver.
_MIN_LENGTH = 50.0

#: Metres by which two travels of one path differ on average, at most, and as a multiple of the
#: error of the map.
_MAX_DISTANCE, _MAX_ERRORS = 20.0, 4.0

#: Positions at even shares of a path, by which paths are compared.
_POSITIONS = 16

#: Paths that are kept; of more, the one that was travelled least recently is forgotten.
_MAX_PATHS = 500

Floats = NDArray[np.float64]


class NewEdges:
    """Keeps paths off the map of all agents, and tells those that are travelled again.

    Parameters
    ----------
    known_map : KnownMap
        The map.
    """

    def __init__(self, known_map: KnownMap) -> None:
        self._map = known_map
        self._limit = max(_MAX_DISTANCE, _MAX_ERRORS * known_map.scales.error)
        self._paths: list[tuple[Floats, int]] = []

    def add(self, positions: Floats, time: float) -> list[Finding]:
        """Take a path in metres, shape (n, 2); return that it is a new edge, the second time."""
        if len(positions) < 2:
            return []
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        along = np.append(0.0, np.cumsum(steps))
        if along[-1] < _MIN_LENGTH:
            return []
        shares = np.linspace(0.0, along[-1], _POSITIONS)
        path = np.stack([np.interp(shares, along, axis) for axis in positions.T], axis=1)

        # In either direction, it is one path.
        count = 1
        for number, (other, times) in enumerate(self._paths):
            apart = min(_apart(path, other), _apart(path[::-1], other))
            if apart <= self._limit:
                count = times + 1
                del self._paths[number]
                break
        self._paths.append((path, count))
        del self._paths[:-_MAX_PATHS]
        return [self._finding(path, time, float(along[-1]))] if count == 2 else []

    def _finding(self, path: Floats, time: float, length: float) -> Finding:
        line = map_coordinates(path, self._map.plane)
        decimals = 2 if self._map.plane is None else 7
        details = {"length": round(length, 1), "path": line.round(decimals).tolist()}
        place = tuple(line[len(line) // 2].tolist())
        why = f"{length:,.0f} m off the map were travelled twice"
        return Finding("new_edge", time, place, "", why, details)

    def to_row(self) -> list[Any]:
        """Return the state as a value of JSON."""
        return [[path.tolist(), count] for path, count in self._paths]

    def restore(self, row: list[Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self._paths = [(np.array(path), count) for path, count in row]


def _apart(one: Floats, other: Floats) -> float:
    if one.shape != other.shape:
        return float("inf")
    return float(np.linalg.norm(one - other, axis=1).mean())
