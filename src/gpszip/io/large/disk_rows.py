"""Rows of logs on disk, sorted by track and time in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gpszip.io.large.columns import ColumnEncoder, ColumnKind
from gpszip.io.large.plane_sample import PlaneSample
from gpszip.io.large.runs import SortedRuns
from gpszip.io.logs.raw import RawLog
from gpszip.io.logs.rows import Floats, LogRows, concatenate_rows

__all__ = ["DiskRows"]

#: Rows that a block of several tracks has at least, so that many short tracks cost few array
#: operations.
_MIN_BLOCK_ROWS = 10_000


class DiskRows:
    """A store of rows on disk; see :class:`gpszip.io.logs.rows.RowStore`.

    A stored row is its time, its number in messages, its coordinates and its kept columns. The
    times of a shape number its points.

    Parameters
    ----------
    folder : Path
        Folder for temporary files.
    max_rows : int
        Rows in memory at once.
    column_encoder : ColumnEncoder
        Encodes the kept columns.
    """

    def __init__(self, folder: Path, max_rows: int, column_encoder: ColumnEncoder) -> None:
        self.column_encoder = column_encoder
        self.plane_sample = PlaneSample()
        self._runs = SortedRuns(folder, max_rows, column_encoder)
        self._file_kinds: set[tuple[ColumnKind, ...]] = set()

    def add(self, rows: LogRows, raw: RawLog) -> None:
        """Add rows of the present file.

        Raises
        ------
        InputError
            If a column to keep is missing, or there are more distinct texts than fit in memory.
        """
        columns = self.column_encoder.encode(rows.attributes, len(rows), raw.name)
        # Kinds count only once the file is accepted, since a dropped file must not widen them.
        self._file_kinds.add(columns.kinds)
        numbers = np.column_stack([rows.times, rows.numbers, rows.coordinates])
        self._runs.add(rows.codes, numbers, columns)
        if raw.geographic:
            self.plane_sample.add(rows.coordinates)

    def end_file(self) -> None:
        """Accept the rows of the present file."""
        self.column_encoder.join(list(self._file_kinds))
        self._file_kinds = set()

    def drop_file(self) -> None:
        """Forget the rows of the present file; they are on disk, but nobody asks for them."""
        self._file_kinds = set()

    def sorted_rows(self, codes: Sequence[int]) -> Iterator[LogRows]:
        """Yield the rows of tracks in this order; then the temporary files are removed."""
        # Collect the rows of short tracks.
        self._runs.flush()
        collected: list[LogRows] = []
        count = 0
        for code in codes:
            for numbers in self._runs.blocks(code):
                collected.append(self._unpack(code, numbers))
                count += len(numbers)
                if count >= _MIN_BLOCK_ROWS:
                    yield concatenate_rows(collected)
                    collected, count = [], 0
        if collected:
            yield concatenate_rows(collected)
        self._runs.remove()

    def _unpack(self, code: int, numbers: Floats) -> LogRows:
        """Return stored rows of one track."""
        names = self.column_encoder.names
        first_column = numbers.shape[1] - len(names)
        return LogRows(
            codes=np.full(len(numbers), code, np.int32),
            times=numbers[:, 0],
            coordinates=numbers[:, 2:first_column],
            numbers=numbers[:, 1],
            attributes=dict(zip(names, numbers[:, first_column:].T, strict=True)),
        )
