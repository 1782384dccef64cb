"""Spikes of tracks that don't fit in memory: the same that are found at once, by passes over a file."""

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
from gpszip.io.large.plane_sample import PlaneSample
from gpszip.io.large.sort import read_rows
from gpszip.io.storage.temporary import disk_errors_as_output_errors, write_numbers
from gpszip.model import Plane
from gpszip.model.read_result import Repair

__all__ = ["FilteredTracks"]

#: Samples around a piece that decide on what is in it.
_MARGIN = 40

#: Bits of a number by which it is looked for at a time.
_DIGIT_BITS = 16

Floats = NDArray[np.float64]
_Tracks = Iterator[tuple[str, Iterator[Floats]]]
_Blocks = Callable[[], Iterator[Floats]]


class FilteredTracks:
    """Tracks without their spikes, whose rows are written to a file once and read from there.

    Parameters
    ----------
    tracks : iterator
        Each track with its rows in blocks: time, coordinates, further columns.
    path : Path
        The file, which is made.
    width, dimension : int
        Numbers in a row, and of coordinates.
    rows : int
        How many may be in memory at once.
    plane : Plane, optional
        On which speeds are measured, of coordinates in degrees.
    """

    def __init__(
        self,
        tracks: _Tracks,
        path: Path,
        width: int,
        dimension: int,
        rows: int,
        plane: Plane | None,
    ) -> None:
        self.path, self.width, self.dimension, self.rows, self.plane = (
            path,
            width,
            dimension,
            rows,
            plane,
        )
        self.repairs: list[Repair] = []
        self.plane_sample = PlaneSample()
        self._tracks: list[tuple[str, int, int]] = []
        self._outliers: list[NDArray[np.int64]] = []
        first = 0
        with disk_errors_as_output_errors(), path.open("wb") as file:
            for name, blocks in tracks:
                count = 0
                for block in blocks:
                    write_numbers(block, file)
                    count += len(block)
                file.flush()
                self._tracks.append((name, first, count))
                self._outliers.append(self._find_outliers(first, count))
                if len(self._outliers[-1]):
                    self.repairs.append(
                        Repair("spikes dropped", len(self._outliers[-1]), f"track {name!r}")
                    )
                first += count
        if plane is not None:
            for _, blocks in self.tracks():
                for block in blocks:
                    self.plane_sample.add(block[:, 1:3])

    def tracks(self) -> _Tracks:
        """Yield each track with what is left of its rows."""
        for (name, first, count), outliers in zip(self._tracks, self._outliers, strict=True):
            yield name, self._remaining_rows(first, count, outliers)

    def _remaining_rows(
        self, first: int, count: int, outliers: NDArray[np.int64]
    ) -> Iterator[Floats]:
        for a in range(0, count, self.rows):
            b = min(a + self.rows, count)
            here = outliers[(outliers >= a) & (outliers < b)]
            yield np.delete(read_rows(self.path, first + a, b - a, self.width), here - a, axis=0)

    def _read_samples(self, first: int, a: int, b: int) -> tuple[Floats, Floats]:
        rows = read_rows(self.path, first + a, b - a, self.width)
        positions = rows[:, 1 : 1 + self.dimension]
        return rows[:, 0], positions if self.plane is None else to_plane(
            positions[:, 0], positions[:, 1], self.plane
        )

    def _find_outliers(self, first: int, count: int) -> NDArray[np.int64]:
        """Rows of a track that are spikes."""
        if count <= self.rows:
            return np.flatnonzero(find_outliers(*self._read_samples(first, 0, count)))
        shortest = 0.5 * _quantile(
            lambda: (np.diff(times) for times, _ in self._overlapping_blocks(first, count, 1)), 0.5
        )
        calm = self.path.with_name("calm-speeds")
        with calm.open("wb") as file:
            for times, positions in self._overlapping_blocks(first, count, 2):
                speeds = min_adjacent_speeds(times, positions, shortest)
                write_numbers(speeds[speeds > 0], file)
        size = calm.stat().st_size // 8

        def speeds_again() -> Iterator[Floats]:
            return (
                read_rows(calm, a, min(self.rows, size - a), 1)[:, 0]
                for a in range(0, size, self.rows)
            )

        limit = SPEED_FACTOR * _quantile(speeds_again, SPEED_QUANTILE)
        calm.unlink()
        found = []
        for a in range(0, count, self.rows):
            low, b = max(a - _MARGIN, 0), min(a + self.rows, count)
            outliers = (
                np.flatnonzero(
                    mark_outliers(
                        *self._read_samples(first, low, min(b + _MARGIN, count)), shortest, limit
                    )
                )
                + low
            )
            found.append(outliers[(outliers >= a) & (outliers < b)])
        return np.concatenate(found)

    def _overlapping_blocks(
        self, first: int, count: int, shared: int
    ) -> Iterator[tuple[Floats, Floats]]:
        """Yield a track in pieces of which each has so many samples of the next."""
        for a in range(0, count - shared, self.rows):
            yield self._read_samples(first, a, min(a + self.rows + shared, count))


def _quantile(blocks: _Blocks, share: float) -> float:
    """Quantile of numbers that are not negative, as NumPy finds it; infinite if there are none."""
    count = sum(map(len, blocks()))
    if not count:
        return math.inf
    place = share * (count - 1)
    below, above = (_find_by_rank(blocks, rank) for rank in (math.floor(place), math.ceil(place)))
    part = place - math.floor(place)
    return float(
        above - (above - below) * (1 - part) if part >= 0.5 else below + (above - below) * part
    )


def _find_by_rank(blocks: _Blocks, rank: int) -> float:
    """Find the number that so many are smaller than; as bits, numbers that are not negative have the order of whole numbers."""
    known = 0
    for shift in range(64 - _DIGIT_BITS, -1, -_DIGIT_BITS):
        counts = np.zeros(1 << _DIGIT_BITS, np.int64)
        for numbers in blocks():
            bits = np.ascontiguousarray(numbers).view(np.uint64)
            same = (
                bits[bits >> np.uint64(shift + _DIGIT_BITS) == known]
                if shift + _DIGIT_BITS < 64
                else bits
            )
            counts += np.bincount(
                (same >> np.uint64(shift) & np.uint64((1 << _DIGIT_BITS) - 1)).astype(np.int64),
                minlength=1 << _DIGIT_BITS,
            )
        reached = np.cumsum(counts)
        digit = int(np.searchsorted(reached, rank, side="right"))
        rank -= int(reached[digit - 1]) if digit else 0
        known = known << _DIGIT_BITS | digit
    return float(np.array([known], np.uint64).view(np.float64)[0])
