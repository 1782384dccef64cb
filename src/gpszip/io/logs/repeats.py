"""Drop rows whose timestamp an earlier row of the same track has, and count what is lost by that.

Rows come in blocks that are sorted by track and time. Only the last row of a block is remembered,
so that logs of any size are counted alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.rows import Codes, Flags, Floats, LogRows, begins_run, concatenate_rows

__all__ = ["RepeatedRows", "RepeatedTimes", "drop_repeated_rows", "find_repeated_times"]


class RepeatedTimes(NamedTuple):
    """Rows, sorted by track and time, whose timestamp an earlier row of the same track has.

    Parameters
    ----------
    same_position : bool array, shape (n,)
        Rows at the same position as the first row with this timestamp.
    other_position : bool array, shape (n,)
        Rows at another position.
    """

    same_position: Flags
    other_position: Flags

    @property
    def first(self) -> Flags:
        """Rows that are the first of their track with their timestamp."""
        return ~(self.same_position | self.other_position)


def find_repeated_times(codes: Codes, times: Floats, coordinates: Floats) -> RepeatedTimes:
    """Find rows whose timestamp an earlier row of the same track has.

    Parameters
    ----------
    codes : int array, shape (n,)
        Track of each row; the rows of a track follow each other.
    times : float64 array, shape (n,)
        Not decreasing within a track.
    coordinates : float64 array, shape (n, d)
        Positions.

    Examples
    --------
    >>> import numpy as np
    >>> codes, times = np.array([0, 0, 0, 1]), np.array([1.0, 1.0, 2.0, 2.0])
    >>> find_repeated_times(codes, times, np.zeros((4, 2))).first.tolist()
    [True, False, True, True]
    """
    # Most logs repeat no time.
    first = np.ones(len(times), np.bool_)
    first[1:] = (times[1:] != times[:-1]) | (codes[1:] != codes[:-1])
    if first.all():
        return RepeatedTimes(~first, ~first)

    # Compare with the first row with the same timestamp.
    # The running maximum carries the index of each first row to the rows that repeat its time.
    first_row = np.maximum.accumulate(np.where(first, np.arange(len(times)), 0))
    same = np.asarray((coordinates == coordinates[first_row]).all(axis=1))
    return RepeatedTimes(~first & same, ~first & ~same)


@dataclass(eq=False)
class RepeatedRows:
    """What was dropped because of its time, by track.

    Parameters
    ----------
    at_same, at_other : int64 array, shape (k,)
        For each code, the rows at a repeated time and the same position, and at other positions.
    first_same, first_other : float64 array, shape (k,)
        Number of the first of these rows in messages; infinite if there is none.
    shared : int64 array, shape (k,)
        Most rows of a track at one time, of which those at the position of the first one count
        once; 0 if no time has rows at two positions.
    in_two_files : int64 array, shape (k,)
        Rows at the time at which an earlier file's rows of the same track end: at most 1.
    """

    at_same: NDArray[np.int64]
    at_other: NDArray[np.int64]
    first_same: Floats
    first_other: Floats
    shared: NDArray[np.int64]
    in_two_files: NDArray[np.int64]

    @classmethod
    def empty(cls, codes: int) -> RepeatedRows:
        """Return the record of codes from 0 to ``codes - 1`` before any row."""
        counts = [np.zeros(codes, np.int64) for _ in range(4)]
        numbers = [np.full(codes, np.inf) for _ in range(2)]
        return cls(counts[0], counts[1], numbers[0], numbers[1], counts[2], counts[3])


def drop_repeated_rows(
    blocks: Iterable[LogRows], ends_before: Floats, repeated: RepeatedRows
) -> Iterator[LogRows]:
    """Yield blocks without the rows whose time an earlier row of the same track has.

    Parameters
    ----------
    blocks : iterable of LogRows
        Sorted by track and time.
    ends_before : float64 array, shape (k,)
        For each code, the time at which the rows of the same track in an earlier file end; NaN if
        no earlier file has the track.
    repeated : RepeatedRows
        Counts what is dropped.
    """
    last: LogRows | None = None  # the row kept last
    sharing = 0  # rows at other positions that share its time
    for block in blocks:
        # Compare with the last block, too, if it ends with the same track.
        if not len(block):
            continue
        goes_on = last is not None and last.codes[0] == block.codes[0]
        rows = block
        if last is not None and goes_on:
            # The row kept last goes in front of the block, without attributes: none are compared.
            rows = concatenate_rows([last, replace(block, attributes={})])
        context = len(rows) - len(block)
        times = find_repeated_times(rows.codes, rows.times, rows.coordinates)
        first = times.first
        _count(repeated.at_same, repeated.first_same, rows, times.same_position)
        _count(repeated.at_other, repeated.first_other, rows, times.other_position)

        # Count the rows at each time.
        sharing = sharing if goes_on else 0
        if times.other_position.any() or sharing:
            # Each first row begins a group of rows at one time. The first group may have begun in
            # an earlier block.
            shared = np.bincount(np.cumsum(first) - 1, weights=times.other_position)
            shared[0] += sharing
            positions = np.where(shared > 0, shared + 1, 0).astype(np.int64)
            np.maximum.at(repeated.shared, rows.codes[first], positions)
            sharing = int(shared[-1])

        # The rows of the next file may start at the time at which those of this one end.
        starts = begins_run(rows.codes)
        starts[:context] = False
        starts &= rows.times == ends_before[rows.codes]
        np.add.at(repeated.in_two_files, rows.codes[starts], 1)

        # Remember the last row that is the first at its time, and yield those of this block.
        last = replace(rows, attributes={}).take(np.flatnonzero(first)[-1:])
        kept = (first & ~starts)[context:]
        if kept.any():
            yield block if kept.all() else block.take(kept)


def _count(counts: NDArray[np.int64], numbers: Floats, rows: LogRows, dropped: Flags) -> None:
    """Count dropped rows by track, and note the first one."""
    if dropped.any():
        # Plain `counts[codes] += 1` would count a track once, however many of its rows are dropped.
        np.add.at(counts, rows.codes[dropped], 1)
        np.minimum.at(numbers, rows.codes[dropped], rows.numbers[dropped])
