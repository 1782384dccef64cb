"""Rows of logs that can be used, and the interface of what stores them until they are sorted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.raw import RawLog

__all__ = ["Codes", "Flags", "Floats", "LogRows", "RowStore", "begins_run", "concatenate_rows"]

Codes: TypeAlias = NDArray[np.int32]
Flags: TypeAlias = NDArray[np.bool_]
Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LogRows:
    """Rows of one or several tracks.

    Parameters
    ----------
    codes : int32 array, shape (n,)
        Code of each row's track. The rows of a track follow each other.
    times : float64 array, shape (n,)
        Seconds.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees.
    numbers : array, shape (n,)
        Number of each row in messages, such as the row of a table.
    attributes : mapping of str to array, shape (n,)
        Further columns.
    """

    codes: Codes
    times: Floats
    coordinates: Floats
    numbers: NDArray[Any]
    attributes: Mapping[str, NDArray[Any]]

    def __len__(self) -> int:
        return len(self.codes)

    def take(self, rows: NDArray[Any] | slice) -> LogRows:
        """Return some of the rows."""
        return LogRows(
            self.codes[rows],
            self.times[rows],
            self.coordinates[rows],
            self.numbers[rows],
            {name: values[rows] for name, values in self.attributes.items()},
        )


def concatenate_rows(blocks: Sequence[LogRows]) -> LogRows:
    """Concatenate rows that have the same attributes."""
    if len(blocks) == 1:
        return blocks[0]
    return LogRows(
        np.concatenate([block.codes for block in blocks]),
        np.concatenate([block.times for block in blocks]),
        np.concatenate([block.coordinates for block in blocks]),
        np.concatenate([block.numbers for block in blocks]),
        {
            name: np.concatenate([block.attributes[name] for block in blocks])
            for name in blocks[0].attributes
        },
    )


def begins_run(codes: NDArray[Any]) -> Flags:
    """Return whether each row has another code than the row before, as the first one does.

    Examples
    --------
    >>> begins_run(np.array([5, 5, 7])).tolist()
    [True, False, True]
    """
    begins = np.ones(len(codes), np.bool_)
    np.not_equal(codes[1:], codes[:-1], out=begins[1:])
    return begins


class RowStore(Protocol):
    """Rows of all files, in memory or on disk."""

    def add(self, rows: LogRows, raw: RawLog) -> None:
        """Add rows of the present file.

        Parameters
        ----------
        rows : LogRows
            Rows of one batch.
        raw : RawLog
            The batch that they come from.
        """

    def end_file(self) -> None:
        """Accept the rows of the present file."""

    def drop_file(self) -> None:
        """Forget the rows of the present file."""

    def sorted_rows(self, codes: Sequence[int]) -> Iterator[LogRows]:
        """Yield the rows of some tracks in blocks.

        The rows of a track come in the order of time, those at one time in the order of the file.
        A track may go on in the next block. Each row is yielded once.

        Parameters
        ----------
        codes : sequence of int
            The tracks. A store may yield them in another order.
        """
        ...
