"""The last fixes of an agent, in the order of time and in bounded memory."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.live.fix import Fix
from gpszip.live.monitor.json_times import time_from_json, time_to_json
from gpszip.live.monitor.reorder import is_better

__all__ = ["Window"]

#: Seconds between fixes up to which one between them may be left out.
_MAX_SPACING = 60.0

Floats = NDArray[np.float64]


class Window:
    """Times, positions, accuracies and headings of the last fixes of an agent.

    Parameters
    ----------
    geographic : bool
        Whether positions are in degrees; then they have two coordinates.

    Examples
    --------
    >>> window = Window(geographic=True)
    >>> for time in (7.0, 9.0, 8.0):
    ...     added = window.add(Fix("bus", "gpsd", time, 9.0, (48.0, 11.5)))
    >>> window.times.tolist()
    [7.0, 8.0, 9.0]
    """

    def __init__(self, *, geographic: bool) -> None:
        self.geographic = geographic
        self._times = array("d")
        self._columns = tuple(array("d") for _ in range(2 if geographic else 3))
        self._accuracy, self._heading = array("d"), array("d")
        self._dimension = 3

        #: Fixes up to this time, in seconds, are not all there any more.
        self.complete_after = -math.inf

    def __len__(self) -> int:
        return len(self._times)

    @property
    def times(self) -> Floats:
        """Seconds, shape (n,)."""
        return np.array(self._times)

    @property
    def last(self) -> float:
        """Time of the last fix."""
        return self._times[-1]

    @property
    def first(self) -> float:
        """Time of the first fix."""
        return self._times[0]

    def add(self, fix: Fix) -> bool:
        """Take a fix; return whether it tells anything new."""
        # One at the same time must be better.
        row = len(self._times)
        if row and fix.time <= self._times[-1]:
            row = bisect_left(self._times, fix.time)
            if self._times[row] == fix.time:
                stated = None if math.isnan(self._accuracy[row]) else self._accuracy[row]
                if not is_better(fix.accuracy, stated):
                    return False
                self.remove(row)

        # Coordinates that not all fixes have are left out of all.
        self._dimension = min(self._dimension, len(fix.position))
        self._times.insert(row, fix.time)
        position = (*fix.position, 0.0)
        for number, column in enumerate(self._columns):
            column.insert(row, position[number])
        self._accuracy.insert(row, math.nan if fix.accuracy is None else fix.accuracy)
        self._heading.insert(row, math.nan if fix.heading is None else fix.heading)
        return True

    def remove(self, row: int) -> None:
        """Remove a fix."""
        for column in (self._times, self._accuracy, self._heading, *self._columns):
            del column[row]

    def coordinates(self) -> Floats:
        """Latitudes and longitudes, or x, y[, z], shape (n, d)."""
        columns = self._columns[: min(self._dimension, len(self._columns))]
        return np.stack([np.array(column) for column in columns], axis=1)

    def accuracy(self) -> Floats:
        """Metres, NaN where it is not known; shape (n,)."""
        return np.array(self._accuracy, np.float64)

    def fix(self, row: int, agent: str) -> Fix:
        """One fix, as far as it is kept."""
        accuracy, heading = (
            None if math.isnan(column[row]) else column[row]
            for column in (self._accuracy, self._heading)
        )
        time, position = self._times[row], self.position(row)
        return Fix(agent, "", time, time, position, self.geographic, accuracy, heading)

    def position(self, row: int) -> tuple[float, ...]:
        """Coordinates of one fix."""
        columns = self._columns[: min(self._dimension, len(self._columns))]
        return tuple(column[row] for column in columns)

    def row_at(self, time: float) -> int:
        """Number of the first fix that is not before a time."""
        return bisect_left(self._times, time)

    def time(self, row: int) -> float:
        """Time of one fix."""
        return self._times[row]

    def drop(self, count: int) -> None:
        """Remove the first fixes."""
        if count:
            self.complete_after = max(self.complete_after, self._times[count - 1])
        for column in (self._times, self._accuracy, self._heading, *self._columns):
            del column[:count]

    def thin(self, kept: Sequence[float]) -> None:
        """Leave out every other fix of the earlier half, where others are near in time.

        Parameters
        ----------
        kept : sequence of float
            Times around which all fixes stay: begins and ends of stays.
        """
        times = self.times
        is_kept = np.ones(len(times), np.bool_)
        spacing = times[2:] - times[:-2]
        is_kept[1:-1:2] = spacing[::2] > _MAX_SPACING
        is_kept[len(times) // 2 :] = True
        self.complete_after = float(times[len(times) // 2 - 1])
        for time in kept:
            is_kept |= np.abs(times - time) <= _MAX_SPACING
        self._keep(is_kept)

    def _keep(self, rows: NDArray[np.bool_]) -> None:
        columns = (self._times, self._accuracy, self._heading, *self._columns)
        self._times, self._accuracy, self._heading, *others = (
            array("d", np.array(column)[rows].tobytes()) for column in columns
        )
        self._columns = tuple(others)

    def to_rows(self) -> dict[str, Any]:
        """Return the fixes as a value of JSON."""
        return {
            "times": self._times.tolist(),
            "columns": [column.tolist() for column in self._columns],
            "accuracy": _without_nan(self._accuracy),
            # Most agents have none.
            "heading": None if all(map(math.isnan, self._heading)) else _without_nan(self._heading),
            "dimension": self._dimension,
            "complete_after": time_to_json(self.complete_after),
        }

    def restore(self, rows: dict[str, Any]) -> None:
        """Hold what :meth:`to_rows` returned."""
        self._times = array("d", rows["times"])
        self._columns = tuple(array("d", column) for column in rows["columns"])
        nothing = [None] * len(self._times)
        self._accuracy, self._heading = (
            array("d", (math.nan if each is None else each for each in stated or nothing))
            for stated in (rows["accuracy"], rows["heading"])
        )
        self._dimension = rows["dimension"]
        self.complete_after = time_from_json(rows["complete_after"])


def _without_nan(column: array[float]) -> list[float | None]:
    return [None if math.isnan(each) else each for each in column]
