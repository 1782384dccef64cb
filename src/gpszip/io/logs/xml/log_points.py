"""The points of a log in XML, as texts: between the parser and the interpretation."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.io.logs.xml.parser import MAX_LETTERS, RefusedError

__all__ = ["LogPoints", "TextColumn"]


@dataclass(frozen=True, eq=False)
class LogPoints:
    """Points of tracks and planned routes, in the order of the file.

    Parameters
    ----------
    lat, lon : pyarrow.ChunkedArray of string, shape (n,)
        Coordinates as texts; null if a point doesn't have them.
    fields : mapping of str to pyarrow.ChunkedArray of string, shape (n,)
        Texts of ``time`` and other fields that were asked for, by name in lower case; null if a
        point has no such field or a blank one.
    present : mapping of str to str
        All fields that the points have: names as spelled in the file, by name in lower case.
    names : tuple of str or None, length p
        Name of each track or route that has points.
    plans : bool array, shape (p,)
        Whether each of these is a planned route, whose times don't count.
    parents : int array, shape (s,)
        Index of the track or route that each segment belongs to. Only segments with points count.
    starts : int array, shape (s,)
        Index of the first point of each segment.
    continues : bool
        Whether the first segment goes on with the last one of the batch before.
    """

    lat: pa.ChunkedArray
    lon: pa.ChunkedArray
    fields: Mapping[str, pa.ChunkedArray]
    present: Mapping[str, str]
    names: tuple[str | None, ...]
    plans: NDArray[np.bool_]
    parents: NDArray[np.intp]
    starts: NDArray[np.intp]
    continues: bool = False

    def __len__(self) -> int:
        return len(self.lat)

    @property
    def segment_lengths(self) -> NDArray[np.intp]:
        """Number of points of each segment."""
        return np.diff(self.starts, append=len(self))

    @property
    def parent_of_points(self) -> NDArray[np.intp]:
        """Index of the track or route of each point."""
        return np.repeat(self.parents, self.segment_lengths)

    def field(self, name: str) -> Any:
        """Return the texts of a field; null for all points if they don't have it."""
        if name in self.fields:
            return self.fields[name]
        return pa.chunked_array([pa.nulls(len(self), pa.string())])


class TextColumn:
    """Texts of some points. Arrow's strings take a fifth of the memory of Python's."""

    __slots__ = ("_chunks", "last_row", "rows", "texts")

    def __init__(self) -> None:
        self.texts: list[str | None] = []
        self.rows = array("q")
        self.last_row = -1
        self._chunks: list[Any] = []

    def add(self, row: int, text: str) -> None:
        """Add the text of a row; rows increase."""
        self.texts.append(text)
        self.rows.append(row)
        self.last_row = row

    def flush(self) -> None:
        """Store the texts so far in little memory.

        Raises
        ------
        RefusedError
            If a text is too long.
        """
        chunk = pa.array(self.texts, pa.string())
        self.texts.clear()
        if (pc.max(pc.utf8_length(chunk)).as_py() or 0) > MAX_LETTERS:
            raise RefusedError(
                f"a text of more than {MAX_LETTERS} letters in a point", remedy="shorten it"
            )
        self._chunks.append(chunk)

    def to_column(self, count: int) -> Any:
        """Return one text for each of ``count`` points; null for those without."""
        column = pa.chunked_array(self._chunks, pa.string())
        if len(column) == count:
            return column

        # Place the texts at the rows of their points. The mask makes the other rows null.
        index = np.full(count, -1, dtype=np.int64)
        index[np.frombuffer(self.rows, dtype=np.int64)] = np.arange(len(column))
        return column.take(pa.array(index, mask=index < 0))
