"""Rows of texts that grow while a file is parsed, in the memory of Arrow's strings."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gpszip.io.logs.kml.coordinates import split_coordinates
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.logs.xml.parser import MAX_LETTERS, RefusedError

__all__ = ["RowTable", "TextRows", "join_points"]

#: Names of the third number of positions: a height above the sea, or above the ground.
_HEIGHT, _HEIGHT_ABOVE_GROUND = "alt", "height_above_ground"


#: A year, and a year with a month, and how they become the first day.
_SHORT_DATES = (
    (r"^\s*(\d{4})\s*$", r"\1-01-01"),
    (r"^\s*(\d{4}-\d{2})\s*$", r"\1-01"),
)


class TextRows:
    """A column of texts, with null for rows without one."""

    __slots__ = ("_chunks", "_pending", "_stored")

    def __init__(self) -> None:
        self._pending: list[str | None] = []
        self._chunks: list[Any] = []
        self._stored = 0  # rows in chunks

    def __len__(self) -> int:
        return self._stored + len(self._pending)

    def append(self, text: str) -> None:
        """Add a row."""
        self._pending.append(text)

    def extend(self, texts: list[str]) -> None:
        """Add rows."""
        self._pending.extend(texts)

    def extend_column(self, column: Any) -> None:
        """Add the rows of a chunked array."""
        self.flush()
        self._chunks.extend(column.chunks)
        self._stored += len(column)

    def pad(self, count: int) -> None:
        """Add rows without a text until there are ``count``."""
        if count > len(self):
            self.extend_column(pa.chunked_array([pa.nulls(count - len(self), pa.string())]))

    def flush(self) -> None:
        """Store the rows so far in little memory.

        Raises
        ------
        RefusedError
            If a text is too long.
        """
        if not self._pending:
            return
        chunk = pa.array(self._pending, pa.string())
        self._pending = []
        if (pc.max(pc.utf8_length(chunk)).as_py() or 0) > MAX_LETTERS:
            raise RefusedError(f"a text of more than {MAX_LETTERS} letters", remedy="shorten it")
        self._chunks.append(chunk)
        self._stored += len(chunk)

    def to_column(self) -> Any:
        """Return all rows as a chunked array."""
        self.flush()
        return pa.chunked_array(self._chunks, pa.string())


class RowTable:
    """Points of several tracks: their coordinates as texts, and the fields that were asked for.

    Parameters
    ----------
    wanted : collection of str
        Fields to store, by name in lower case.

    Attributes
    ----------
    names : list of str or None
        Names of tracks and lines.
    is_timed : bool
        Whether any row has a time.
    """

    def __init__(self, wanted: Collection[str]) -> None:
        self._wanted = tuple(wanted)
        self._present: dict[str, str] = {}
        self._heights: set[str] = set()  # names of heights that some row has
        self.names: list[str | None] = []
        self.is_timed = False
        self._begin_rows()

    def _begin_rows(self) -> None:
        self._coordinates = TextRows()
        self._fields = {name: TextRows() for name in self._wanted}
        self._parents: list[int] = []
        self._starts: list[int] = []
        self._above_ground: list[bool] = []

    def __len__(self) -> int:
        return len(self._coordinates)

    # Tracks and their segments

    def begin_track(self, name: str | None) -> int:
        """Return the index of a new track."""
        self.names.append(name)
        return len(self.names) - 1

    def begin_segment(self, track: int, *, above_ground: bool) -> None:
        """Begin a segment of a track; call it before its first row.

        Parameters
        ----------
        track : int
            Index of the track.
        above_ground : bool
            Whether heights count from the ground.
        """
        # A segment without rows is replaced by the next one.
        if self._starts and self._starts[-1] == len(self):
            del self._starts[-1], self._parents[-1], self._above_ground[-1]
        self._parents.append(track)
        self._starts.append(len(self))
        self._above_ground.append(above_ground)

    def continues(self, track: int, *, above_ground: bool) -> bool:
        """Whether a row would belong to the segment that was begun last."""
        if not self._parents:
            return False
        return self._parents[-1] == track and self._above_ground[-1] == above_ground

    # Rows

    def add_row(self, coordinates: str) -> None:
        """Add a row."""
        self._coordinates.append(coordinates)

    def add_rows(self, coordinates: Any) -> None:
        """Add the rows of a chunked array of coordinates."""
        self._coordinates.extend_column(coordinates)

    def set_field(self, name: str, column: Any) -> None:
        """Set a field of the last rows, unless they have it; null where it is not known.

        Parameters
        ----------
        name : str
            Name as spelled in the file.
        column : pyarrow.ChunkedArray of string
            Texts.
        """
        rows = self._begin_field(name, len(self) - len(column))
        if rows is not None:
            rows.extend_column(column)

    def set_text(self, name: str, text: str, count: int = 1) -> None:
        """Set a field of each of the last ``count`` rows to one text, unless they have it."""
        rows = self._begin_field(name, len(self) - count)
        if rows is not None:
            rows.extend([text] * count)

    def _begin_field(self, name: str, first: int) -> TextRows | None:
        """Return the column of a field if it is wanted and has no row from ``first`` on."""
        key = name.lower()
        if key == "time":
            self.is_timed = True
        else:
            self._present.setdefault(key, name)
        column = self._fields.get(key)
        if column is None or len(column) > first:
            return None
        column.pad(first)
        return column

    # Storage

    def flush(self) -> None:
        """Store the rows so far in little memory."""
        self._coordinates.flush()
        for column in self._fields.values():
            column.flush()

    def finish(self) -> LogPoints:
        """Return all rows.

        The third numbers of positions are the field ``alt``, or ``height_above_ground``.
        """
        # Split the coordinates, and tell heights above the sea from those above the ground.
        count = len(self)
        starts = np.array(self._starts, np.intp)
        lat, lon, alt = split_coordinates(self._coordinates.to_column())
        lengths = np.diff(starts, append=count)
        is_above_ground = pa.array(np.repeat(np.array(self._above_ground, np.bool_), lengths))
        heights = {
            _HEIGHT: pc.if_else(is_above_ground, None, alt),
            _HEIGHT_ABOVE_GROUND: pc.if_else(is_above_ground, alt, None),
        }

        # A field of the same name hides a height. Fields that no row has are none.
        fields, present = self._finish_fields(count), dict(self._present)
        for name, column in heights.items():
            if column.null_count < count:
                self._heights.add(name)
            if name in self._heights and name not in present:
                fields[name] = column
                present[name] = name
        return LogPoints(
            lat=lat,
            lon=lon,
            fields=fields,
            present=present,
            names=tuple(self.names),
            plans=np.zeros(len(self.names), np.bool_),
            parents=np.array(self._parents, np.intp),
            starts=starts,
        )

    def end_batch(self) -> LogPoints:
        """Return the rows so far, and go on without them; the tracks keep their numbers."""
        points = self.finish()
        self._begin_rows()
        return points

    def _finish_fields(self, count: int) -> dict[str, Any]:
        fields = {}
        for name, column in self._fields.items():
            if name in self._present or (name == "time" and self.is_timed):
                column.pad(count)
                # Blank texts are none.
                texts = column.to_column()
                is_blank = pc.equal(pc.utf8_trim_whitespace(texts), "")
                texts = pc.if_else(is_blank, None, texts)
                fields[name] = _complete_dates(texts) if name == "time" else texts
        return fields


def _complete_dates(texts: Any) -> Any:
    """Return the first day of years and months; 2024 is no number of seconds in KML."""
    for form, first_day in _SHORT_DATES:
        texts = pc.replace_substring_regex(texts, form, first_day)
    return texts


def join_points(first: LogPoints, second: LogPoints) -> LogPoints:
    """Return the points of both, those of the first one first."""
    # A field that only one of them has is null in the other.
    names = [*first.fields, *(name for name in second.fields if name not in first.fields)]
    fields = {
        name: _join(*(part.fields.get(name, _nulls(len(part))) for part in (first, second)))
        for name in names
    }
    present: Mapping[str, str] = {**second.present, **first.present}

    # Tracks and rows of the second one are numbered after those of the first.
    return LogPoints(
        lat=_join(first.lat, second.lat),
        lon=_join(first.lon, second.lon),
        fields=fields,
        present=present,
        names=(*first.names, *second.names),
        plans=np.append(first.plans, second.plans),
        parents=np.append(first.parents, second.parents + len(first.names)),
        starts=np.append(first.starts, second.starts + len(first)),
    )


def _nulls(count: int) -> Any:
    return pa.chunked_array([pa.nulls(count, pa.string())])


def _join(first: Any, second: Any) -> Any:
    return pa.chunked_array([*first.chunks, *second.chunks], pa.string())
