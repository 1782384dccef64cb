"""Sorting rows that don't fit in memory by track and time: batches become sorted runs, which are merged track by track."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain as chain_of
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.large.batches import LogFile
from gpszip.io.large.columns import ColumnEncoder
from gpszip.io.large.plane_sample import PlaneSample
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
from gpszip.io.storage.temporary import disk_errors_as_output_errors, read_numbers, write_numbers
from gpszip.model.read_result import LeftOut, Loss, Repair

__all__ = ["ExternalSorter", "coordinate_names", "read_rows"]

Floats = NDArray[np.float64]


@dataclass
class _FileTrack:
    """What one file holds of one track."""

    name: str
    where: str
    count: int = 0
    first: float = np.inf
    last: float = -np.inf
    backward_steps: int = 0
    run_ranges: list[tuple[int, int, int]] = field(default_factory=list)  # run, row, rows


@dataclass(frozen=True)
class _UnusableRows:
    """Rows of a track that can't be used, and the first file that has some."""

    where: str
    count: int


class ExternalSorter:
    """Gathers rows, writes them as sorted runs, and at last yields those of each track in the order of time.

    Parameters
    ----------
    folder : Path
        Folder for the runs.
    rows : int
        How many rows may be in memory at once.
    sort, split : bool
        What to do where time goes back.
    column_encoder : Slots
        The further columns of rows, which lie in the last columns of a block.
    skip_bad : bool
        Leave out positions off the globe even where they are many.
    clean : bool
        Drop positions at 0,0 that were hardly measured.
    """

    def __init__(
        self,
        folder: Path,
        rows: int,
        sort: bool,
        split: bool,
        slots: ColumnEncoder,
        *,
        skip_bad: bool = False,
        clean: bool = False,
    ) -> None:
        self.skip_bad, self.clean = skip_bad, clean
        self.folder, self.rows, self.sort, self.split, self.column_encoder = (
            folder,
            rows,
            sort,
            split,
            slots,
        )
        self.file_tracks: list[_FileTrack] = []
        self.errors: list[InputError] = []
        self.repairs: list[Repair] = []
        self.losses: list[Loss] = []
        self.dropped_columns: dict[str, None] = {}
        self.points, self.dimension, self.geographic = 0, 0, False
        self._accepted: list[int] = []
        self._code_by_name: dict[
            str, int
        ] = {}  # the part that each name of the present file stands for
        self._codes_of_file: list[int] = []  # all of its parts, and those that keep their names
        self._codes_with_own_name: set[int] = set()
        self._log_file: tuple[LogFile, str] | None = None
        self._parts_left_out: list[LeftOut] = []
        self._state_before_file: tuple[
            int, list[Repair], list[LeftOut], dict[str, _UnusableRows]
        ] = (0, [], [], {})
        self._unusable: dict[str, _UnusableRows] = {}
        self._has_times_of_day = False  # whether the present file has times of day without dates
        self._buffer: list[tuple[NDArray[np.int32], Floats]] = []
        self._kinds: set[tuple[int, ...]] = set()  # those of the present file's columns
        self._buffer_kinds: tuple[int, ...] = ()
        self._run_kinds: list[tuple[int, ...]] = []  # kinds of each run's columns
        self._buffered_rows = self._usable_count = self._row_count = 0
        self._globe = GlobeCheck()  # of the present file, as is what can't be read in it
        self._unread: tuple[UnreadableCell, ...] = ()
        self.plane_sample = PlaneSample()

    @property
    def width(self) -> int:
        """Numbers in a row: time, coordinates, further columns."""
        return 1 + self.dimension + len(self.column_encoder.names)

    @property
    def empty(self) -> bool:
        """Whether no file has brought a row."""
        return not self._accepted

    def begin_file(self, log_file: LogFile, stem: str) -> None:
        """Expect the rows of a file, whose track has this name if it names none."""
        (
            self._log_file,
            self._code_by_name,
            self._codes_of_file,
            self._codes_with_own_name,
            self._usable_count,
        ) = (
            (log_file, stem),
            {},
            [],
            set(),
            0,
        )
        self._kinds, self._row_count, self._has_times_of_day = set(), 0, False
        self._globe, self._unread = GlobeCheck(), ()
        self._state_before_file = (
            self.points,
            list(self.repairs),
            list(self._parts_left_out),
            dict(self._unusable),
        )

    def end_file(self) -> None:
        """Refuse a file of which no row can be used, and one whose times go back."""
        assert self._log_file is not None
        name = self._log_file[0].name
        if not self._row_count:
            raise InputError(f"{name}: columns, but no rows")
        self._globe.check(skip_bad=self.skip_bad)
        if not self._usable_count:
            raise InputError(
                f"{name}: no row has a time and position that can be read{first_cell_hint(self._unread)}; name the columns: --columns t=COLUMN,..."
            )
        for number in self._codes_of_file:
            file_track = self.file_tracks[number]
            if file_track.backward_steps and self._has_times_of_day:
                raise InputError(f"{name}: track {file_track.name!r}: {TIME_OF_DAY_GOES_BACK}")
            if file_track.backward_steps and not self.sort:
                raise InputError(
                    f"{name}: time goes back in track {file_track.name!r}; --sort orders the points, --split starts a new track"
                )
            if file_track.backward_steps:
                self.repairs.append(
                    Repair(
                        "points put in the order of time",
                        file_track.backward_steps,
                        name,
                        drops=False,
                    )
                )
        taken = set(self._code_by_name)
        for file_track in (
            self.file_tracks[number]
            for number in self._codes_of_file
            if number not in self._codes_with_own_name
        ):
            file_track.name = unused_name(file_track.name, taken)
            taken.add(file_track.name)
        self._accepted += self._codes_of_file
        self.column_encoder.join(list(self._kinds))

    def drop_file(self) -> None:
        """Forget what the present file has brought."""
        self.points, self.repairs, self._parts_left_out, self._unusable = self._state_before_file

    def left_out(self) -> Iterator[LeftOut]:
        """Yield what was left out, and why: parts of files first, then whole files."""
        yield from self._parts_left_out
        for error in self.errors:
            name, _, reason = str(error).partition(": ")
            yield LeftOut(name, reason)

    def add(self, raw: RawLog) -> None:
        """Take in a batch; rows that can't be used are dropped and counted."""
        self._check_coordinates(raw)
        self.points += len(raw.times) + sum(repair.count for repair in raw.repairs if repair.drops)
        for repair in raw.repairs:
            self._add_repair(repair)
        self._has_times_of_day |= raw.time_of_day
        self._parts_left_out += raw.left_out
        self.dropped_columns |= dict.fromkeys(raw.dropped_columns)
        good = self._find_usable_rows(raw)
        self._usable_count += int(good.sum())
        self._row_count += len(good)
        self._count_unusable(raw, good)
        times, positions = raw.times[good], raw.coordinates[good]
        codes = self._encode_tracks(raw, good)
        if self.split:
            codes = self._split_at_backward_steps(
                codes, times, f"{raw.name}: {raw.row_noun} {raw.first}"
            )
        self._update_extents(codes, times)
        if raw.geographic:
            self.plane_sample.add(positions)
        self._buffer_rows(
            codes, times, positions, *self.column_encoder.encode(raw.attributes, good, raw.name)
        )

    def _check_coordinates(self, raw: RawLog) -> None:
        own = (raw.geographic, raw.coordinates.shape[1])
        if self.dimension and own != (self.geographic, self.dimension):
            raise InputError(
                f"{raw.name}: holds {coordinate_names((*own, ''))}, but the logs before {coordinate_names((self.geographic, self.dimension, ''))}"
            )
        self.geographic, self.dimension = own

    def _find_usable_rows(self, raw: RawLog) -> NDArray[np.bool_]:
        timed = np.isfinite(raw.times)
        placed = np.asarray(np.isfinite(raw.coordinates).all(axis=1))
        self._unread = self._unread or raw.unreadable
        no_time, no_place = first_unreadable_cells(raw)
        self._note_repair(raw, f"{raw.row_noun}s without a time dropped", ~timed, no_time)
        self._note_repair(
            raw, f"{raw.row_noun}s without a position dropped", timed & ~placed, no_place
        )
        good: NDArray[np.bool_] = timed & placed
        return self._drop_off_globe(raw, good) if raw.geographic else good

    def _drop_off_globe(self, raw: RawLog, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Drop positions off the globe, whose number is checked at the end of the file, and those at 0,0."""
        rows = np.flatnonzero(good)
        off = np.zeros_like(good)
        off[rows] = self._globe.find(
            raw.coordinates[rows], rows + raw.first, f"{raw.name}: {raw.row_noun}"
        )
        value = format_off_globe(raw.coordinates[int(off.argmax())]) if off.any() else ""
        self._note_repair(raw, f"{raw.row_noun}s off the globe dropped", off, value=value)
        good = good & ~off

        rows = np.flatnonzero(good)
        zero = np.zeros_like(good)
        zero[rows] = find_zero_positions(raw.coordinates[rows])
        kept = f"{raw.row_noun}s at 0,0 kept, though hardly measured; --clean drops them"
        self._note_repair(
            raw, f"{raw.row_noun}s at 0,0 dropped" if self.clean else kept, zero, drops=self.clean
        )
        return good & ~zero if self.clean else good

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
        lost = int(rows.sum())
        if lost:
            first = int(rows.argmax()) if cell is None else cell.row
            value = value if cell is None else format_cell(cell)
            self._add_repair(
                Repair(what, lost, f"{raw.name}: {raw.row_noun} {raw.first + first}", drops, value)
            )

    def _add_repair(self, new: Repair) -> None:
        """Count on where the same was mended in the same file before."""
        name = new.where.split(": ")[0]
        for i, old in enumerate(self.repairs):
            if old.what == new.what and old.where.split(": ")[0] == name:
                named = old if old.value or not new.value else new
                self.repairs[i] = replace(named, count=old.count + new.count)
                return
        self.repairs.append(new)

    def _count_unusable(self, raw: RawLog, good: NDArray[np.bool_]) -> None:
        """Count the rows that can't be used by the track that they are of, those that belong to none by the file."""
        assert self._log_file is not None
        before = sum(repair.count for repair in raw.repairs if repair.drops)
        counts = {"": before} if before else {}
        if raw.codes is None and not good.all():
            counts[self._log_file[1]] = int((~good).sum())
        elif raw.codes is not None:
            bad = np.bincount(raw.codes[~good], minlength=len(raw.ids))
            counts |= {raw.ids[code]: int(bad[code]) for code in np.flatnonzero(bad).tolist()}
        for name, count in counts.items():
            old = self._unusable.get(name, _UnusableRows(raw.name, 0))
            self._unusable[name] = _UnusableRows(old.where, old.count + count)

    def _encode_tracks(self, raw: RawLog, good: NDArray[np.bool_]) -> NDArray[np.int32]:
        assert self._log_file is not None
        if raw.codes is None:
            return np.full(
                int(good.sum()), self._find_file_track(self._log_file[1], raw.name), np.int32
            )
        used = raw.codes[good]
        number = np.zeros(len(raw.ids), np.int32)
        for code in np.unique(used).tolist():
            number[code] = self._find_file_track(raw.ids[code], raw.name)
        codes: NDArray[np.int32] = number[used]
        return codes

    def _find_file_track(self, name: str, where: str) -> int:
        if name not in self._code_by_name:
            self._code_by_name[name] = self._add_file_track(name, where)
            self._codes_with_own_name.add(self._code_by_name[name])
        return self._code_by_name[name]

    def _add_file_track(self, name: str, where: str) -> int:
        self.file_tracks.append(_FileTrack(name, where))
        self._codes_of_file.append(len(self.file_tracks) - 1)
        return self._codes_of_file[-1]

    def _split_at_backward_steps(
        self, codes: NDArray[np.int32], times: Floats, where: str
    ) -> NDArray[np.int32]:
        """Give rows from where a track's time goes back to a new part, which gets its own name at the end of the file."""
        split = codes.copy()
        for code in np.unique(codes).tolist():
            rows = np.flatnonzero(codes == code)
            file_track = self.file_tracks[code]
            back = np.flatnonzero(np.diff(times[rows], prepend=file_track.last) < 0).tolist()
            for first, after in zip(back, [*back[1:], len(rows)], strict=True):
                self._code_by_name[file_track.name] = number = self._add_file_track(
                    file_track.name, file_track.where
                )
                split[rows[first:after]] = number
            if back:
                self._add_repair(
                    Repair("tracks started where time goes back", len(back), where, drops=False)
                )
        return split

    def _update_extents(self, codes: NDArray[np.int32], times: Floats) -> None:
        """Keep the extent of each part, and how often its times go back."""
        if not len(codes):
            return
        order = np.argsort(codes, kind="stable")
        codes, times = codes[order], times[order]
        starts = np.flatnonzero(np.diff(codes, prepend=-1))
        low, high = np.minimum.reduceat(times, starts), np.maximum.reduceat(times, starts)
        back = np.add.reduceat(np.append(0, (np.diff(times) < 0) & (np.diff(codes) == 0)), starts)
        for i, start in enumerate(starts.tolist()):
            file_track = self.file_tracks[int(codes[start])]
            file_track.backward_steps += int(back[i]) + int(times[start] < file_track.last)
            file_track.first, file_track.last = (
                min(file_track.first, float(low[i])),
                max(file_track.last, float(high[i])),
            )

    def _buffer_rows(
        self,
        codes: NDArray[np.int32],
        times: Floats,
        positions: Floats,
        slots: Floats,
        kinds: tuple[int, ...],
    ) -> None:
        """Gather rows; a run holds columns of one kind each."""
        if kinds != self._buffer_kinds:
            self.write_run()
        self._buffer_kinds = kinds
        self._kinds.add(kinds)
        self._buffer.append((codes, np.column_stack([times, positions, slots])))
        self._buffered_rows += len(times)
        if self._buffered_rows >= self.rows:
            self.write_run()

    def write_run(self) -> None:
        """Write what was gathered as a sorted run."""
        if not self._buffered_rows:
            return
        codes, rows = (np.concatenate(columns) for columns in zip(*self._buffer, strict=True))
        self._buffer, self._buffered_rows = [], 0
        order = np.lexsort((rows[:, 0], codes))
        codes = codes[order]
        with (
            disk_errors_as_output_errors(),
            self._run_path(len(self._run_kinds)).open("wb") as file,
        ):
            write_numbers(rows[order], file)
        starts = np.flatnonzero(np.diff(codes, prepend=-1))
        for start, after in zip(starts.tolist(), [*starts[1:].tolist(), len(codes)], strict=True):
            file_track = self.file_tracks[int(codes[start])]
            file_track.run_ranges.append((len(self._run_kinds), start, after - start))
            file_track.count += after - start
        self._run_kinds.append(self._buffer_kinds)

    def _run_path(self, number: int) -> Path:
        return self.folder / f"run-{number}"

    def tracks(self, skip_bad: bool) -> Iterator[tuple[str, Iterator[Floats]]]:
        """Yield each track with its rows in the order of time, without those of a time that is there already, in blocks.

        Once all are through, the runs are gone.
        """
        tracks_by_name = self._group_by_track(skip_bad)
        for name, file_tracks in tracks_by_name.items():
            yield name, self._drop_doubles(name, file_tracks)
        for name, unusable in self._unusable.items():
            if name not in tracks_by_name:  # of no track, or of one that is gone
                points = unusable.count if name else self.points
                self.losses += loss_if_large(name, unusable.where, unusable.count, points)
        for number in range(len(self._run_kinds)):
            self._run_path(number).unlink()

    def _group_by_track(self, skip_bad: bool) -> dict[str, list[_FileTrack]]:
        """Parts of each track in the order of time; none may overlap another."""
        tracks_by_name: dict[str, list[_FileTrack]] = {}
        for number in self._accepted:
            file_track = self.file_tracks[number]
            file_tracks = tracks_by_name.setdefault(file_track.name, [])
            other = next(
                (
                    one
                    for one in file_tracks
                    if file_track.first < one.last and one.first < file_track.last
                ),
                None,
            )
            if other is None:
                file_tracks.append(file_track)
                continue
            error = InputError(
                f"{file_track.where}: track {file_track.name!r} overlaps in time with its part in {other.where}; rename one of them"
            )
            if not skip_bad:
                raise error
            self.errors.append(error)
            self._add_repair(
                Repair(
                    f"points of track {file_track.name!r} left out",
                    file_track.count,
                    file_track.where,
                )
            )
        for name in list(tracks_by_name):
            self._check_clock(name, tracks_by_name, skip_bad)
        return {
            name: sorted(file_tracks, key=lambda file_track: file_track.first)
            for name, file_tracks in tracks_by_name.items()
        }

    def _check_clock(
        self, name: str, tracks_by_name: dict[str, list[_FileTrack]], skip_bad: bool
    ) -> None:
        """Refuse a track whose points all have the same time, or leave it out."""
        # Is it one? Points at one place are one point.
        file_tracks = tracks_by_name[name]
        count, first = (
            sum(file_track.count for file_track in file_tracks),
            min(file_track.first for file_track in file_tracks),
        )
        if count < MIN_STOPPED_POSITIONS or first < max(
            file_track.last for file_track in file_tracks
        ):
            return
        blocks = (
            block[:, 1 : 1 + self.dimension]
            for file_track in file_tracks
            for block in self._sorted_blocks(file_track)
        )
        start = next(blocks)
        elsewhere = sum(
            int((block != start[0]).any(axis=1).sum()) for block in chain_of([start], blocks)
        )
        if elsewhere + 1 < MIN_STOPPED_POSITIONS:
            return

        # Say so.
        error = stopped_clock_error(file_tracks[0].where, name, count, first)
        if not skip_bad or len(tracks_by_name) == 1:
            raise error
        self.errors.append(error)
        self._add_repair(Repair(f"points of track {name!r} left out", count, file_tracks[0].where))
        del tracks_by_name[name]
        self._unusable.pop(name, None)

    def _drop_doubles(self, name: str, file_tracks: list[_FileTrack]) -> Iterator[Floats]:
        """Yield the rows of a track without those at a time that is there already."""
        unusable = self._unusable.get(name, _UnusableRows(file_tracks[0].where, 0))
        lost, shared, run = unusable.count, 0, 0
        last = np.full((1, self.width), -np.inf)  # the row of the time that came last
        for file_track in file_tracks:
            for every in self._sorted_blocks(file_track):
                # Compare with the row before the block, too.
                rows = np.concatenate([last, every])
                doubles = find_repeated_times(
                    rows[:, 0], rows[:, 1 : 1 + self.dimension], np.zeros(len(rows), np.bool_)
                )
                first = doubles.first

                # Count the others.
                where = f"{file_track.where}: track {name!r}"
                elsewhere = int(doubles.other_position.sum())
                if repeated := int(doubles.same_position[1:].sum()):
                    self._add_repair(Repair("repeated rows dropped", repeated, where))
                if elsewhere:
                    self._add_repair(
                        Repair(
                            "rows at another position, but the same time dropped", elsewhere, where
                        )
                    )
                together = np.bincount(np.cumsum(first) - 1, weights=doubles.other_position)
                together[0] += run
                shared, run, lost = (
                    max(shared, int(together.max())),
                    int(together[-1]),
                    lost + elsewhere,
                )

                last = rows[first][-1:]
                yield every[first[1:]] if elsewhere or repeated else every
        points = unusable.count + sum(file_track.count for file_track in file_tracks)
        self.losses += loss_if_large(
            name, unusable.where, lost, points, shared + 1 if shared else 0
        )

    def _sorted_blocks(self, file_track: _FileTrack) -> Iterator[Floats]:
        """Samples of a part in the order of time, in blocks that fit in memory."""
        if file_track.backward_steps == 0 or len(file_track.run_ranges) == 1:
            for run, row, count in file_track.run_ranges:
                for a in range(0, count, self.rows):
                    yield self._read_run(run, row + a, min(self.rows, count - a))
            return
        share = max(self.rows // len(file_track.run_ranges), 1)
        heads = [np.empty((0, self.width)) for _ in file_track.run_ranges]
        done = [0] * len(file_track.run_ranges)
        while True:
            for i, (run, row, count) in enumerate(file_track.run_ranges):
                if not len(heads[i]) and done[i] < count:
                    heads[i] = self._read_run(run, row + done[i], min(share, count - done[i]))
                    done[i] += len(heads[i])
            open_ = [
                heads[i][-1, 0]
                for i, (_, _, count) in enumerate(file_track.run_ranges)
                if done[i] < count and len(heads[i])
            ]
            limit = min(open_, default=np.inf)
            cuts = [int(np.searchsorted(head[:, 0], limit, side="right")) for head in heads]
            block = np.concatenate([head[:cut] for head, cut in zip(heads, cuts, strict=True)])
            heads = [head[cut:] for head, cut in zip(heads, cuts, strict=True)]
            if not len(block):
                return
            yield block[np.argsort(block[:, 0], kind="stable")]

    def _read_run(self, run: int, row: int, count: int) -> Floats:
        rows, own = read_rows(self._run_path(run), row, count, self.width), 1 + self.dimension
        if not self.column_encoder.names:
            return rows
        return np.concatenate(
            [rows[:, :own], self.column_encoder.convert(rows[:, own:], self._run_kinds[run])],
            axis=1,
        )


def coordinate_names(contents: tuple[bool, int, str]) -> str:
    """What messages call coordinates."""
    return "lat,lon" if contents[0] else ",".join("xyz"[: contents[1]])


def read_rows(path: Path, row: int, count: int, width: int) -> Floats:
    """Rows of a file of float64 numbers."""
    return read_numbers(path, np.float64, row * width, count * width).reshape(count, width)
