"""External merge sort of rows by track and time: sorted runs on disk, merged when they are read.

A row is float64 numbers: time, others, kept columns. Rows are buffered up to a capacity, sorted,
and written as a run, which is one file.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gpszip.io.large.columns import ColumnEncoder, ColumnKind, EncodedBatch
from gpszip.io.logs.rows import Codes, Floats
from gpszip.io.storage.temporary import disk_errors_as_output_errors, read_numbers, write_numbers

__all__ = ["SortedRuns", "read_rows"]


class _Run(NamedTuple):
    """A file of sorted rows: its path, numbers in a row, and kinds of the kept columns."""

    path: Path
    width: int
    kinds: tuple[ColumnKind, ...]


class _RunRange(NamedTuple):
    """Rows of one track in a run, from its earliest to its latest time."""

    run: int
    first: int
    row_count: int
    first_time: float
    last_time: float


class SortedRuns:
    """Rows of many tracks, in files that are sorted by track and time.

    Parameters
    ----------
    folder : Path
        Folder for the files.
    max_rows : int
        Rows in memory at once.
    column_encoder : ColumnEncoder
        Encodes the kept columns, which are the last columns of a row.
    """

    def __init__(self, folder: Path, max_rows: int, column_encoder: ColumnEncoder) -> None:
        self.folder = folder
        self.max_rows = max_rows
        self.column_encoder = column_encoder
        self._buffer: list[tuple[Codes, Floats]] = []
        self._buffered_rows = 0
        self._buffer_shape: tuple[int, tuple[ColumnKind, ...]] = (0, ())  # width and kinds
        self._runs: list[_Run] = []
        self._ranges: defaultdict[int, list[_RunRange]] = defaultdict(list)

    def add(self, codes: Codes, numbers: Floats, columns: EncodedBatch) -> None:
        """Add rows.

        Parameters
        ----------
        codes : int32 array, shape (n,)
            Code of each row's track.
        numbers : float64 array, shape (n, w)
            Time and other numbers of each row.
        columns : EncodedBatch
            The kept columns.
        """
        # All rows of a run have columns of the same kinds, which are converted when they are read.
        rows = np.concatenate([numbers, columns.values], axis=1)
        shape = (rows.shape[1], columns.kinds)
        if shape != self._buffer_shape:
            self.flush()
        self._buffer_shape = shape
        self._buffer.append((codes, rows))
        self._buffered_rows += len(rows)
        if self._buffered_rows >= self.max_rows:
            self.flush()

    def flush(self) -> None:
        """Write the buffered rows as a sorted run."""
        # An empty run would only cost a file.
        if not self._buffered_rows:
            return

        # Sort by track, then by time.
        codes, rows = (np.concatenate(arrays) for arrays in zip(*self._buffer, strict=True))
        self._buffer, self._buffered_rows = [], 0
        order = np.lexsort((rows[:, 0], codes))
        codes, rows = codes[order], rows[order]

        # Write the rows; keep the kinds of their columns, which may change in later rows.
        run = _Run(self.folder / f"run-{len(self._runs)}", *self._buffer_shape)
        with disk_errors_as_output_errors(), run.path.open("wb") as file:
            write_numbers(rows, file)
        self._runs.append(run)

        # Note where the rows of each track are.
        starts = np.flatnonzero(np.diff(codes, prepend=-1)).tolist()
        for start, stop in pairwise([*starts, len(codes)]):
            first_time, last_time = float(rows[start, 0]), float(rows[stop - 1, 0])
            where = _RunRange(len(self._runs) - 1, start, stop - start, first_time, last_time)
            self._ranges[int(codes[start])].append(where)

    def blocks(self, code: int) -> Iterator[Floats]:
        """Yield the rows of a track in the order of time, in blocks that fit in memory.

        Rows at one time come in the order in which they were added.
        """
        # Runs that follow each other in time need no merging.
        ranges = self._ranges[code]
        if any(before.last_time > after.first_time for before, after in pairwise(ranges)):
            yield from self._merge(ranges)
            return
        for run_range in ranges:
            for row in range(0, run_range.row_count, self.max_rows):
                yield self._read(run_range, row, self.max_rows)

    def remove(self) -> None:
        """Remove the files."""
        for run in self._runs:
            run.path.unlink()

    def _merge(self, ranges: list[_RunRange]) -> Iterator[Floats]:
        """Merge runs by time.

        Of each run, a head is in memory. Rows before the earliest end of a head whose run goes on
        are complete: no later row of any run comes before them. So are rows at that very time up
        to the first run whose head ends with it. Rows of later runs at that time have to wait for
        the rest of this run, so that rows of one time keep the order in which they were added.
        """
        # Divide the rows in memory among the heads of all runs.
        head_rows = max(self.max_rows // len(ranges), 1)
        heads = [np.empty((0, self._runs[run_range.run].width)) for run_range in ranges]
        read_counts = [0] * len(ranges)
        while True:
            # Refill empty heads.
            for i, run_range in enumerate(ranges):
                if not len(heads[i]) and read_counts[i] < run_range.row_count:
                    heads[i] = self._read(run_range, read_counts[i], head_rows)
                    read_counts[i] += len(heads[i])

            # Find the time up to which rows are complete, and the first run that ends with it.
            open_ends = [
                (float(head[-1, 0]), i)
                for i, (head, run_range) in enumerate(zip(heads, ranges, strict=True))
                if len(head) and read_counts[i] < run_range.row_count
            ]
            limit, first_open = min(open_ends, default=(np.inf, len(heads)))

            # Yield these rows.
            cuts = [
                int(np.searchsorted(head[:, 0], limit, "right" if i <= first_open else "left"))
                for i, head in enumerate(heads)
            ]
            block = np.concatenate([head[:cut] for head, cut in zip(heads, cuts, strict=True)])
            heads = [head[cut:] for head, cut in zip(heads, cuts, strict=True)]
            if not len(block):
                return
            yield block[np.argsort(block[:, 0], kind="stable")]

    def _read(self, run_range: _RunRange, first: int, max_count: int) -> Floats:
        """Read up to ``max_count`` rows of a range, with columns converted to their final kinds."""
        run = self._runs[run_range.run]
        count = min(max_count, run_range.row_count - first)
        rows = read_rows(run.path, run_range.first + first, count, run.width)
        if not self.column_encoder.names:
            return rows
        sample_width = run.width - len(self.column_encoder.names)
        columns = self.column_encoder.convert(EncodedBatch(rows[:, sample_width:], run.kinds))
        return np.concatenate([rows[:, :sample_width], columns], axis=1)


def read_rows(path: Path, first: int, count: int, width: int) -> Floats:
    """Read rows of a file of float64 numbers.

    Parameters
    ----------
    path : Path
        The file.
    first : int
        Index of the first row.
    count : int
        Number of rows.
    width : int
        Numbers in a row.

    Returns
    -------
    float64 array, shape (count, width)
    """
    return read_numbers(path, np.float64, first * width, count * width).reshape(count, width)
