"""From the raw columns of a log to its tracks, each with strictly increasing times.

:func:`clean_log` drops rows without a time or a position, positions off the globe and rows with
repeated timestamps; it sorts or splits tracks whose time goes back. It counts every row that it
drops. The functions for messages serve logs larger than memory, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.io.logs.globe import GlobeCheck, find_zero_positions, format_off_globe
from gpszip.io.logs.losses import (
    MAX_TINY_LOG_POINTS,
    TIME_OF_DAY_GOES_BACK,
    RepeatedTimes,
    find_large_losses,
    find_repeated_times,
    find_stopped_tracks,
    nearly_lost_error,
    stopped_clock_error,
)
from gpszip.io.logs.raw import RawLog, UnreadableCell, unused_name
from gpszip.model.read_result import LeftOut, Loss, Repair

__all__ = [
    "CleanedLog",
    "LogTrack",
    "clean_log",
    "first_cell_hint",
    "first_unreadable_cells",
    "format_cell",
]

#: Characters of a value that can't be read that messages show.
_MAX_SHOWN_LETTERS = 40


@dataclass(frozen=True, eq=False)
class LogTrack:
    """A track as one log has it, before it is projected; times strictly increase.

    Parameters
    ----------
    id : str or None
        Name of the track; None if the log names none.
    times : float64 array, shape (n,)
        Seconds.
    coordinates : float64 array, shape (n, d)
        Metres, or latitude and longitude in degrees.
    attributes : mapping of str to array, shape (n,)
        Further columns.
    where : str
        Name of the log.
    id_is_title : bool
        Whether the id is a title that other tracks may share.
    timed : bool
        Whether the track has times; those of a shape number its points.
    """

    id: str | None
    times: NDArray[np.float64]
    coordinates: NDArray[np.float64]
    attributes: Mapping[str, NDArray[np.generic]]
    where: str
    id_is_title: bool
    timed: bool = True

    def take(self, rows: NDArray[np.bool_] | slice) -> LogTrack:
        """Return the track with some of its samples."""
        attributes = {name: values[rows] for name, values in self.attributes.items()}
        return replace(
            self, times=self.times[rows], coordinates=self.coordinates[rows], attributes=attributes
        )


@dataclass(frozen=True, eq=False)
class CleanedLog:
    """The tracks of a log, and a record of its other rows.

    Parameters
    ----------
    tracks : list of LogTrack
        In the order in which the log first names them.
    repairs : list of Repair
        What was dropped or changed. Each row of the log is in a track or counted by a repair that
        drops rows.
    losses : list of Loss
        Tracks that lost many points.
    left_out : list of LeftOut
        Tracks that were left out.
    """

    tracks: list[LogTrack]
    repairs: list[Repair]
    losses: list[Loss]
    left_out: list[LeftOut]


def clean_log(
    raw: RawLog,
    *,
    sort: bool = False,
    split: bool = False,
    skip_bad: bool = False,
    clean: bool = False,
) -> CleanedLog:
    """Cut a log into tracks whose times strictly increase.

    Parameters
    ----------
    raw : RawLog
        The log as its reader returns it.
    sort : bool
        Sort the points of each track by time.
    split : bool
        Start a new track, ``ID-2`` and so on, where time goes back.
    skip_bad : bool
        Leave out tracks that can't be used, and any number of positions off the globe, instead of
        raising.
    clean : bool
        Drop positions at 0,0 that were hardly measured.

    Returns
    -------
    CleanedLog

    Raises
    ------
    InputError
        If at most one of several rows can be used, positions are not on the globe, all points of a
        track share one time, or time goes back and neither ``sort`` nor ``split`` is set.
    OptionError
        If both ``sort`` and ``split`` are set.
    """
    # Refuse two remedies for times that go back; each excludes the other.
    if sort and split:
        raise OptionError("--sort and --split exclude each other")

    # Drop rows without a usable time or position.
    repairs: list[Repair] = []
    raw = _number_shape_points(raw)
    rows = _drop_unreadable(raw, repairs)
    if raw.geographic:
        rows = _drop_off_globe(raw, rows, repairs, skip_bad=skip_bad)
        rows = _handle_zero_positions(raw, rows, repairs, clean=clean)

    # Bring the points of each track together, in the order of time.
    rows, starts = _order_by_time(raw, rows, sort, split, repairs)
    rows, starts, left_out = _drop_stopped_tracks(raw, rows, starts, skip_bad, repairs)

    # Keep one row for each timestamp. Tracks that are left out are no losses as well.
    repeated = find_repeated_times(raw.times[rows], raw.coordinates[rows], starts)
    names_left_out = {item.name for item in left_out}
    losses = [
        loss
        for loss in find_large_losses(raw, rows, repeated)
        if _track_label(raw, loss.track) not in names_left_out
    ]
    rows, starts = _drop_repeated_times(raw, rows, starts, repeated, repairs)

    # A long log of which at most one row is left was likely misread; a tiny one may be short.
    if len(rows) < 2 and len(raw.times) > MAX_TINY_LOG_POINTS:
        raise nearly_lost_error(raw.name, len(raw.times), raw.row_noun, repairs)
    return CleanedLog(_split_into_tracks(raw, rows, starts), repairs, losses, left_out)


def _track_label(raw: RawLog, track: str) -> str:
    return f"{raw.name}: track {track!r}"


# Rows without a usable time or position


def _number_shape_points(raw: RawLog) -> RawLog:
    """Number the points of tracks without times, so that they stay in the order of travel."""
    if not raw.untimed:
        return raw
    codes = np.zeros(len(raw.times), np.int64) if raw.codes is None else raw.codes
    in_shape = np.isin(codes, list(raw.untimed))
    order = np.arange(len(codes), dtype=np.float64)
    return replace(raw, times=np.where(in_shape, order, raw.times))


def _drop_unreadable(raw: RawLog, repairs: list[Repair]) -> NDArray[np.intp]:
    """Return the rows with a time and a position."""
    # Refuse a log without any usable row, as its columns were likely misread.
    has_time: NDArray[np.bool_] = np.isfinite(raw.times)
    has_position: NDArray[np.bool_] = np.asarray(np.isfinite(raw.coordinates).all(axis=1))
    _require_any(raw, has_time, "time")
    _require_any(raw, has_position, "position")
    _require_any(raw, has_time & has_position, "time and position")

    # Count each dropped row once: by its time, else by its position.
    time_cell, position_cell = first_unreadable_cells(raw)
    noun = raw.row_noun
    _add_repair(
        raw, f"{noun}s without a time dropped", np.flatnonzero(~has_time), repairs, time_cell
    )
    _add_repair(
        raw,
        f"{noun}s without a position dropped",
        np.flatnonzero(has_time & ~has_position),
        repairs,
        position_cell,
    )
    return np.flatnonzero(has_time & has_position)


def first_unreadable_cells(raw: RawLog) -> tuple[UnreadableCell | None, UnreadableCell | None]:
    """Find the first cells that cost rows their time and their position.

    Parameters
    ----------
    raw : RawLog
        In its ``unreadable``, cells of times come before cells of coordinates.

    Returns
    -------
    UnreadableCell or None
        First cell of a row without a time.
    UnreadableCell or None
        First cell of a row with a time, but without a position.
    """
    time_cell = next(
        (cell for cell in raw.unreadable if not np.isfinite(raw.times[cell.row])), None
    )
    position_cells = (cell for cell in raw.unreadable if np.isfinite(raw.times[cell.row]))
    return time_cell, min(position_cells, key=lambda cell: cell.row, default=None)


def _require_any(raw: RawLog, good: NDArray[np.bool_], what: str) -> None:
    """Raise if no row has a time or a position."""
    if good.any():
        return
    if raw.row_noun == "row":
        remedy = "say which columns hold them with --columns t=COLUMN,..."
    else:
        remedy = "correct the file, or leave it out"
    raise InputError(
        f"{raw.name}: no {raw.row_noun} has a {what} that can be read"
        f"{first_cell_hint(raw.unreadable)}; {remedy}"
    )


def first_cell_hint(unreadable: tuple[UnreadableCell, ...]) -> str:
    """Return the addition to an error that shows the first cell; empty if there is no cell."""
    return f"; the first says {format_cell(unreadable[0])}" if unreadable else ""


def format_cell(cell: UnreadableCell) -> str:
    """Return a cell as messages show it: ``lat 'undefined'``, or ``no lat``."""
    if cell.value == f"no {cell.column}":
        return cell.value
    value = cell.value
    if len(value) > _MAX_SHOWN_LETTERS:
        value = value[:_MAX_SHOWN_LETTERS] + "..."
    return f"{cell.column} {value!r}"


def _add_repair(
    raw: RawLog,
    what: str,
    rows: NDArray[np.intp],
    repairs: list[Repair],
    cell: UnreadableCell | None = None,
) -> None:
    """Record rows that are dropped, with the number of the first, or of the row of a cell."""
    if not len(rows):
        return
    first = int(rows.min()) if cell is None else cell.row
    value = "" if cell is None else format_cell(cell)
    where = f"{raw.name}: {raw.row_noun} {raw.first + first}"
    repairs.append(Repair(what, len(rows), where, value=value))


def _drop_off_globe(
    raw: RawLog, rows: NDArray[np.intp], repairs: list[Repair], *, skip_bad: bool
) -> NDArray[np.intp]:
    """Drop positions off the globe; raise if they are so many that the columns are no degrees."""
    check = GlobeCheck()
    off = check.find(raw.coordinates[rows], rows + raw.first, f"{raw.name}: {raw.row_noun}")
    if not off.any():
        return rows
    check.check(skip_bad=skip_bad)

    _add_repair(raw, f"{raw.row_noun}s off the globe dropped", rows[off], repairs)
    repairs[-1] = replace(repairs[-1], value=format_off_globe(raw.coordinates[rows[off.argmax()]]))
    kept: NDArray[np.intp] = rows[~off]
    return kept


def _handle_zero_positions(
    raw: RawLog, rows: NDArray[np.intp], repairs: list[Repair], *, clean: bool
) -> NDArray[np.intp]:
    """Drop positions at 0,0 if all others are far from there, or only report them."""
    zero = find_zero_positions(raw.coordinates[rows])
    if not zero.any():
        return rows
    if clean:
        what = f"{raw.row_noun}s at 0,0 dropped"
    else:
        what = f"{raw.row_noun}s at 0,0 kept, though hardly measured; --clean drops them"
    where = f"{raw.name}: {raw.row_noun} {raw.first + int(rows[zero.argmax()])}"
    repairs.insert(0, Repair(what, int(zero.sum()), where, drops=clean))
    kept: NDArray[np.intp] = rows[~zero] if clean else rows
    return kept


# Order in time


def _order_by_time(
    raw: RawLog, rows: NDArray[np.intp], sort: bool, split: bool, repairs: list[Repair]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Order rows by track and time.

    Returns
    -------
    int array, shape (n,)
        The rows.
    bool array, shape (n,)
        Whether a track starts at the row.
    """
    # Group rows by track.
    if raw.codes is not None and (np.diff(raw.codes[rows]) < 0).any():
        rows = rows[np.argsort(raw.codes[rows], kind="stable")]
    starts = _find_track_starts(raw, rows)
    goes_back = _find_time_reversals(raw, rows, starts)
    if not goes_back.any():
        return rows, starts

    # Sort them by time, start new tracks, or refuse.
    first = int(goes_back.argmax())
    reversals = int(goes_back.sum())
    where = f"{raw.name}: {raw.row_noun} {raw.first + int(rows[first])}"
    if raw.time_of_day and not split:
        raise InputError(f"{where}: {TIME_OF_DAY_GOES_BACK}")
    if sort:
        repairs.append(Repair("points put in the order of time", reversals, where, drops=False))
        by_track = raw.codes[rows] if raw.codes is not None else np.zeros(len(rows), dtype=np.int8)
        return rows[np.lexsort((raw.times[rows], by_track))], starts
    if split:
        repairs.append(Repair("tracks started where time goes back", reversals, where, drops=False))
        return rows, starts | goes_back
    step = raw.times[rows[first - 1]] - raw.times[rows[first]]
    raise InputError(
        f"{where}: time goes back {step:.6g} s; "
        "--sort orders the points, --split starts a new track"
    )


