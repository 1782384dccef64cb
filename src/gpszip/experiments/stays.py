"""Where a log stays, and for how long."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_figure import from_above
from gpszip.model import Track

__all__ = ["find_stays", "hours_near"]

#: Side in metres of the cells that are compared.
_CELL = 200.0

Floats = NDArray[np.float64]


def hours_near(track: Track, position: Floats, radius: float) -> float:
    """Return the hours between two samples in a row that both lie near a position.

    Examples
    --------
    >>> track = Track("a", [0, 3600, 7200, 10800], [[0, 0], [5, 0], [900, 0], [4, 0]])
    >>> hours_near(track, np.array([0.0, 0.0]), 50.0)
    1.0
    """
    places = from_above(track.positions)
    is_near = np.linalg.norm(places - from_above(position[None]), axis=1) <= radius
    return float(np.diff(track.times)[is_near[:-1] & is_near[1:]].sum()) / 3600


def find_stays(track: Track, count: int) -> list[Floats]:
    """Return the places at which a track stays longest, the longest first.

    A place is the median of the samples in a square cell of 200 m. No two cells touch.

    Parameters
    ----------
    track : Track
        n samples with times.
    count : int
        Most places.

    Examples
    --------
    >>> track = Track("a", [0, 3600, 7200, 7300], [[0, 0], [5, 0], [900, 0], [910, 0]])
    >>> [place.tolist() for place in find_stays(track, 2)]
    [[2.5, 0.0], [905.0, 0.0]]
    """
    # Seconds between two samples in a row in one cell.
    places = from_above(track.positions)
    cells, owners = np.unique(
        np.floor(places / _CELL).astype(np.int64), axis=0, return_inverse=True
    )
    owners = owners.ravel()
    stays = owners[1:] == owners[:-1]
    seconds = np.bincount(
        owners[:-1][stays], weights=np.diff(track.times)[stays], minlength=len(cells)
    )

    # The longest, without neighbours of those that were taken.
    chosen: list[int] = []
    for cell in np.argsort(-seconds, kind="stable").tolist():
        is_free = all(np.abs(cells[cell] - cells[other]).max() > 1 for other in chosen)
        if seconds[cell] > 0 and is_free and len(chosen) < count:
            chosen.append(cell)
    return [np.median(places[owners == cell], axis=0) for cell in chosen]
