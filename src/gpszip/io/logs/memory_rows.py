"""Rows of logs in memory, sorted file by file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.raw import RawLog
from gpszip.io.logs.rows import LogRows, begins_run, concatenate_rows

__all__ = ["MemoryRows"]


class MemoryRows:
    """A store of rows in memory; see :class:`gpszip.io.logs.rows.RowStore`."""

    def __init__(self) -> None:
        self._files: list[LogRows] = []
        self._batches: list[LogRows] = []

    def add(self, rows: LogRows, raw: RawLog) -> None:  # noqa: ARG002 (of the protocol)
        """Add rows of the present file."""
        self._batches.append(rows)

    def end_file(self) -> None:
        """Accept the rows of the present file."""
        self._files.append(concatenate_rows(self._batches))
        self._batches = []

    def drop_file(self) -> None:
        """Forget the rows of the present file."""
        self._batches = []

    def sorted_rows(self, codes: Sequence[int]) -> Iterator[LogRows]:
        """Yield the rows of each file, sorted by track and time; forget each file with that."""
        # The last entry stands for all codes above those that are wanted.
        is_wanted = np.zeros(max(codes) + 2, np.bool_)
        is_wanted[list(codes)] = True
        # Files are popped, the first one first, so that rows that were yielded aren't kept here.
        self._files.reverse()
        while self._files:
            rows = self._files.pop()

            # Tracks that were left out have rows, too.
            wanted = is_wanted[np.minimum(rows.codes, len(is_wanted) - 1)]
            if not wanted.all():
                rows = rows.take(wanted)
            order = _sorted_order(rows)
            yield rows if order is None else rows.take(order)


def _sorted_order(rows: LogRows) -> NDArray[np.intp] | None:
    """Return the order of rows by track and time; None if they have it already."""
    later, earlier = rows.times[1:], rows.times[:-1]
    is_disordered = (later < earlier) & ~begins_run(rows.codes)[1:]
    if not (rows.codes[1:] < rows.codes[:-1]).any() and not is_disordered.any():
        return None
    # The last key comes first: by track, then by time, and else in the order of the file.
    return np.lexsort((rows.times, rows.codes))
