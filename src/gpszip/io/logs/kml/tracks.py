"""One `<gx:Track>`: its times, positions, angles and arrays of further values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pyarrow as pa

from gpszip.io.logs.kml.coordinates import split_angles
from gpszip.io.logs.kml.pairing import COORD, WHEN, Rows, pair_positions
from gpszip.io.logs.kml.rows import RowTable, TextRows

__all__ = ["Track"]

#: Notes a repair: what was done, the number of points, and whether they were dropped.
_NoteRepair = Callable[[str, int, bool], None]


class Track:
    """Collects an open track.

    Attributes
    ----------
    coords, angles : TextRows
        Texts of its positions and orientations.
    arrays : dict of str to TextRows
        Values of its positions, by name.
    """

    def __init__(self) -> None:
        self.coords, self.angles = TextRows(), TextRows()
        self.arrays: dict[str, TextRows] = {}
        self._whens = TextRows()
        self._order = bytearray()

    def add_when(self, text: str) -> None:
        """Add a time. A blank one counts, too: its position has no time."""
        self._whens.append(text)
        self._order.append(WHEN)

    def add_coord(self, text: str) -> None:
        """Add a position. A blank one counts, too: its time has no position."""
        self.coords.append(text)
        self._order.append(COORD)

    def begin_array(self, name: str) -> None:
        """Begin an array, or go on with it."""
        if name:
            self.arrays.setdefault(name, TextRows())

    def flush(self) -> None:
        """Store the texts so far in little memory."""
        for rows in (self.coords, self.angles, self._whens, *self.arrays.values()):
            rows.flush()

    def add_to(self, table: RowTable, note_repair: _NoteRepair) -> None:
        """Add the rows to a table, after the start of their segment.

        Parameters
        ----------
        table : RowTable
            The table.
        note_repair : callable
            Notes points without a partner and values that can't be assigned.
        """
        # A track without times is a shape, which has all positions.
        coords, whens = self.coords.to_column(), self._whens.to_column()
        taken: Rows | None = None
        if len(whens):
            when_rows, coord_rows = pair_positions(bytes(self._order))
            _note_unpaired(len(whens) - len(when_rows), len(coords) - len(coord_rows), note_repair)
            taken = coord_rows
            whens = _take(whens, when_rows)
        table.add_rows(_take(coords, taken))
        if len(whens):
            table.set_field("time", whens)

        # Angles and values belong to positions if there are as many.
        for name, column in self._columns(len(coords), note_repair).items():
            table.set_field(name, _take(column, taken))

    def _columns(self, count: int, note_repair: _NoteRepair) -> dict[str, Any]:
        """Return the columns of further values; those of another length are noted."""
        columns = dict[str, Any]()
        for name, rows in {**self.arrays, "angles": self.angles}.items():
            is_angles = rows is self.angles
            if len(rows) == count:
                column = rows.to_column()
                columns |= split_angles(column) if is_angles else {name: column}
            elif len(rows):
                what = f"values of {name} not read, as they are not as many as the positions"
                note_repair(what, len(rows), False)
            elif not is_angles:
                # An array that is not stored is known by its name.
                columns[name] = pa.chunked_array([pa.nulls(count, pa.string())])
        return columns


def _note_unpaired(whens: int, coords: int, note_repair: _NoteRepair) -> None:
    note_repair("times of tracks (when) without a position (coord) dropped", whens, True)
    note_repair("positions of tracks (coord) without a time (when) dropped", coords, True)


def _take(column: Any, rows: Rows | None) -> Any:
    """Return some rows of a chunked array; all for None."""
    if rows is None or len(rows) == len(column):
        return column
    return column.take(pa.array(rows))
