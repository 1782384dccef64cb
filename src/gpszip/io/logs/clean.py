"""From raw columns to pieces of tracks: rows that can't be used are dropped, order in time is seen to, and all is counted."""

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
    """A track, or the part of one that a log holds; times strictly increase.

    Parameters
    ----------
    id : str or None
        Name of the track; None where the log names none.
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
        """Keep some of the samples."""
        kept = {name: values[rows] for name, values in self.attributes.items()}
        return replace(
            self, times=self.times[rows], coordinates=self.coordinates[rows], attributes=kept
        )


@dataclass(frozen=True, eq=False)
class CleanedLog:
    """The tracks of a log, and what became of its other rows.

    Parameters
    ----------
    tracks : list of Piece
        In the order in which the log first names them.
    repairs : list of Repair
        What was dropped or changed. The points of the pieces and those that these repairs drop are the rows of the log.
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
    """Cut a log into its tracks and make their times increase.

    Parameters
    ----------
    raw : RawLog
        As a reader found it.
    sort : bool
        Put the points of each track in the order of their times.
    split : bool
        Start a new track, ``ID-2`` and so on, where time goes back.
    skip_bad : bool
        Leave out tracks that can't be used, and positions off the globe even where they are many, instead of raising.
    clean : bool
        Drop positions at 0,0 that were hardly measured.

    Returns
    -------
    Mended

    Raises
    ------
    InputError
        If no row can be used, or only one of several, positions are not on the globe, all points of a track share one time, or
        time goes back and neither ``sort`` nor ``split`` is set.
    """
    if sort and split:
        raise OptionError("--sort and --split exclude each other")
    repairs: list[Repair] = []
    raw = _number_shape_points(raw)
    rows = _drop_unreadable(raw, repairs)
    if raw.geographic:
        rows = _drop_off_globe(raw, rows, repairs, skip_bad=skip_bad)
        rows = _handle_zero_positions(raw, rows, repairs, clean=clean)
    rows, starts = _order_by_time(raw, rows, sort, split, repairs)
    rows, starts, left_out = _drop_stopped_tracks(raw, rows, starts, skip_bad, repairs)
    doubles = find_repeated_times(raw.times[rows], raw.coordinates[rows], starts)
    named = {one.name for one in left_out}
    losses = [
        loss
        for loss in find_large_losses(raw, rows, doubles)
        if f"{raw.name}: track {loss.track!r}" not in named
    ]
    rows, starts = _drop_repeated_times(raw, rows, starts, doubles, repairs)
    if len(rows) < 2 and len(raw.times) > MAX_TINY_LOG_POINTS:
        raise nearly_lost_error(raw.name, len(raw.times), raw.row_noun, repairs)
    return CleanedLog(_split_into_tracks(raw, rows, starts), repairs, losses, left_out)


def _number_shape_points(raw: RawLog) -> RawLog:
    """Number the points of tracks without times, so that they stay in the order of travel."""
    if not raw.untimed:
        return raw
    codes = np.zeros(len(raw.times), np.int64) if raw.codes is None else raw.codes
    shapes = np.isin(codes, list(raw.untimed))
    return replace(raw, times=np.where(shapes, np.arange(len(codes), dtype=np.float64), raw.times))


def _drop_unreadable(raw: RawLog, repairs: list[Repair]) -> NDArray[np.intp]:
    timed: NDArray[np.bool_] = np.isfinite(raw.times)
    placed: NDArray[np.bool_] = np.asarray(np.isfinite(raw.coordinates).all(axis=1))
    _require_any(raw, timed, "time")
    _require_any(raw, placed, "position")
    _require_any(raw, timed & placed, "time and position")
    no_time, no_place = first_unreadable_cells(raw)
    _add_repair(
        raw, f"{raw.row_noun}s without a time dropped", np.flatnonzero(~timed), repairs, no_time
    )
    _add_repair(
        raw,
        f"{raw.row_noun}s without a position dropped",
        np.flatnonzero(timed & ~placed),
        repairs,
        no_place,
    )
    return np.flatnonzero(timed & placed)


