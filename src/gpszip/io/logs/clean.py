"""Find the rows of a batch that can be used, and record the others as repairs.

Rows without a time or a position are dropped, as are positions off the globe, and with ``clean``
those at 0,0 that were hardly measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.globe import GlobeCheck, find_zero_positions, format_off_globe
from gpszip.io.logs.raw import RawLog, UnreadableCell
from gpszip.io.logs.rows import LogRows
from gpszip.io.values.finite import finite_rows
from gpszip.model.read_result import Repair

__all__ = [
    "add_repair",
    "find_usable_rows",
    "nothing_usable_error",
    "number_shape_points",
    "take_rows",
]

#: Characters of a value that can't be read that messages show.
_MAX_SHOWN_LETTERS = 40

Rows = NDArray[np.intp]


def number_shape_points(raw: RawLog, first: int) -> RawLog:
    """Number the points of tracks without times, so that they stay in the order of travel.

    Parameters
    ----------
    raw : RawLog
        A batch of rows.
    first : int
        Number of rows in the batches before.
    """
    if not raw.untimed:
        return raw
    order = np.arange(first, first + len(raw.times), dtype=np.float64)
    codes = np.zeros(len(order), np.int64) if raw.codes is None else raw.codes
    in_shape = np.isin(codes, list(raw.untimed))
    return replace(raw, times=np.where(in_shape, order, raw.times))


def find_usable_rows(raw: RawLog, globe: GlobeCheck, repairs: list[Repair], *, clean: bool) -> Rows:
    """Return the rows with a time and a position, in the order of the batch.

    Parameters
    ----------
    raw : RawLog
        A batch of rows.
    globe : GlobeCheck
        Counts the positions off the globe. It decides at the end of the file whether they may be
        left out.
    repairs : list of Repair
        Repairs of the file so far; those of this batch are added.
    clean : bool
        Drop positions at 0,0 that were hardly measured.
    """
    # Count each dropped row once: by its time, else by its position.
    has_time = np.isfinite(raw.times)
    has_position = finite_rows(raw.coordinates)
    time_cell, position_cell = _first_unreadable_cells(raw)
    noun = raw.row_noun
    no_time, no_position = np.flatnonzero(~has_time), np.flatnonzero(has_time & ~has_position)
    found = [
        *_repair_of_rows(raw, f"{noun}s without a time dropped", no_time, time_cell),
        *_repair_of_rows(raw, f"{noun}s without a position dropped", no_position, position_cell),
    ]
    rows = np.flatnonzero(has_time & has_position)

    # Degrees have to be on the globe.
    if raw.geographic:
        rows = _drop_off_globe(raw, rows, globe, found)
        rows = _handle_zero_positions(raw, rows, found, clean=clean)
    for repair in found:
        add_repair(repairs, repair)
    return rows


def take_rows(raw: RawLog, rows: Rows) -> LogRows:
    """Return some rows of a batch; their codes are to be found."""
    # Without a change, arrays need no copies.
    is_all = len(rows) == len(raw.times) and bool((rows[1:] > rows[:-1]).all())
    take = slice(None) if is_all else rows
    return LogRows(
        np.zeros(len(rows), np.int32),
        raw.times[take],
        raw.coordinates[take],
        rows + raw.first,
        {name: values[take] for name, values in raw.attributes.items()},
    )


def _first_unreadable_cells(raw: RawLog) -> tuple[UnreadableCell | None, UnreadableCell | None]:
    """Find the first cells that cost rows their time, and rows with a time their position."""
    # Among unreadable cells, those of times come before those of coordinates.
    time_cell = next(
        (cell for cell in raw.unreadable if not np.isfinite(raw.times[cell.row])), None
    )
    position_cells = (cell for cell in raw.unreadable if np.isfinite(raw.times[cell.row]))
    return time_cell, min(position_cells, key=lambda cell: cell.row, default=None)


def _drop_off_globe(raw: RawLog, rows: Rows, globe: GlobeCheck, repairs: list[Repair]) -> Rows:
    """Drop positions off the globe."""
    off = globe.find(_coordinates_of(raw, rows), rows + raw.first, raw.name, raw.row_noun)
    if not off.any():
        return rows
    value = format_off_globe(raw.coordinates[rows[off.argmax()]])
    repairs += _repair_of_rows(
        raw, f"{raw.row_noun}s off the globe dropped", rows[off], value=value
    )
    kept: Rows = rows[~off]
    return kept


def _coordinates_of(raw: RawLog, rows: Rows) -> NDArray[np.float64]:
    """Return the coordinates of increasing rows, which are mostly all of a batch: no copy then."""
    return raw.coordinates if len(rows) == len(raw.coordinates) else raw.coordinates[rows]


def _handle_zero_positions(raw: RawLog, rows: Rows, repairs: list[Repair], *, clean: bool) -> Rows:
    """Drop positions at 0,0 if all others are far from there, or only report them first."""
    zero = find_zero_positions(_coordinates_of(raw, rows))
    if not zero.any():
        return rows
    if clean:
        what = f"{raw.row_noun}s at 0,0 dropped"
    else:
        what = f"{raw.row_noun}s at 0,0 kept, though hardly measured; --clean drops them"
    repairs[:0] = _repair_of_rows(raw, what, rows[zero], drops=clean)
    kept: Rows = rows[~zero] if clean else rows
    return kept


# Repairs


def _repair_of_rows(
    raw: RawLog,
    what: str,
    rows: Rows,
    cell: UnreadableCell | None = None,
    *,
    value: str = "",
    drops: bool = True,
) -> list[Repair]:
    """Return the repair of some rows of a batch, if there are any, with the first row or cell."""
    if not len(rows):
        return []
    first = int(rows.min()) if cell is None else cell.row
    value = value if cell is None else _format_cell(cell)
    where = f"{raw.name}: {raw.row_noun} {raw.first + first}"
    return [Repair(what, len(rows), where, drops, value)]


def add_repair(repairs: list[Repair], new: Repair) -> None:
    """Add a repair to those of a file; the same repair of an earlier batch grows."""
    for i, old in enumerate(repairs):
        if old.what == new.what:
            # The first place is shown, unless only a later one has a value to show.
            shown = old if old.value or not new.value else new
            repairs[i] = replace(shown, count=old.count + new.count)
            return
    repairs.append(new)


# Errors


def nothing_usable_error(
    name: str, noun: str, what: str, unreadable: Sequence[UnreadableCell]
) -> InputError:
    """Return the error for a file none of whose rows has a time, a position, or both.

    Parameters
    ----------
    name : str
        Name of the file.
    noun : str
        Word for a row.
    what : str
        What no row has.
    unreadable : sequence of UnreadableCell
        The first cells that can't be read.
    """
    shown = f"; the first says {_format_cell(unreadable[0])}" if unreadable else ""
    if noun == "row":
        remedy = "say which columns hold them with --columns t=COLUMN,..."
    else:
        remedy = "correct the file, or leave it out"
    return InputError(f"no {noun} has a {what} that can be read{shown}", path=name, remedy=remedy)


def _format_cell(cell: UnreadableCell) -> str:
    """Return a cell as messages show it: ``lat 'undefined'``, or ``no lat``."""
    # The reader of GPX writes `no lat` for an attribute that is missing; it is no value to quote.
    if cell.value == f"no {cell.column}":
        return cell.value
    value = cell.value
    if len(value) > _MAX_SHOWN_LETTERS:
        value = value[:_MAX_SHOWN_LETTERS] + "..."
    return f"{cell.column} {value!r}"
