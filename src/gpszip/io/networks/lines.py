"""Road lines: what the reader of a network format returns, before lines are joined to a graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.model.read_result import Repair

__all__ = [
    "RoadLines",
    "RoadUsers",
    "TextColumn",
    "take_attributes",
    "take_lines",
    "vertex_rows",
    "within_globe",
]


class RoadUsers(IntEnum):
    """Who uses a road."""

    ANYBODY = 0
    MOTOR_ONLY = 1  # motorways: nobody walks there
    NON_MOTOR = 2  # footways, cycleways, steps


class TextColumn(Sequence[str]):
    """A sequence of texts in an Arrow array, which takes a tenth of the memory of a list.

    Parameters
    ----------
    array : pyarrow string array
        The texts.

    Examples
    --------
    >>> texts = TextColumn(pa.array(["a", "b", "c"]))
    >>> texts[-1], len(texts), texts[:2]
    ('c', 3, ['a', 'b'])
    """

    def __init__(self, array: Any) -> None:
        self.array = array.combine_chunks() if isinstance(array, pa.ChunkedArray) else array

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return self.array.take(pa.array(np.arange(len(self))[index])).to_pylist()
        return self.array[int(index) + (len(self) if index < 0 else 0)].as_py()


@dataclass(frozen=True, eq=False)
class RoadLines:
    """Lines as their source has them.

    Parameters
    ----------
    name : str
        Name of the source in messages.
    coordinates : float64 array, shape (N, 2)
        Longitude and latitude in degrees, or metres.
    offsets : int64 array, shape (E + 1,)
        Line i has the vertices ``coordinates[offsets[i]:offsets[i + 1]]``.
    geographic : bool
        Whether the coordinates are degrees.
    forward, backward : bool array, shape (E,)
        Whether a line may be travelled along its vertices, and against them.
    speeds : float64 array, shape (E,)
        Expected speed in m/s, NaN where unknown.
    users : uint8 array, shape (E,)
        :class:`RoadUsers` of each line.
    ids : pyarrow string array of length E
        Id of each line in the source.
    names : pyarrow string array of length E
        Street names, null where there is none.
    directed : bool or None
        Whether the source has one line for each direction; None if the lines have to show it.
    repairs : tuple of Repair
        What the reader repaired.
    error : float or None
        Error in metres of lines that were learned from logs.
    """

    name: str
    coordinates: NDArray[np.float64]
    offsets: NDArray[np.int64]
    geographic: bool
    forward: NDArray[np.bool_]
    backward: NDArray[np.bool_]
    speeds: NDArray[np.float64]
    users: NDArray[np.uint8]
    ids: Any
    names: Any
    directed: bool | None = False
    repairs: tuple[Repair, ...] = field(default=())
    error: float | None = None

    def __len__(self) -> int:
        return len(self.offsets) - 1


def vertex_rows(offsets: NDArray[np.int64], chosen: NDArray[np.intp]) -> NDArray[np.int64]:
    """Return the indices of the vertices of chosen lines, line by line.

    Parameters
    ----------
    offsets : int64 array, shape (E + 1,)
        As in :class:`RoadLines`.
    chosen : int array
        Indices of lines.

    Examples
    --------
    >>> vertex_rows(np.array([0, 2, 5]), np.array([1, 0])).tolist()
    [2, 3, 4, 0, 1]
    """
    counts = np.diff(offsets)[chosen]
    shifts = offsets[:-1][chosen] - np.cumsum(counts) + counts  # from new to old indices
    rows: NDArray[np.int64] = np.arange(counts.sum()) + np.repeat(shifts, counts)
    return rows


def take_attributes(lines: RoadLines, chosen: NDArray[np.intp]) -> RoadLines:
    """Return lines with the attributes of the chosen ones; vertices and offsets stay."""
    return replace(
        lines,
        forward=lines.forward[chosen],
        backward=lines.backward[chosen],
        speeds=lines.speeds[chosen],
        users=lines.users[chosen],
        ids=lines.ids.take(pa.array(chosen)),
        names=lines.names.take(pa.array(chosen)),
    )


def take_lines(lines: RoadLines, chosen: NDArray[np.intp]) -> RoadLines:
    """Return the chosen lines, in the order of ``chosen``."""
    offsets = np.append(0, np.cumsum(np.diff(lines.offsets)[chosen]))
    return replace(
        take_attributes(lines, chosen),
        offsets=offsets,
        coordinates=lines.coordinates[vertex_rows(lines.offsets, chosen)],
    )


def within_globe(points: NDArray[np.float64]) -> bool:
    """Whether all coordinates that are finite can be longitudes and latitudes.

    Longitudes from 0 to 360 are in use besides those from -180 to 180.
    """
    finite = points[np.isfinite(points).all(axis=1)]
    return bool((np.abs(finite[:, 0]) <= 360).all() and (np.abs(finite[:, 1]) <= 90).all())
