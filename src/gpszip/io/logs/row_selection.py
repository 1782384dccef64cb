"""Select the rows of a file by time and area, batch by batch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.raw import RawLog
from gpszip.model.selection import BoundingBox, Selection

__all__ = ["RowSelection", "rows_in_box"]

#: Degrees of a full turn.
_FULL_TURN = 360.0

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]


class RowSelection:
    """Keeps the rows of one file that a selection wants, and notes where tracks leave its area.

    Parameters
    ----------
    selection : Selection
        Its tracks don't count here: their names are known when all files are read.
    """

    def __init__(self, selection: Selection) -> None:
        self._selection = selection
        self._outside: set[int] = set()  # names whose last row lies outside of the area
        #: Number of rows that were not selected.
        self.dropped = 0
        #: First and last time of all rows in seconds.
        self.first_time, self.last_time = np.inf, -np.inf

    def find(self, raw: RawLog, names: NDArray[np.int32], rows: Rows) -> tuple[Flags, Flags]:
        """Find the rows that are selected.

        Parameters
        ----------
        raw : RawLog
            A batch of rows.
        names : int32 array, shape (m,)
            Index of the name of the track, for each row that can be used; not decreasing.
        rows : int array, shape (m,)
            These rows.

        Returns
        -------
        bool array, shape (m,)
            Whether each row is selected.
        bool array, shape (m,)
            Whether the row before of the same name lies outside of the area, and this one inside.
        """
        # Most logs are read as a whole.
        if self._selection.bbox is None and not self._selection.has_times:
            return np.ones(len(rows), np.bool_), np.zeros(len(rows), np.bool_)

        # In the time range? Tracks without times are in none.
        times = raw.times[rows]
        begin, end = self._selection.time_range
        selected = (times >= begin) & (times <= end)
        if raw.untimed:
            codes = np.zeros(len(rows), np.int64) if raw.codes is None else raw.codes[rows]
            is_shape = np.isin(codes, list(raw.untimed))
            selected = np.where(is_shape, not self._selection.has_times, selected)
            times = times[~is_shape]
        self.first_time = min(self.first_time, times.min(initial=np.inf))
        self.last_time = max(self.last_time, times.max(initial=-np.inf))

        # In the area?
        returns = np.zeros(len(rows), np.bool_)
        bbox = self._selection.bbox
        if bbox is not None:
            inside = rows_in_box(raw.coordinates[rows], bbox, geographic=raw.geographic)
            returns = inside & self._was_outside(names, inside)
            selected &= inside
        self.dropped += int((~selected).sum())
        return selected, returns

    def _was_outside(self, names: NDArray[np.int32], inside: Flags) -> Flags:
        """Whether the row of the same name before each row lies outside; keep it for the next."""
        if not len(names):
            return inside
        starts = np.append(True, names[1:] != names[:-1])
        was_outside = np.append(False, ~inside[:-1])
        was_outside[starts] = [name in self._outside for name in names[starts].tolist()]

        # The last row of each name counts for the next batch.
        last = np.append(starts[1:], True)
        for name, is_inside in zip(names[last].tolist(), inside[last].tolist(), strict=True):
            (self._outside.discard if is_inside else self._outside.add)(name)
        return was_outside


def rows_in_box(coordinates: NDArray[np.float64], bbox: BoundingBox, *, geographic: bool) -> Flags:
    """Return which rows lie in an area, its sides included.

    Parameters
    ----------
    coordinates : float64 array, shape (n, d)
        Latitude and longitude in degrees, or x and y in metres.
    bbox : BoundingBox
        The area.
    geographic : bool
        Whether coordinates are degrees.

    Examples
    --------
    >>> rows = np.array([[-15.0, 175.0], [-15.0, -175.0], [-15.0, 160.0]])
    >>> rows_in_box(rows, BoundingBox(170, -20, -170, -10), geographic=True).tolist()
    [True, True, False]
    """
    bbox.check(geographic=geographic)
    x, y = (coordinates[:, 1], coordinates[:, 0]) if geographic else coordinates[:, :2].T
    in_y = (y >= bbox.south) & (y <= bbox.north)
    if not geographic:
        inside: Flags = in_y & (x >= bbox.west) & (x <= bbox.east)
        return inside

    # Both sides themselves are compared as they are: a remainder would round them.
    is_side = (x == bbox.west) | (x == bbox.east)
    inside = in_y & (is_side | (np.mod(x - bbox.west, _FULL_TURN) <= bbox.width))
    return np.asarray(inside)
