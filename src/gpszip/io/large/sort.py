"""Sorting rows that don't fit in memory by track and time: batches become sorted runs, which are merged track by track."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain as chain_of
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.large.batches import Shard
from gpszip.io.large.columns import Slots
from gpszip.io.large.plane_sample import PlaneSample
from gpszip.io.logs.clean import first_unread, said, value_of
from gpszip.io.logs.globe import GlobeCheck, at_zero, off_globe_value
from gpszip.io.logs.losses import MIDNIGHT, STOPPED, find_doubles, loss_of, stopped_clock
from gpszip.io.logs.raw import RawLog, Unread, unused
from gpszip.io.storage.temporary import read_numbers, write_numbers, writing
from gpszip.model.read_result import LeftOut, Loss, Repair

__all__ = ["Sorter", "kind_of", "read_rows"]

Floats = NDArray[np.float64]


@dataclass
class _Part:
    """What one file holds of one track."""

    name: str
    where: str
    count: int = 0
    first: float = np.inf
    last: float = -np.inf
    back: int = 0
    slices: list[tuple[int, int, int]] = field(default_factory=list)  # run, row, rows


@dataclass(frozen=True)
class _Unusable:
    """Rows of a track that can't be used, and the first file that has some."""

    where: str
    count: int


class Sorter:
    """Gathers rows, writes them as sorted runs, and at last yields those of each track in the order of time.

    Parameters
    ----------
    room : Path
        Folder for the runs.
    rows : int
        How many rows may be in memory at once.
    sort, split : bool
        What to do where time goes back.
    slots : Slots
        The further columns of rows, which lie in the last columns of a block.
    skip_bad : bool
        Leave out positions off the globe even where they are many.
    clean : bool
        Drop positions at 0,0 that were hardly measured.
    """

    def __init__(
        self, room: Path, rows: int, sort: bool, split: bool, slots: Slots, *, skip_bad: bool = False, clean: bool = False
    ) -> None:
        self.skip_bad, self.clean = skip_bad, clean
        self.room, self.rows, self.sort, self.split, self.slots = room, rows, sort, split, slots
        self.parts: list[_Part] = []
        self.errors: list[InputError] = []
        self.repairs: list[Repair] = []
        self.losses: list[Loss] = []
        self.dropped: dict[str, None] = {}
        self.points, self.dimension, self.geographic = 0, 0, False
        self._alive: list[int] = []
        self._own: dict[str, int] = {}  # the part that each name of the present file stands for
        self._here: list[int] = []  # all of its parts, and those that keep their names
        self._first: set[int] = set()
        self._shard: tuple[Shard, str] | None = None
        self._parts_left_out: list[LeftOut] = []
        self._before: tuple[int, list[Repair], list[LeftOut], dict[str, _Unusable]] = (0, [], [], {})
        self._unusable: dict[str, _Unusable] = {}
        self._clocks = False  # whether the present file has times of day without dates
        self._held: list[tuple[NDArray[np.int32], Floats]] = []
        self._kinds: set[tuple[int, ...]] = set()  # those of the present file's columns
        self._held_kinds: tuple[int, ...] = ()
        self._runs: list[tuple[int, ...]] = []  # kinds of each run's columns
        self._gathered = self._usable = self._seen = 0
        self._globe = GlobeCheck()  # of the present file, as is what can't be read in it
        self._unread: tuple[Unread, ...] = ()
        self.sample = PlaneSample()

    @property
    def width(self) -> int:
        """Numbers in a row: time, coordinates, further columns."""
        return 1 + self.dimension + len(self.slots.names)

    @property
    def empty(self) -> bool:
        """Whether no file has brought a row."""
        return not self._alive

    def begin(self, shard: Shard, stem: str) -> None:
        """Expect the rows of a file, whose track has this name if it names none."""
        self._shard, self._own, self._here, self._first, self._usable = (shard, stem), {}, [], set(), 0
        self._kinds, self._seen, self._clocks = set(), 0, False
        self._globe, self._unread = GlobeCheck(), ()
        self._before = (self.points, list(self.repairs), list(self._parts_left_out), dict(self._unusable))

    def end(self) -> None:
        """Refuse a file of which no row can be used, and one whose times go back."""
        assert self._shard is not None
        name = self._shard[0].name
        if not self._seen:
            raise InputError(f"{name}: columns, but no rows")
        self._globe.check(skip_bad=self.skip_bad)
        if not self._usable:
            raise InputError(
                f"{name}: no row has a time and position that can be read{said(self._unread)}; name the columns: --columns t=COLUMN,..."
            )
        for number in self._here:
            part = self.parts[number]
            if part.back and self._clocks:
                raise InputError(f"{name}: track {part.name!r}: {MIDNIGHT}")
            if part.back and not self.sort:
                raise InputError(f"{name}: time goes back in track {part.name!r}; --sort orders the points, --split starts a new track")
            if part.back:
                self.repairs.append(Repair("points put in the order of time", part.back, name, drops=False))
        taken = set(self._own)
        for part in (self.parts[number] for number in self._here if number not in self._first):
            part.name = unused(part.name, taken)
            taken.add(part.name)
        self._alive += self._here
        self.slots.join(list(self._kinds))

    def drop_shard(self) -> None:
        """Forget what the present file has brought."""
        self.points, self.repairs, self._parts_left_out, self._unusable = self._before

    def left_out(self) -> Iterator[LeftOut]:
        """Yield what was left out, and why: parts of files first, then whole files."""
        yield from self._parts_left_out
        for error in self.errors:
            name, _, reason = str(error).partition(": ")
            yield LeftOut(name, reason)

    def add(self, raw: RawLog) -> None:
        """Take in a batch; rows that can't be used are dropped and counted."""
        self._check_kind(raw)
        self.points += len(raw.times) + sum(repair.count for repair in raw.repairs if repair.drops)
        for repair in raw.repairs:
            self._add_repair(repair)
        self._clocks |= raw.time_of_day
        self._parts_left_out += raw.left_out
        self.dropped |= dict.fromkeys(raw.dropped)
        good = self._usable_rows(raw)
        self._usable += int(good.sum())
        self._seen += len(good)
        self._note_unusable(raw, good)
        times, places = raw.times[good], raw.coordinates[good]
        codes = self._codes(raw, good)
        if self.split:
            codes = self._split(codes, times, f"{raw.name}: {raw.word} {raw.first}")
        self._count(codes, times)
        if raw.geographic:
            self.sample.add(places)
        self._hold(codes, times, places, *self.slots.fill(raw.attributes, good, raw.name))

    def _check_kind(self, raw: RawLog) -> None:
        own = (raw.geographic, raw.coordinates.shape[1])
        if self.dimension and own != (self.geographic, self.dimension):
            raise InputError(
                f"{raw.name}: holds {kind_of((*own, ''))}, but the logs before {kind_of((self.geographic, self.dimension, ''))}"
            )
        self.geographic, self.dimension = own

    def _usable_rows(self, raw: RawLog) -> NDArray[np.bool_]:
        timed = np.isfinite(raw.times)
        placed = np.asarray(np.isfinite(raw.coordinates).all(axis=1))
        self._unread = self._unread or raw.unread
        no_time, no_place = first_unread(raw)
        self._repair(raw, f"{raw.word}s without a time dropped", ~timed, no_time)
        self._repair(raw, f"{raw.word}s without a position dropped", timed & ~placed, no_place)
        good: NDArray[np.bool_] = timed & placed
        return self._on_globe(raw, good) if raw.geographic else good

    def _on_globe(self, raw: RawLog, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Drop positions off the globe, whose number is checked at the end of the file, and those at 0,0."""
        rows = np.flatnonzero(good)
        off = np.zeros_like(good)
        off[rows] = self._globe.find(raw.coordinates[rows], rows + raw.first, f"{raw.name}: {raw.word}")
        value = off_globe_value(raw.coordinates[int(off.argmax())]) if off.any() else ""
        self._repair(raw, f"{raw.word}s off the globe dropped", off, value=value)
        good = good & ~off

        rows = np.flatnonzero(good)
        zero = np.zeros_like(good)
        zero[rows] = at_zero(raw.coordinates[rows])
        kept = f"{raw.word}s at 0,0 kept, though hardly measured; --clean drops them"
        self._repair(raw, f"{raw.word}s at 0,0 dropped" if self.clean else kept, zero, drops=self.clean)
        return good & ~zero if self.clean else good

    def _repair(
        self, raw: RawLog, what: str, rows: NDArray[np.bool_], cell: Unread | None = None, *, value: str = "", drops: bool = True
    ) -> None:
        lost = int(rows.sum())
        if lost:
            first = int(rows.argmax()) if cell is None else cell.row
            value = value if cell is None else value_of(cell)
            self._add_repair(Repair(what, lost, f"{raw.name}: {raw.word} {raw.first + first}", drops, value))

    def _add_repair(self, new: Repair) -> None:
        """Count on where the same was mended in the same file before."""
        name = new.where.split(": ")[0]
        for i, old in enumerate(self.repairs):
            if old.what == new.what and old.where.split(": ")[0] == name:
                named = old if old.value or not new.value else new
                self.repairs[i] = replace(named, count=old.count + new.count)
                return
        self.repairs.append(new)

    def _note_unusable(self, raw: RawLog, good: NDArray[np.bool_]) -> None:
        """Count the rows that can't be used by the track that they are of, those that belong to none by the file."""
        assert self._shard is not None
        before = sum(repair.count for repair in raw.repairs if repair.drops)
        counts = {"": before} if before else {}
        if raw.codes is None and not good.all():
            counts[self._shard[1]] = int((~good).sum())
        elif raw.codes is not None:
            bad = np.bincount(raw.codes[~good], minlength=len(raw.ids))
            counts |= {raw.ids[code]: int(bad[code]) for code in np.flatnonzero(bad).tolist()}
        for name, count in counts.items():
            old = self._unusable.get(name, _Unusable(raw.name, 0))
            self._unusable[name] = _Unusable(old.where, old.count + count)

    def _codes(self, raw: RawLog, good: NDArray[np.bool_]) -> NDArray[np.int32]:
        assert self._shard is not None
        if raw.codes is None:
            return np.full(int(good.sum()), self._part(self._shard[1], raw.name), np.int32)
        used = raw.codes[good]
        number = np.zeros(len(raw.ids), np.int32)
        for code in np.unique(used).tolist():
            number[code] = self._part(raw.ids[code], raw.name)
        codes: NDArray[np.int32] = number[used]
        return codes

    def _part(self, name: str, where: str) -> int:
        if name not in self._own:
            self._own[name] = self._new(name, where)
            self._first.add(self._own[name])
        return self._own[name]

    def _new(self, name: str, where: str) -> int:
        self.parts.append(_Part(name, where))
        self._here.append(len(self.parts) - 1)
        return self._here[-1]

    def _split(self, codes: NDArray[np.int32], times: Floats, where: str) -> NDArray[np.int32]:
        """Give rows from where a track's time goes back to a new part, which gets its own name at the end of the file."""
        split = codes.copy()
        for code in np.unique(codes).tolist():
            rows = np.flatnonzero(codes == code)
            part = self.parts[code]
            back = np.flatnonzero(np.diff(times[rows], prepend=part.last) < 0).tolist()
            for first, after in zip(back, [*back[1:], len(rows)], strict=True):
                self._own[part.name] = number = self._new(part.name, part.where)
                split[rows[first:after]] = number
            if back:
                self._add_repair(Repair("tracks started where time goes back", len(back), where, drops=False))
        return split

    def _count(self, codes: NDArray[np.int32], times: Floats) -> None:
        """Keep the extent of each part, and how often its times go back."""
        if not len(codes):
            return
        order = np.argsort(codes, kind="stable")
        codes, times = codes[order], times[order]
        starts = np.flatnonzero(np.diff(codes, prepend=-1))
        low, high = np.minimum.reduceat(times, starts), np.maximum.reduceat(times, starts)
        back = np.add.reduceat(np.append(0, (np.diff(times) < 0) & (np.diff(codes) == 0)), starts)
        for i, start in enumerate(starts.tolist()):
            part = self.parts[int(codes[start])]
            part.back += int(back[i]) + int(times[start] < part.last)
            part.first, part.last = min(part.first, float(low[i])), max(part.last, float(high[i]))

    def _hold(self, codes: NDArray[np.int32], times: Floats, places: Floats, slots: Floats, kinds: tuple[int, ...]) -> None:
        """Gather rows; a run holds columns of one kind each."""
        if kinds != self._held_kinds:
            self.flush()
        self._held_kinds = kinds
        self._kinds.add(kinds)
        self._held.append((codes, np.column_stack([times, places, slots])))
        self._gathered += len(times)
        if self._gathered >= self.rows:
            self.flush()

    def flush(self) -> None:
        """Write what was gathered as a sorted run."""
        if not self._gathered:
            return
        codes, rows = (np.concatenate(columns) for columns in zip(*self._held, strict=True))
        self._held, self._gathered = [], 0
        order = np.lexsort((rows[:, 0], codes))
        codes = codes[order]
        with writing(), self._run(len(self._runs)).open("wb") as file:
            write_numbers(rows[order], file)
        starts = np.flatnonzero(np.diff(codes, prepend=-1))
        for start, after in zip(starts.tolist(), [*starts[1:].tolist(), len(codes)], strict=True):
            part = self.parts[int(codes[start])]
            part.slices.append((len(self._runs), start, after - start))
            part.count += after - start
        self._runs.append(self._held_kinds)

    def _run(self, number: int) -> Path:
        return self.room / f"run-{number}"

    def tracks(self, skip_bad: bool) -> Iterator[tuple[str, Iterator[Floats]]]:
        """Yield each track with its rows in the order of time, without those of a time that is there already, in blocks.

        Once all are through, the runs are gone.
        """
        chains = self._chains(skip_bad)
        for name, chain in chains.items():
            yield name, self._fresh(name, chain)
        for name, unusable in self._unusable.items():
            if name not in chains:  # of no track, or of one that is gone
                points = unusable.count if name else self.points
                self.losses += loss_of(name, unusable.where, unusable.count, points)
        for number in range(len(self._runs)):
            self._run(number).unlink()

    def _chains(self, skip_bad: bool) -> dict[str, list[_Part]]:
        """Parts of each track in the order of time; none may overlap another."""
        chains: dict[str, list[_Part]] = {}
        for number in self._alive:
            part = self.parts[number]
            chain = chains.setdefault(part.name, [])
            other = next((one for one in chain if part.first < one.last and one.first < part.last), None)
            if other is None:
                chain.append(part)
                continue
            error = InputError(f"{part.where}: track {part.name!r} overlaps in time with its part in {other.where}; rename one of them")
            if not skip_bad:
                raise error
            self.errors.append(error)
            self._add_repair(Repair(f"points of track {part.name!r} left out", part.count, part.where))
        for name in list(chains):
            self._check_clock(name, chains, skip_bad)
        return {name: sorted(chain, key=lambda part: part.first) for name, chain in chains.items()}

    def _check_clock(self, name: str, chains: dict[str, list[_Part]], skip_bad: bool) -> None:
        """Refuse a track whose points all have the same time, or leave it out."""
        # Is it one? Points at one place are one point.
        chain = chains[name]
        count, first = sum(part.count for part in chain), min(part.first for part in chain)
        if count < STOPPED or first < max(part.last for part in chain):
            return
        blocks = (block[:, 1 : 1 + self.dimension] for part in chain for block in self._blocks(part))
        start = next(blocks)
        elsewhere = sum(int((block != start[0]).any(axis=1).sum()) for block in chain_of([start], blocks))
        if elsewhere + 1 < STOPPED:
            return

        # Say so.
        error = stopped_clock(chain[0].where, name, count, first)
        if not skip_bad or len(chains) == 1:
            raise error
        self.errors.append(error)
        self._add_repair(Repair(f"points of track {name!r} left out", count, chain[0].where))
        del chains[name]
        self._unusable.pop(name, None)

    def _fresh(self, name: str, chain: list[_Part]) -> Iterator[Floats]:
        """Yield the rows of a track without those at a time that is there already."""
        unusable = self._unusable.get(name, _Unusable(chain[0].where, 0))
        lost, shared, run = unusable.count, 0, 0
        last = np.full((1, self.width), -np.inf)  # the row of the time that came last
        for part in chain:
            for every in self._blocks(part):
                # Compare with the row before the block, too.
                rows = np.concatenate([last, every])
                doubles = find_doubles(rows[:, 0], rows[:, 1 : 1 + self.dimension], np.zeros(len(rows), np.bool_))
                first = doubles.first

                # Count the others.
                where = f"{part.where}: track {name!r}"
                elsewhere = int(doubles.elsewhere.sum())
                if repeated := int(doubles.repeated[1:].sum()):
                    self._add_repair(Repair("repeated rows dropped", repeated, where))
                if elsewhere:
                    self._add_repair(Repair("rows at another position, but the same time dropped", elsewhere, where))
                together = np.bincount(np.cumsum(first) - 1, weights=doubles.elsewhere)
                together[0] += run
                shared, run, lost = max(shared, int(together.max())), int(together[-1]), lost + elsewhere

                last = rows[first][-1:]
                yield every[first[1:]] if elsewhere or repeated else every
        points = unusable.count + sum(part.count for part in chain)
        self.losses += loss_of(name, unusable.where, lost, points, shared + 1 if shared else 0)

    def _blocks(self, part: _Part) -> Iterator[Floats]:
        """Samples of a part in the order of time, in blocks that fit in memory."""
        if part.back == 0 or len(part.slices) == 1:
            for run, row, count in part.slices:
                for a in range(0, count, self.rows):
                    yield self._rows(run, row + a, min(self.rows, count - a))
            return
        share = max(self.rows // len(part.slices), 1)
        heads = [np.empty((0, self.width)) for _ in part.slices]
        done = [0] * len(part.slices)
        while True:
            for i, (run, row, count) in enumerate(part.slices):
                if not len(heads[i]) and done[i] < count:
                    heads[i] = self._rows(run, row + done[i], min(share, count - done[i]))
                    done[i] += len(heads[i])
            open_ = [heads[i][-1, 0] for i, (_, _, count) in enumerate(part.slices) if done[i] < count and len(heads[i])]
            limit = min(open_, default=np.inf)
            cuts = [int(np.searchsorted(head[:, 0], limit, side="right")) for head in heads]
            block = np.concatenate([head[:cut] for head, cut in zip(heads, cuts, strict=True)])
            heads = [head[cut:] for head, cut in zip(heads, cuts, strict=True)]
            if not len(block):
                return
            yield block[np.argsort(block[:, 0], kind="stable")]

    def _rows(self, run: int, row: int, count: int) -> Floats:
        rows, own = read_rows(self._run(run), row, count, self.width), 1 + self.dimension
        if not self.slots.names:
            return rows
        return np.concatenate([rows[:, :own], self.slots.alike(rows[:, own:], self._runs[run])], axis=1)


def kind_of(contents: tuple[bool, int, str]) -> str:
    """What messages call coordinates."""
    return "lat,lon" if contents[0] else ",".join("xyz"[: contents[1]])


def read_rows(path: Path, row: int, count: int, width: int) -> Floats:
    """Rows of a file of float64 numbers."""
    return read_numbers(path, np.float64, row * width, count * width).reshape(count, width)
