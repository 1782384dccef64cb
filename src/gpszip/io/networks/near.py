"""Which ground is near a log: cells around its points, wider where it was silent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["NearbyArea", "build_nearby_area"]

#: Ground within this many metres of a log's points is near, and of a step within this share of its length besides.
_MIN_REACH, _REACH_SHARE = 2000.0, 0.5

#: Steps longer than this many metres are jumps, on which nobody travelled.
_JUMP = 1e6

_KEY_OFFSET = 1 << 30

Floats = NDArray[np.float64]


class NearbyArea:
    """Cells of ground, on a few levels of which each is twice as wide as the one before.

    Parameters
    ----------
    cells : dict of float to int64 array
        Width of the cells in metres, and the sorted keys of those that are near.
    """

    def __init__(self, cells: dict[float, NDArray[np.int64]]) -> None:
        self.cells = cells

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points are on near ground, shape (n,)."""
        near = np.zeros(len(points), np.bool_)
        for width, keys in self.cells.items():
            wanted = _cell_keys(points, width)
            place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            near |= keys[place] == wanted
        return near

    def boxes(self) -> tuple[Floats, Floats]:
        """Centres, shape (n, 2), and half widths in metres, shape (n,), of all cells."""
        centres = [
            (np.stack(_cell_coordinates(keys), axis=1) + 0.5) * width
            for width, keys in self.cells.items()
        ]
        halves = [np.full(len(keys), width / 2) for width, keys in self.cells.items()]
        return np.concatenate(centres), np.concatenate(halves)


def build_nearby_area(tracks: Sequence[Track]) -> NearbyArea:
    """Ground on which roads matter to a log.

    Examples
    --------
    >>> area = build_nearby_area([Track("a", [0, 60], [[0.0, 0.0], [20000.0, 0.0]])])
    >>> area.contains(np.array([[10000.0, 5000.0], [-30000.0, 0.0]])).tolist()
    [True, False]
    """
    points = np.concatenate([_planar_positions(track) for track in tracks])
    steps = np.concatenate(
        [
            np.append(np.linalg.norm(np.diff(track.positions[:, :2], axis=0), axis=1), 0.0)
            for track in tracks
        ]
    )
    steps = np.where(steps > _JUMP, 0.0, steps)
    level = np.ceil(np.log2(1 + _REACH_SHARE * steps / _MIN_REACH)).astype(np.int64)
    following = np.append(points[1:], points[-1:], axis=0)
    cells = {}
    for one in np.unique(level).tolist():
        here = level == one
        a, b = points[here], np.where(steps[here, None] > 0, following[here], points[here])
        width = _MIN_REACH * 2.0**one
        cells[width] = _with_neighbours(
            np.unique(_cell_keys(np.concatenate((a, (a + b) / 2, b)), width))
        )
    return NearbyArea(cells)


def _planar_positions(track: Track) -> Floats:
    flat = track.positions[:, :2]
    return flat if flat.shape[1] == 2 else np.pad(flat, ((0, 0), (0, 1)))


def _cell_keys(points: Floats, width: float) -> NDArray[np.int64]:
    x, y = np.floor(points / width).astype(np.int64).T
    keys: NDArray[np.int64] = (x + _KEY_OFFSET) * (2 * _KEY_OFFSET) + y + _KEY_OFFSET
    return keys


def _cell_coordinates(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return keys // (2 * _KEY_OFFSET) - _KEY_OFFSET, keys % (2 * _KEY_OFFSET) - _KEY_OFFSET


def _with_neighbours(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """These cells and their neighbours."""
    shifts = (np.arange(-1, 2)[:, None] * (2 * _KEY_OFFSET) + np.arange(-1, 2)).ravel()
    return np.unique(keys[:, None] + shifts)