def first_unreadable_cells(raw: RawLog) -> tuple[UnreadableCell | None, UnreadableCell | None]:
    """Return the first cell for which a row has no time, and the first for which one with a time has no position.

    Parameters
    ----------
    raw : RawLog
        Its ``unread`` cells of times come before those of coordinates.
    """
    no_time = next((cell for cell in raw.unreadable if not np.isfinite(raw.times[cell.row])), None)
    no_place = (cell for cell in raw.unreadable if np.isfinite(raw.times[cell.row]))
    return no_time, min(no_place, key=lambda cell: cell.row, default=None)


def _require_any(raw: RawLog, good: NDArray[np.bool_], what: str) -> None:
    if not good.any():
        remedy = (
            "say which columns hold them with --columns t=COLUMN,..."
            if raw.row_noun == "row"
            else "mend the file, or leave it out"
        )
        raise InputError(
            f"{raw.name}: no {raw.row_noun} has a {what} that can be read{first_cell_hint(raw.unreadable)}; {remedy}"
        )


def first_cell_hint(unread: tuple[UnreadableCell, ...]) -> str:
    """Return what the first cell says that can't be read, for an error; nothing where there is none."""
    return f"; the first says {format_cell(unread[0])}" if unread else ""


def format_cell(cell: UnreadableCell) -> str:
    """Return a cell that can't be read as messages show it: ``lat 'undefined'``, or ``no lat``."""
    if cell.value == f"no {cell.column}":
        return cell.value
    return f"{cell.column} {cell.value if len(cell.value) <= _MAX_SHOWN_LETTERS else cell.value[:_MAX_SHOWN_LETTERS] + '...'!r}"


def _add_repair(
    raw: RawLog,
    what: str,
    rows: NDArray[np.intp],
    repairs: list[Repair],
    cell: UnreadableCell | None = None,
) -> None:
    """Count rows, and name the first one; or that of the first cell that can't be read, if there is one."""
    if len(rows):
        first = int(rows.min()) if cell is None else cell.row
        value = "" if cell is None else format_cell(cell)
        repairs.append(
            Repair(what, len(rows), f"{raw.name}: {raw.row_noun} {raw.first + first}", value=value)
        )


def _drop_off_globe(
    raw: RawLog, rows: NDArray[np.intp], repairs: list[Repair], *, skip_bad: bool
) -> NDArray[np.intp]:
    """Drop positions off the globe, unless they are so many that the columns can't be degrees."""
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
    """Tell of positions at 0,0 among others far from there, or drop them."""
    zero = find_zero_positions(raw.coordinates[rows])
    if not zero.any():
        return rows
    what = (
        f"{raw.row_noun}s at 0,0 dropped"
        if clean
        else f"{raw.row_noun}s at 0,0 kept, though hardly measured; --clean drops them"
    )
    where = f"{raw.name}: {raw.row_noun} {raw.first + int(rows[zero.argmax()])}"
    repairs.insert(0, Repair(what, int(zero.sum()), where, drops=clean))
    kept: NDArray[np.intp] = rows[~zero] if clean else rows
    return kept