def _find_track_starts(raw: RawLog, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    starts = np.zeros(len(rows), dtype=np.bool_)
    starts[:1] = True
    if raw.codes is not None:
        starts[1:] = np.diff(raw.codes[rows]) != 0
    return starts


def _find_time_reversals(
    raw: RawLog, rows: NDArray[np.intp], starts: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    goes_back = np.zeros(len(rows), dtype=np.bool_)
    goes_back[1:] = np.diff(raw.times[rows]) < 0
    return goes_back & ~starts


# Repeated timestamps


def _drop_stopped_tracks(
    raw: RawLog,
    rows: NDArray[np.intp],
    starts: NDArray[np.bool_],
    skip_bad: bool,
    repairs: list[Repair],
) -> tuple[NDArray[np.intp], NDArray[np.bool_], list[LeftOut]]:
    """Refuse tracks whose points all have the same time, or leave them out."""
    # Find these tracks.
    repeated = find_repeated_times(raw.times[rows], raw.coordinates[rows], starts)
    stopped = find_stopped_tracks(raw, rows, repeated)
    if not stopped:
        return rows, starts, []
    codes = np.zeros(len(rows), np.int64) if raw.codes is None else raw.codes[rows]
    names = raw.ids or ("",)

    # Describe each of them.
    errors = {}
    for code in stopped:
        track_rows = rows[codes == code]
        count, time = len(track_rows), float(raw.times[track_rows[0]])
        errors[code] = stopped_clock_error(raw.name, names[code], count, time)
        repairs.append(Repair(f"points of track {names[code]!r} left out", count, raw.name))

    # Raise, unless other tracks remain and bad ones may be left out.
    remains = ~np.isin(codes, stopped)
    if not skip_bad or not remains.any():
        raise errors[stopped[0]]
    left_out = [
        LeftOut(_track_label(raw, names[code]), str(error).removeprefix(f"{raw.name}: "))
        for code, error in errors.items()
    ]
    return rows[remains], starts[remains], left_out


def _drop_repeated_times(
    raw: RawLog,
    rows: NDArray[np.intp],
    starts: NDArray[np.bool_],
    repeated: RepeatedTimes,
    repairs: list[Repair],
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Keep the first of several rows with the same time."""
    noun = raw.row_noun
    _add_repair(raw, f"repeated {noun}s dropped", rows[repeated.same_position], repairs)
    _add_repair(
        raw,
        f"{noun}s at another position, but the same time dropped",
        rows[repeated.other_position],
        repairs,
    )
    return rows[repeated.first], starts[repeated.first]


def _split_into_tracks(
    raw: RawLog, rows: NDArray[np.intp], starts: NDArray[np.bool_]
) -> list[LogTrack]:
    """Cut ordered rows where a track starts, and name the tracks."""
    # Take times, positions and attributes in the order of tracks and times.
    attributes = {name: values[rows] for name, values in raw.attributes.items()}
    all_rows = LogTrack(
        None, raw.times[rows], raw.coordinates[rows], attributes, raw.name, raw.ids_are_titles
    )

    # Cut before each start; a track without times becomes a shape.
    tracks: list[LogTrack] = []
    used_names: set[str] = set()
    for first, last in pairwise([*np.flatnonzero(starts).tolist(), len(rows)]):
        track = all_rows.take(slice(first, last))
        code = 0 if raw.codes is None else int(raw.codes[rows[first]])
        track = replace(track, timed=code not in raw.untimed)

        # A track that was split goes on under a name that no track of the log has.
        if raw.codes is not None:
            name = raw.ids[code]
            if name in used_names:
                name = unused_name(name, used_names.union(raw.ids))
            used_names.add(name)
            track = replace(track, id=name)
        tracks.append(track)
    return tracks
