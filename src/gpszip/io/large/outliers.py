"""Find the outliers of tracks that don't fit in memory.

The result is that of :func:`gpszip.geo.outliers.find_outliers`, found by passes over a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.geo.outliers import (
    SPEED_FACTOR,
    SPEED_QUANTILE,
    find_outliers,
    mark_outliers,
    min_adjacent_speeds,
)
from gpszip.geo.planes import to_plane
from gpszip.io.large.runs import read_rows
from gpszip.io.logs.rows import Floats
from gpszip.io.storage.temporary import write_numbers
from gpszip.model import Plane

__all__ = ["OutlierSearch"]

#: Samples on both sides of a block that take part in the decision about its samples. A run of
#: outliers has at most four samples, and a decision looks one sample past its ends.
_MARGIN = 40

#: Bits of a number that are found in one pass of the radix selection: 65,536 counters.
_DIGIT_BITS = 16

_Blocks = Callable[[], Iterator[Floats]]


class OutlierSearch:
    """Finds outliers of tracks in a file.

    Parameters
    ----------
    path : Path
        A file of rows: time, coordinates, kept columns.
    width : int
        Numbers in a row.
    dimension : int
        Number of coordinates.
    max_rows : int
        Rows in memory at once.
    plane : Plane, optional
        Plane on which speeds are measured, for coordinates in degrees.
    """

    def __init__(
        self, path: Path, width: int, dimension: int, max_rows: int, plane: Plane | None
    ) -> None:
        self.path = path
        self.width = width
        self.dimension = dimension
        self.max_rows = max_rows
        self.plane = plane

    def find(self, first: int, count: int) -> NDArray[np.int64]:
        """Return the indices of a track's outliers among its rows, ascending.

        1. The shortest interval that counts is half the median interval.
        2. Write the calm speeds: the least speed at each sample (``min_adjacent_speeds``).
        3. The speed limit is a multiple of a quantile of the calm speeds that are not 0.
        4. Mark the outliers block by block, each with a margin of its neighbours.

        Parameters
        ----------
        first : int
            Index of the track's first row in the file.
        count : int
            Number of its rows.
        """
        # A track that fits in memory needs no blocks.
        if count <= self.max_rows:
            return np.flatnonzero(find_outliers(*self._read_samples(first, 0, count)))

        # 1. Shortest interval.
        def intervals() -> Iterator[Floats]:
            return (np.diff(times) for times, _ in self._overlapping_blocks(first, count, 1))

        # Shorter intervals count as half the median, so that no tiny interval makes a huge speed.
        min_interval = 0.5 * _quantile(intervals, 0.5)

        # 2. Calm speeds.
        speeds_path = self.path.with_name("calm-speeds")
        with speeds_path.open("wb") as file:
            for times, positions in self._overlapping_blocks(first, count, 2):
                speeds = min_adjacent_speeds(times, positions, min_interval)
                write_numbers(speeds[speeds > 0], file)
        size = speeds_path.stat().st_size // 8

        # 3. Speed limit.
        def calm_speeds() -> Iterator[Floats]:
            for row in range(0, size, self.max_rows):
                yield read_rows(speeds_path, row, min(self.max_rows, size - row), 1)[:, 0]

        # Scale the quantile of the calm speeds to the limit in m/s.
        limit = SPEED_FACTOR * _quantile(calm_speeds, SPEED_QUANTILE)
        speeds_path.unlink()

        # 4. Outliers of each block.
        outliers = []
        for start in range(0, count, self.max_rows):
            stop = min(start + self.max_rows, count)
            before = max(start - _MARGIN, 0)
            samples = self._read_samples(first, before, min(stop + _MARGIN, count))
            marked = np.flatnonzero(mark_outliers(*samples, min_interval, limit)) + before
            outliers.append(_within(marked, start, stop))
        return np.concatenate(outliers)

    def remaining_rows(
        self, first: int, count: int, outliers: NDArray[np.int64]
    ) -> Iterator[Floats]:
        """Yield the rows of a track without its outliers, in blocks.

        Parameters
        ----------
        first : int
            Index of the track's first row in the file.
        count : int
            Number of its rows.
        outliers : int array
            Indices among these rows, ascending.
        """
        for start in range(0, count, self.max_rows):
            stop = min(start + self.max_rows, count)
            rows = read_rows(self.path, first + start, stop - start, self.width)
            yield np.delete(rows, _within(outliers, start, stop) - start, axis=0)

    def _read_samples(self, first: int, start: int, stop: int) -> tuple[Floats, Floats]:
        """Return times and positions in metres of rows ``start`` to ``stop - 1`` of a track."""
        rows = read_rows(self.path, first + start, stop - start, self.width)
        positions = rows[:, 1 : 1 + self.dimension]
        if self.plane is not None:
            positions = to_plane(positions[:, 0], positions[:, 1], self.plane)
        return rows[:, 0], positions

    def _overlapping_blocks(
        self, first: int, count: int, shared: int
    ) -> Iterator[tuple[Floats, Floats]]:
        """Yield a track in blocks that share this number of samples with the next one."""
        # A block reads on into the next one: intervals need one more sample, speeds at samples two.
        for start in range(0, count - shared, self.max_rows):
            yield self._read_samples(first, start, min(start + self.max_rows + shared, count))


def _within(indices: NDArray[np.int64], start: int, stop: int) -> NDArray[np.int64]:
    return indices[(indices >= start) & (indices < stop)]


def _quantile(blocks: _Blocks, share: float) -> float:
    """Quantile of numbers that are not negative; infinite if there are none.

    The rounding is that of :func:`numpy.quantile`: linear interpolation from the nearer neighbour.
    """
    count = sum(map(len, blocks()))
    if not count:
        return math.inf
    rank = share * (count - 1)
    below, above = (_find_by_rank(blocks, r) for r in (math.floor(rank), math.ceil(rank)))
    fraction = rank - math.floor(rank)
    if fraction >= 0.5:
        return float(above - (above - below) * (1 - fraction))
    return float(below + (above - below) * fraction)


def _find_by_rank(blocks: _Blocks, rank: int) -> float:
    """Find the number that has ``rank`` smaller ones, by radix selection from the highest digit.

    The bits of numbers that are not negative, read as integers, have the order of the numbers.
    """
    # Extend the prefix digit by digit; memory holds only the counts of one digit.
    prefix = 0  # the digits found so far
    for shift in range(64 - _DIGIT_BITS, -1, -_DIGIT_BITS):
        # Count the next digit of all numbers that start with the digits found.
        counts = np.zeros(1 << _DIGIT_BITS, np.int64)
        for numbers in blocks():
            bits = np.ascontiguousarray(numbers).view(np.uint64)
            if shift + _DIGIT_BITS < 64:
                bits = bits[bits >> np.uint64(shift + _DIGIT_BITS) == prefix]
            digits = bits >> np.uint64(shift) & np.uint64((1 << _DIGIT_BITS) - 1)
            counts += np.bincount(digits.astype(np.int64), minlength=1 << _DIGIT_BITS)

        # The rank falls on one digit.
        cumulated = np.cumsum(counts)
        digit = int(np.searchsorted(cumulated, rank, side="right"))
        rank -= int(cumulated[digit - 1]) if digit else 0
        prefix = prefix << _DIGIT_BITS | digit
    return float(np.array([prefix], np.uint64).view(np.float64)[0])
