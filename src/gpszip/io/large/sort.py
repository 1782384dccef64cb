"""Sort the rows of a log by track and time, in bounded memory.

:class:`ExternalSorter` takes batches of rows, drops and counts those that can't be used, finds the
track of each, and gives them to :class:`gpszip.io.large.runs.SortedRuns`. When all files are read,
it yields the rows of each track in the order of time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.large.batches import CoordinateKind, LogFile
from gpszip.io.large.columns import ColumnEncoder, ColumnKind
from gpszip.io.large.plane_sample import PlaneSample
from gpszip.io.large.runs import SortedRuns
from gpszip.io.logs.clean import first_cell_hint, first_unreadable_cells, format_cell
from gpszip.io.logs.globe import GlobeCheck, find_zero_positions, format_off_globe
from gpszip.io.logs.losses import (
    MIN_STOPPED_POSITIONS,
    TIME_OF_DAY_GOES_BACK,
    find_repeated_times,
    loss_if_large,
    stopped_clock_error,
)
from gpszip.io.logs.raw import RawLog, UnreadableCell, unused_name
from gpszip.model.read_result import LeftOut, Loss, Repair

__all__ = ["ExternalSorter", "coordinate_names"]

Floats = NDArray[np.float64]
Codes = NDArray[np.int32]


@dataclass
class _FileTrack:
    """Rows that one file has of one track.

    Parameters
    ----------
    code : int
        Number by which its rows are sorted.
    name : str
        Name of the track.
    where : str
        Name of the file.
    first_time : float
        Its earliest time.
    last_time : float
        Its latest time.
    row_time : float
        Time of the row that was read last.
    backward_steps : int
        How often its times go back.
    """

    code: int
    name: str
    where: str
    first_time: float = np.inf
    last_time: float = -np.inf
    row_time: float = -np.inf
    backward_steps: int = 0


class _UnusableRows(NamedTuple):
    """Number of rows of a track that can't be used, and the first file that has some."""

    where: str
    rows: int


