"""The area near a log: cells around its points, wider ones along its long steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track

__all__ = ["NearbyArea", "build_nearby_area"]

#: The area reaches at least this many metres around each point.
_MIN_REACH = 2000.0

#: Around a step, it reaches this share of the length of the step, too: between two points, a
#: vehicle may have left the straight line.
_REACH_SHARE = 0.5

#: Longer steps in metres are jumps between planes or trips; nobody travelled them.
_MAX_STEP = 1e6

#: Added to cell coordinates so that they are not negative; a key is x * 2 ** 31 + y.
_KEY_OFFSET = 1 << 30

Floats = NDArray[np.float64]
Keys = NDArray[np.int64]


class NearbyArea:
    """Square cells on a few levels; the cells of a level are twice as wide as those below.

    Parameters
    ----------
    cells : dict of float to int64 array
        For each level, the width of its cells in metres and the sorted keys of its cells.
    """

    def __init__(self, cells: dict[float, Keys]) -> None:
        self.cells = cells

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points are in the area, shape (n,)."""
        near = np.zeros(len(points), np.bool_)
        for width, keys in self.cells.items():
            # Look up the cell of each point; past the last key, compare with the last one.
            wanted = _cell_keys(points, width)
            position = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            near |= keys[position] == wanted
        return near

    def boxes(self) -> tuple[Floats, Floats]:
        """Return centres of all cells, shape (n, 2), and half widths, shape (n,), in metres."""
        # Cell (i, j) reaches from i to i + 1 and from j to j + 1 widths.
        centres = [
            (np.stack(_cell_coordinates(keys), axis=1) + 0.5) * width
            for width, keys in self.cells.items()
        ]
        half_widths = [np.full(len(keys), width / 2) for width, keys in self.cells.items()]
        return np.concatenate(centres), np.concatenate(half_widths)


def build_nearby_area(tracks: Sequence[Track]) -> NearbyArea:
    """Build the area in which roads matter to a log.

    Level k has cells of 2000 * 2**k metres. A step belongs to the lowest level whose cells are
    wide enough for its reach. Its ends and its middle mark their cells and the eight neighbours.

    Parameters
    ----------
    tracks : sequence of Track
        The log.

    Examples
    --------
    >>> area = build_nearby_area([Track("a", [0, 60], [[0.0, 0.0], [20000.0, 0.0]])])
    >>> area.contains(np.array([[10000.0, 5000.0], [-30000.0, 0.0]])).tolist()
    [True, False]
    """
    # Length of the step that starts at each point; 0 at the last point of a track and at jumps.
    points = np.concatenate([_planar_positions(track) for track in tracks])
    steps = np.concatenate(
        [
            np.append(np.linalg.norm(np.diff(track.positions[:, :2], axis=0), axis=1), 0.0)
            for track in tracks
        ]
    )
    steps = np.where(steps > _MAX_STEP, 0.0, steps)

    # Mark cells, level by level.
    # The reach is 2000 + 0.5 * step metres; level k is enough if 2000 * 2**k is not less.
    levels = np.ceil(np.log2(1 + _REACH_SHARE * steps / _MIN_REACH)).astype(np.int64)
    next_points = np.append(points[1:], points[-1:], axis=0)
    cells = {}
    for level in np.unique(levels).tolist():
        on_level = levels == level
        # A step of length 0 stays in its cell: the next point is of another track, or a jump away.
        start = points[on_level]
        end = np.where(steps[on_level, None] > 0, next_points[on_level], start)
        width = _MIN_REACH * 2.0**level
        marks = np.concatenate((start, (start + end) / 2, end))
        cells[width] = _with_neighbours(np.unique(_cell_keys(marks, width)))
    return NearbyArea(cells)


def _planar_positions(track: Track) -> Floats:
    """Return x and y of a track; y is 0 for a track with one axis."""
    flat = track.positions[:, :2]
    return flat if flat.shape[1] == 2 else np.pad(flat, ((0, 0), (0, 1)))


def _cell_keys(points: Floats, width: float) -> Keys:
    x, y = np.floor(points / width).astype(np.int64).T
    keys: Keys = (x + _KEY_OFFSET) * (2 * _KEY_OFFSET) + y + _KEY_OFFSET
    return keys


def _cell_coordinates(keys: Keys) -> tuple[Keys, Keys]:
    return keys // (2 * _KEY_OFFSET) - _KEY_OFFSET, keys % (2 * _KEY_OFFSET) - _KEY_OFFSET


def _with_neighbours(keys: Keys) -> Keys:
    """Return cells and their eight neighbours, sorted."""
    # One cell further in x adds 2**31 to a key, and one further in y adds 1.
    shifts = (np.arange(-1, 2)[:, None] * (2 * _KEY_OFFSET) + np.arange(-1, 2)).ravel()
    return np.unique(keys[:, None] + shifts)