def _order_by_time(
    raw: RawLog, rows: NDArray[np.intp], sort: bool, split: bool, repairs: list[Repair]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Rows grouped by track with increasing times, and where a new piece starts."""
    if raw.codes is not None and (np.diff(raw.codes[rows]) < 0).any():
        rows = rows[np.argsort(raw.codes[rows], kind="stable")]
    starts = _find_track_starts(raw, rows)
    back = _find_time_reversals(raw, rows, starts)
    if not back.any():
        return rows, starts
    where = f"{raw.name}: {raw.row_noun} {raw.first + int(rows[int(back.argmax())])}"
    if raw.time_of_day and not split:
        raise InputError(f"{where}: {TIME_OF_DAY_GOES_BACK}")
    if sort:
        repairs.append(
            Repair("points put in the order of time", int(back.sum()), where, drops=False)
        )
        by_track = raw.codes[rows] if raw.codes is not None else np.zeros(len(rows), dtype=np.int8)
        return rows[np.lexsort((raw.times[rows], by_track))], starts
    if split:
        repairs.append(
            Repair("tracks started where time goes back", int(back.sum()), where, drops=False)
        )
        return rows, starts | back
    at = int(back.argmax())
    step = raw.times[rows[at - 1]] - raw.times[rows[at]]
    raise InputError(
        f"{where}: time goes back {step:.6g} s; --sort orders the points, --split starts a new track"
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
    back = np.zeros(len(rows), dtype=np.bool_)
    back[1:] = np.diff(raw.times[rows]) < 0
    return back & ~starts


def _drop_stopped_tracks(
    raw: RawLog,
    rows: NDArray[np.intp],
    starts: NDArray[np.bool_],
    skip_bad: bool,
    repairs: list[Repair],
) -> tuple[NDArray[np.intp], NDArray[np.bool_], list[LeftOut]]:
    """Refuse tracks whose points all have the same time, or leave them out."""
    # Which tracks are they?
    doubles = find_repeated_times(raw.times[rows], raw.coordinates[rows], starts)
    stopped = find_stopped_tracks(raw, rows, doubles)
    if not stopped:
        return rows, starts, []
    codes = np.zeros(len(rows), np.int64) if raw.codes is None else raw.codes[rows]
    names = raw.ids or ("",)

    # Say so of each.
    errors = {}
    for code in stopped:
        own = rows[codes == code]
        errors[code] = stopped_clock_error(
            raw.name, names[code], len(own), float(raw.times[own[0]])
        )
        repairs.append(Repair(f"points of track {names[code]!r} left out", len(own), raw.name))
    left = ~np.isin(codes, stopped)
    if not skip_bad or not left.any():
        raise errors[stopped[0]]
    reasons = {code: str(error).removeprefix(f"{raw.name}: ") for code, error in errors.items()}
    return (
        rows[left],
        starts[left],
        [LeftOut(f"{raw.name}: track {names[code]!r}", reason) for code, reason in reasons.items()],
    )


def _drop_repeated_times(
    raw: RawLog,
    rows: NDArray[np.intp],
    starts: NDArray[np.bool_],
    doubles: RepeatedTimes,
    repairs: list[Repair],
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Keep the first of several rows of the same time."""
    _add_repair(raw, f"repeated {raw.row_noun}s dropped", rows[doubles.same_position], repairs)
    _add_repair(
        raw,
        f"{raw.row_noun}s at another position, but the same time dropped",
        rows[doubles.other_position],
        repairs,
    )
    return rows[doubles.first], starts[doubles.first]


def _split_into_tracks(
    raw: RawLog, rows: NDArray[np.intp], starts: NDArray[np.bool_]
) -> list[LogTrack]:
    bounds = [*np.flatnonzero(starts).tolist(), len(rows)]
    times, coordinates = raw.times[rows], raw.coordinates[rows]
    attributes = {name: values[rows] for name, values in raw.attributes.items()}
    whole = LogTrack(None, times, coordinates, attributes, raw.name, raw.ids_are_titles)
    pieces: list[LogTrack] = []
    seen: set[str] = set()
    for first, last in pairwise(bounds):
        piece = whole.take(slice(first, last))
        code = 0 if raw.codes is None else int(raw.codes[rows[first]])
        piece = replace(piece, timed=code not in raw.untimed)
        if raw.codes is not None:
            name = raw.ids[int(raw.codes[rows[first]])]
            name = unused_name(name, seen.union(raw.ids)) if name in seen else name
            seen.add(name)
            piece = replace(piece, id=name)
        pieces.append(piece)
    return pieces