class _Totals(NamedTuple):
    """What was counted before the present file, restored if the file is dropped."""

    points: int = 0
    repairs: tuple[Repair, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    unusable: tuple[tuple[str, _UnusableRows], ...] = ()


@dataclass
class _PresentFile:
    """State of the file whose rows are being added.

    Parameters
    ----------
    log_file : LogFile
        The file.
    stem : str
        Name of its track if it names none.
    totals_before : _Totals
        What was counted before it.
    code_by_name : dict
        Code of the track that each name stands for, at the row reached.
    codes : list of int
        Codes of all its tracks.
    codes_keeping_names : set of int
        Codes of tracks that keep their names; the others came from splitting and get new ones.
    kinds : set of tuple of ColumnKind
        Kinds of the kept columns in its batches.
    row_count, usable_count : int
        Number of its rows, and of those that can be used.
    has_times_of_day : bool
        Whether it has times of day without dates.
    globe : GlobeCheck
        Counts its positions off the globe.
    unreadable : tuple of UnreadableCell
        The first cells that can't be read.
    """

    log_file: LogFile
    stem: str
    totals_before: _Totals
    code_by_name: dict[str, int] = field(default_factory=dict)
    codes: list[int] = field(default_factory=list)
    codes_keeping_names: set[int] = field(default_factory=set)
    kinds: set[tuple[ColumnKind, ...]] = field(default_factory=set)
    row_count: int = 0
    usable_count: int = 0
    has_times_of_day: bool = False
    globe: GlobeCheck = field(default_factory=GlobeCheck)
    unreadable: tuple[UnreadableCell, ...] = ()


class ExternalSorter:
    """Sorts rows that don't fit in memory by track and time.

    For each file, call :meth:`begin_file`, :meth:`add` for each batch, and :meth:`end_file`; after
    an error, :meth:`drop_file`. Then :meth:`tracks` yields the tracks.

    Parameters
    ----------
    folder : Path
        Folder for temporary files.
    max_rows : int
        Rows in memory at once.
    sort : bool
        Put points whose times go back in order.
    split : bool
        Start a new track where time goes back.
    column_encoder : ColumnEncoder
        Encodes the kept columns.
    skip_bad : bool
        Leave out positions off the globe even if they are many, and tracks that overlap.
    clean : bool
        Drop positions at 0,0 that were hardly measured.
    """

    def __init__(
        self,
        folder: Path,
        max_rows: int,
        sort: bool,
        split: bool,
        column_encoder: ColumnEncoder,
        *,
        skip_bad: bool = False,
        clean: bool = False,
    ) -> None:
        # Options.
        self.max_rows = max_rows
        self.sort = sort
        self.split = split
        self.column_encoder = column_encoder
        self.skip_bad = skip_bad
        self.clean = clean

        # Results.
        self.errors: list[InputError] = []
        self.repairs: list[Repair] = []
        self.losses: list[Loss] = []
        self.dropped_columns: dict[str, None] = {}  # an ordered set
        self.points = 0
        self.dimension = 0
        self.geographic = False
        self.plane_sample = PlaneSample()

        # State.
        self._runs = SortedRuns(folder, max_rows, column_encoder)
        self._file_tracks: list[_FileTrack] = []  # by code
        self._accepted: list[_FileTrack] = []  # those of files that were read to their end
        self._left_out: list[LeftOut] = []
        self._unusable: dict[str, _UnusableRows] = {}  # by name of the track; "" for the file
        self._present_file: _PresentFile | None = None

    @property
    def width(self) -> int:
        """Numbers in a row: time, coordinates, kept columns."""
        return 1 + self.dimension + len(self.column_encoder.names)

    @property
    def is_empty(self) -> bool:
        """Whether no file has brought a row."""
        return not self._accepted

    # Files.

    def begin_file(self, log_file: LogFile, stem: str) -> None:
        """Start a file, whose track gets the name ``stem`` if the file names none."""
        totals = _Totals(
            self.points, tuple(self.repairs), tuple(self._left_out), tuple(self._unusable.items())
        )
        self._present_file = _PresentFile(log_file, stem, totals)

    def end_file(self) -> None:
        """Accept the rows of the present file.

        Raises
        ------
        InputError
            If no row of the file can be used, or its times go back and are not to be sorted.
        """
        # Its rows.
        file = self._file
        name = file.log_file.name
        if not file.row_count:
            raise InputError(f"{name}: columns, but no rows")
        file.globe.check(skip_bad=self.skip_bad)
        if not file.usable_count:
            raise InputError(
                f"{name}: no row has a time and position that can be read"
                f"{first_cell_hint(file.unreadable)}; name the columns: --columns t=COLUMN,..."
            )

        # Its tracks.
        for code in file.codes:
            self._check_order(self._file_tracks[code])
        self._name_split_tracks()
        self._accepted += [self._file_tracks[code] for code in file.codes]
        self.column_encoder.join(list(file.kinds))

    def drop_file(self) -> None:
        """Forget what the present file has brought."""
        totals = self._file.totals_before
        self.points = totals.points
        self.repairs = list(totals.repairs)
        self._left_out = list(totals.left_out)
        self._unusable = dict(totals.unusable)

    def left_out(self) -> Iterator[LeftOut]:
        """Yield what was left out, and why: parts of files first, then full files."""
        yield from self._left_out
        for error in self.errors:
            yield LeftOut(str(error.path), error.detail)

    @property
    def _file(self) -> _PresentFile:
        assert self._present_file is not None, "begin_file comes first"
        return self._present_file

    def _check_order(self, file_track: _FileTrack) -> None:
        """Refuse a track whose time goes back, or count the points to be sorted."""
        if not file_track.backward_steps:
            return
        name = self._file.log_file.name
        if self._file.has_times_of_day:
            raise InputError(f"{name}: track {file_track.name!r}: {TIME_OF_DAY_GOES_BACK}")
        if not self.sort:
            raise InputError(
                f"{name}: time goes back in track {file_track.name!r}; "
                "--sort orders the points, --split starts a new track"
            )
        what, count = "points put in the order of time", file_track.backward_steps
        self.repairs.append(Repair(what, count, name, drops=False))

    def _name_split_tracks(self) -> None:
        """Give tracks that start where time goes back names that the file doesn't use."""
        used_names = set(self._file.code_by_name)
        for code in self._file.codes:
            if code not in self._file.codes_keeping_names:
                file_track = self._file_tracks[code]
                file_track.name = unused_name(file_track.name, used_names)
                used_names.add(file_track.name)

    # Batches.

    def add(self, raw: RawLog) -> None:
        """Add a batch of the present file; rows that can't be used are dropped and counted."""
        # Count.
        file = self._file
        self._check_coordinates(raw)
        self.points += len(raw.times) + sum(repair.count for repair in raw.repairs if repair.drops)
        for repair in raw.repairs:
            self._add_repair(repair)
        file.has_times_of_day |= raw.time_of_day
        self._left_out += raw.left_out
        self.dropped_columns |= dict.fromkeys(raw.dropped_columns)

        # Drop rows.
        good = self._find_usable_rows(raw)
        file.usable_count += int(good.sum())
        file.row_count += len(good)
        self._count_unusable(raw, good)
        times, positions = raw.times[good], raw.coordinates[good]

        # Find the track of each row.
        codes = self._encode_tracks(raw, good)
        if self.split:
            where = f"{raw.name}: {raw.row_noun} {raw.first}"
            codes = self._split_at_backward_steps(codes, times, where)
        self._update_extents(codes, times)

        # Store.
        if raw.geographic:
            self.plane_sample.add(positions)
        columns = self.column_encoder.encode(raw.attributes, good, raw.name)
        file.kinds.add(columns.kinds)
        self._runs.add(codes, times, positions, columns)

    def _check_coordinates(self, raw: RawLog) -> None:
        """Refuse coordinates of another kind than those before."""
        before = CoordinateKind(self.geographic, self.dimension, "")
        present = CoordinateKind(raw.geographic, raw.coordinates.shape[1], "")
        if self.dimension and present != before:
            raise InputError(
                f"{raw.name}: holds {coordinate_names(present)}, "
                f"but the logs before {coordinate_names(before)}"
            )
        self.geographic, self.dimension = raw.geographic, raw.coordinates.shape[1]

    def _find_usable_rows(self, raw: RawLog) -> NDArray[np.bool_]:
        """Find the rows with a valid time and position, and count the others as repairs."""
        has_time = np.isfinite(raw.times)
        has_position = np.asarray(np.isfinite(raw.coordinates).all(axis=1))
        self._file.unreadable = self._file.unreadable or raw.unreadable

        no_time, no_position = first_unreadable_cells(raw)
        noun = raw.row_noun
        self._note_repair(raw, f"{noun}s without a time dropped", ~has_time, no_time)
        self._note_repair(
            raw, f"{noun}s without a position dropped", has_time & ~has_position, no_position
        )

        good: NDArray[np.bool_] = has_time & has_position
        if not raw.geographic:
            return good
        return self._drop_zero_positions(raw, self._drop_off_globe(raw, good))

    def _drop_off_globe(self, raw: RawLog, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Drop positions off the globe. Their number is checked at the end of the file."""
        rows = np.flatnonzero(good)
        off = np.zeros_like(good)
        off[rows] = self._file.globe.find(
            raw.coordinates[rows], rows + raw.first, f"{raw.name}: {raw.row_noun}"
        )
        value = format_off_globe(raw.coordinates[int(off.argmax())]) if off.any() else ""
        self._note_repair(raw, f"{raw.row_noun}s off the globe dropped", off, value=value)
        return good & ~off

    def _drop_zero_positions(self, raw: RawLog, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Count positions at 0,0 that are far from all others; drop them if cleaning."""
        rows = np.flatnonzero(good)
        zero = np.zeros_like(good)
        zero[rows] = find_zero_positions(raw.coordinates[rows])
        if self.clean:
            self._note_repair(raw, f"{raw.row_noun}s at 0,0 dropped", zero)
            return good & ~zero
        what = f"{raw.row_noun}s at 0,0 kept, though hardly measured; --clean drops them"
        self._note_repair(raw, what, zero, drops=False)
        return good

    def _note_repair(
        self,
        raw: RawLog,
        what: str,
        rows: NDArray[np.bool_],
        cell: UnreadableCell | None = None,
        *,
        value: str = "",
        drops: bool = True,
    ) -> None:
        """Count rows as repaired, with the number and the value of the first one."""
        count = int(rows.sum())
        if not count:
            return

        row = int(rows.argmax()) if cell is None else cell.row
        value = value if cell is None else format_cell(cell)
        where = f"{raw.name}: {raw.row_noun} {raw.first + row}"
        self._add_repair(Repair(what, count, where, drops, value))

    def _add_repair(self, new: Repair) -> None:
        """Add a repair to the same repair of earlier batches of the file, if there is one."""
        name = new.where.split(": ")[0]
        for i, old in enumerate(self.repairs):
            if old.what == new.what and old.where.split(": ")[0] == name:
                shown = old if old.value or not new.value else new
                self.repairs[i] = replace(shown, count=old.count + new.count)
                return
        self.repairs.append(new)

    def _count_unusable(self, raw: RawLog, good: NDArray[np.bool_]) -> None:
        """Count the rows that can't be used by track; rows of no track under the name ""."""
        dropped_by_reader = sum(repair.count for repair in raw.repairs if repair.drops)
        counts = {"": dropped_by_reader} if dropped_by_reader else {}
        if raw.codes is None and not good.all():
            counts[self._file.stem] = int((~good).sum())
        elif raw.codes is not None:
            unusable = np.bincount(raw.codes[~good], minlength=len(raw.ids))
            for code in np.flatnonzero(unusable).tolist():
                counts[raw.ids[code]] = int(unusable[code])
        for name, count in counts.items():
            before = self._unusable.get(name, _UnusableRows(raw.name, 0))
            self._unusable[name] = _UnusableRows(before.where, before.rows + count)

    # Tracks of a file.

    def _encode_tracks(self, raw: RawLog, good: NDArray[np.bool_]) -> Codes:
        """Return the code of each usable row's track."""
        if raw.codes is None:
            code = self._find_file_track(self._file.stem, raw.name)
            return np.full(int(good.sum()), code, np.int32)
        id_index = raw.codes[good]
        code_by_id = np.zeros(len(raw.ids), np.int32)
        for i in np.unique(id_index).tolist():
            code_by_id[i] = self._find_file_track(raw.ids[i], raw.name)
        codes: Codes = code_by_id[id_index]
        return codes

    def _find_file_track(self, name: str, where: str) -> int:
        """Return the code that a name stands for in the present file."""
        file = self._file
        if name not in file.code_by_name:
            file.code_by_name[name] = self._add_file_track(name, where)
            file.codes_keeping_names.add(file.code_by_name[name])
        return file.code_by_name[name]

    def _add_file_track(self, name: str, where: str) -> int:
        code = len(self._file_tracks)
        self._file_tracks.append(_FileTrack(code, name, where))
        self._file.codes.append(code)
        return code

    def _split_at_backward_steps(self, codes: Codes, times: Floats, where: str) -> Codes:
        """Start a new track where the time of a track goes back; it is named at the file's end."""
        split = codes.copy()
        for code in np.unique(codes).tolist():
            rows = np.flatnonzero(codes == code)
            file_track = self._file_tracks[code]
            back = np.flatnonzero(np.diff(times[rows], prepend=file_track.last_time) < 0).tolist()
            for start, stop in zip(back, [*back[1:], len(rows)], strict=True):
                new_code = self._add_file_track(file_track.name, file_track.where)
                self._file.code_by_name[file_track.name] = new_code
                split[rows[start:stop]] = new_code
            if back:
                what = "tracks started where time goes back"
                self._add_repair(Repair(what, len(back), where, drops=False))
        return split

    def _update_extents(self, codes: Codes, times: Floats) -> None:
        """Update each track's extent in time, and count its backward steps."""
        # Reduce the batch per track; the sort is stable, as steps between rows are counted.
        if not len(codes):
            return
        order = np.argsort(codes, kind="stable")
        codes, times = codes[order], times[order]
        starts = np.flatnonzero(np.diff(codes, prepend=-1))
        earliest = np.minimum.reduceat(times, starts)
        latest = np.maximum.reduceat(times, starts)
        goes_back = (np.diff(times) < 0) & (np.diff(codes) == 0)
        backward_steps = np.add.reduceat(np.append(0, goes_back), starts)

        # Combine with earlier batches. The step from the row before counts, too, so that the
        # number doesn't depend on where batches end.
        stops = np.append(starts[1:], len(times))
        for i, (start, stop) in enumerate(zip(starts.tolist(), stops.tolist(), strict=True)):
            file_track = self._file_tracks[int(codes[start])]
            starts_earlier = int(times[start] < file_track.row_time)
            file_track.backward_steps += int(backward_steps[i]) + starts_earlier
            file_track.row_time = float(times[stop - 1])
            file_track.first_time = min(file_track.first_time, float(earliest[i]))
            file_track.last_time = max(file_track.last_time, float(latest[i]))

    # Tracks of the log.

    def tracks(self) -> Iterator[tuple[str, Iterator[Floats]]]:
        """Yield each track with its rows in blocks, in the order of time.

        Rows at a time that an earlier row has already are dropped. After the last track, the
        temporary files are removed.

        Raises
        ------
        InputError
            If the rows of a track in two files overlap in time, or a track's clock stands still.
            With ``skip_bad``, these rows are left out.
        """
        self._runs.flush()
        tracks = self._group_by_track()
        for name, file_tracks in tracks.items():
            yield name, self._drop_repeated_times(name, file_tracks)

        # Count the losses of rows that belong to no track, or to one that is gone.
        for name, unusable in self._unusable.items():
            if name not in tracks:
                points = unusable.rows if name else self.points
                self.losses += loss_if_large(name, unusable.where, unusable.rows, points)
        self._runs.remove()

    def _group_by_track(self) -> dict[str, list[_FileTrack]]:
        """Return what the files have of each track, in the order of time."""
        # Leave out what overlaps with an earlier file.
        tracks: dict[str, list[_FileTrack]] = {}
        for file_track in self._accepted:
            file_tracks = tracks.setdefault(file_track.name, [])
            overlapping = (
                other
                for other in file_tracks
                if file_track.first_time < other.last_time
                and other.first_time < file_track.last_time
            )
            other = next(overlapping, None)
            if other is None:
                file_tracks.append(file_track)
            else:
                self._refuse_overlap(file_track, other)

        # Leave out tracks whose clock stands still, and sort the rest.
        for name in list(tracks):
            self._check_clock(name, tracks)
        return {
            name: sorted(file_tracks, key=lambda file_track: file_track.first_time)
            for name, file_tracks in tracks.items()
        }

    def _refuse_overlap(self, file_track: _FileTrack, other: _FileTrack) -> None:
        """Refuse rows that overlap with those of an earlier file, or leave them out."""
        name, where = file_track.name, file_track.where
        error = InputError(
            f"{where}: track {name!r} overlaps in time with its rows in {other.where}; "
            "rename one of them"
        )
        if not self.skip_bad:
            raise error
        self.errors.append(error.located_at(where))
        count = self._runs.row_count(file_track.code)
        self._add_repair(Repair(f"points of track {name!r} left out", count, where))

    def _check_clock(self, name: str, tracks: dict[str, list[_FileTrack]]) -> None:
        """Refuse a track whose points all have the same time, or leave it out."""
        # All at one time?
        file_tracks = tracks[name]
        count = sum(self._runs.row_count(file_track.code) for file_track in file_tracks)
        first_time = min(file_track.first_time for file_track in file_tracks)
        last_time = max(file_track.last_time for file_track in file_tracks)
        if count < MIN_STOPPED_POSITIONS or first_time < last_time:
            return

        # At several positions? Points at one position and time are one point.
        blocks = (
            block[:, 1 : 1 + self.dimension]
            for file_track in file_tracks
            for block in self._sorted_blocks(file_track)
        )
        first_block = next(blocks)
        elsewhere = sum(
            int((block != first_block[0]).any(axis=1).sum())
            for block in chain([first_block], blocks)
        )
        if elsewhere + 1 < MIN_STOPPED_POSITIONS:
            return

        # Refuse it, or leave it out.
        where = file_tracks[0].where
        error = stopped_clock_error(where, name, count, first_time)
        if not self.skip_bad or len(tracks) == 1:
            raise error
        self.errors.append(error.located_at(where))
        self._add_repair(Repair(f"points of track {name!r} left out", count, where))
        del tracks[name]
        self._unusable.pop(name, None)

    def _drop_repeated_times(self, name: str, file_tracks: list[_FileTrack]) -> Iterator[Floats]:
        """Yield the rows of a track without those at a time that an earlier row has already."""
        # Count the lost rows, and the most rows at other positions that share one time.
        unusable = self._unusable.get(name, _UnusableRows(file_tracks[0].where, 0))
        lost = unusable.rows
        max_sharing = 0  # most rows at another position that share the time of a kept row
        sharing = 0  # the same for the kept row that came last
        last_row = np.full((1, self.width), -np.inf)
        for file_track in file_tracks:
            where = f"{file_track.where}: track {name!r}"
            for block in self._sorted_blocks(file_track):
                # Compare each row with the one before, the first one with that of the last block.
                rows = np.concatenate([last_row, block])
                positions = rows[:, 1 : 1 + self.dimension]
                repeated = find_repeated_times(rows[:, 0], positions, np.zeros(len(rows), np.bool_))

                # Count.
                at_same = int(repeated.same_position[1:].sum())
                at_other = int(repeated.other_position.sum())
                self._count_repeated(where, at_same, at_other)
                lost += at_other
                kept_index = np.cumsum(repeated.first) - 1
                sharing_by_row = np.bincount(kept_index, weights=repeated.other_position)
                sharing_by_row[0] += sharing
                max_sharing = max(max_sharing, int(sharing_by_row.max()))
                sharing = int(sharing_by_row[-1])

                # Carry the last kept row to the next block, which may go on at its time.
                last_row = rows[repeated.first][-1:]
                yield block[repeated.first[1:]] if at_other or at_same else block

        # The kept row at that time counts, too.
        shared = max_sharing + 1 if max_sharing else 0
        points = unusable.rows + sum(self._runs.row_count(track.code) for track in file_tracks)
        self.losses += loss_if_large(name, unusable.where, lost, points, shared)

    def _count_repeated(self, where: str, at_same: int, at_other: int) -> None:
        if at_same:
            self._add_repair(Repair("repeated rows dropped", at_same, where))
        if at_other:
            what = "rows at another position, but the same time dropped"
            self._add_repair(Repair(what, at_other, where))

    def _sorted_blocks(self, file_track: _FileTrack) -> Iterator[Floats]:
        return self._runs.blocks(file_track.code, in_order=file_track.backward_steps == 0)


def coordinate_names(kind: CoordinateKind) -> str:
    """Return what messages call coordinates.

    Examples
    --------
    >>> coordinate_names(CoordinateKind(geographic=False, dimension=2, crs=""))
    'x,y'
    """
    return "lat,lon" if kind.geographic else ",".join("xyz"[: kind.dimension])
