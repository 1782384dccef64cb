"""Logs of any size in bounded memory: one pass sorts all samples by track and time into a file, from which any stretch is read.

Rows of different tracks may be interleaved, and a track may be spread over several files in any order. Batches are gathered up to a
number of rows, sorted and written as a run; then the runs of each track are put one after the other, or merged where a file's
rows were not in order. The files lie in a temporary folder, which goes when the log is closed.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.columns import parse_columns
from gpszip.io.raw_log import RawLog, Request, unused
from gpszip.io.shards import Shard, shard_of
from gpszip.io.source import expand
from gpszip.model import Plane, Track
from gpszip.model.reading import LeftOut, Reading, Repair

__all__ = ["StoredLog", "StoredTrack", "count_rows", "store_logs"]

#: Samples from which the plane is chosen, and cells of so many degrees of which each has one besides.
_SAMPLE, _CELL = 1 << 20, 0.5

#: More than this share of positions off the globe is not noise, but another kind of coordinates.
_STRAYS = 0.01

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StoredTrack:
    """Where the samples of a track lie in the file: ``count`` rows from ``offset`` on."""

    id: str
    offset: int
    count: int


@dataclass(eq=False)
class StoredLog:
    """All samples of a log in a temporary file, sorted by track and time, on one common plane.

    Use it as a context: the file is removed at the end.

    Parameters
    ----------
    tracks : tuple of StoredTrack
        In the order in which the logs first name them.
    reading : Reading
        The account of what was read, without the tracks.
    dimension : int
        Number of coordinates d.
    plane : Plane, optional
        Where positions lie on the earth.
    """

    tracks: tuple[StoredTrack, ...]
    reading: Reading
    dimension: int
    plane: Plane | None
    _path: Path
    _room: ExitStack

    def __enter__(self) -> StoredLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._room.close()

    @property
    def samples(self) -> int:
        """Number of samples of all tracks."""
        return sum(track.count for track in self.tracks)

    def read(self, track: StoredTrack, first: int = 0, last: int | None = None) -> Track:
        """Samples ``first`` to ``last - 1`` of a track; all where left out."""
        last = track.count if last is None else last
        rows = _read(self._path, track.offset + first, last - first, 1 + self.dimension)
        return Track(track.id, rows[:, 0], rows[:, 1:], plane=self.plane)


def count_rows(sources: Any, *, format: str | None = None, columns: Any = None) -> int:
    """Count the rows of logs: exactly where a file tells, else as its size lets expect. Files that can't be read count nothing."""
    total = 0
    for source in expand(sources):
        shard = source if isinstance(source, InputError) else shard_of(source, format, Request(parse_columns(columns)))
        if isinstance(shard, Shard):
            rows = shard.rows()
            total += rows if rows is not None else shard.source.size // (6 if shard.source.packed else 24)
    return total


def store_logs(
    sources: str | Path | BinaryIO | Iterable[str | Path | BinaryIO],
    *,
    rows: int,
    format: str | None = None,
    columns: str | Sequence[str] | Mapping[str, str] | None = None,
    time_unit: str | None = None,
    sort: bool = False,
    split: bool = False,
    skip_bad: bool = False,
) -> StoredLog:
    r"""Sort position logs of any size into a temporary file.

    Parameters
    ----------
    sources : str, Path, binary stream, or iterable of these
        As for :func:`gpszip.io.reading.read_logs`.
    rows : int
        How many rows may be in memory at once; each takes about 100 bytes.
    format, columns, time_unit, sort, split, skip_bad
        As for :func:`gpszip.io.reading.read_logs`.

    Returns
    -------
    StoredLog
        A context.

    Raises
    ------
    InputError
        If a file can't be read, holds other columns or another coordinate system than those before it, or the times of one
        track in two files overlap. With ``skip_bad``, such files are left out instead; of overlapping ones, those that come
        later.

    Examples
    --------
    >>> import io
    >>> with store_logs(io.BytesIO(b"track_id,t,x,y\nb,0,0,0\na,5,1,1\nb,1,2,2\n"), rows=100) as log:
    ...     [(track.id, log.read(track).times.tolist()) for track in log.tracks]
    [('b', [0.0, 1.0]), ('a', [5.0])]
    """
    if sort and split:
        raise OptionError("--sort and --split exclude each other")
    request = Request(parse_columns(columns), time_unit)
    shards, size, errors = _planned(sources, format, request, skip_bad)
    with ExitStack() as stack:
        room = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="gpszip-")))
        sorter = _Sorter(room, max(rows, 1000), sort, split)
        sorter.errors += errors
        alone = len({shard.source.log for shard in shards}) == 1
        for shard in shards:
            _take_in(sorter, shard, alone=alone, skip_bad=skip_bad)
        sorter.flush()
        tracks = sorter.finish(skip_bad)
        reading = Reading(
            (), sorter.points, size, sorter.geographic, tuple(sorter.repairs), tuple(sorter.left_out()), tuple(sorter.dropped)
        )
        return StoredLog(tracks, reading, sorter.dimension, sorter.plane, room / "samples", stack.pop_all())


def _planned(sources: Any, format_: str | None, request: Request, skip_bad: bool) -> tuple[list[Shard], int, list[InputError]]:
    """All files whose heads can be read and fit together; refused before any row is read."""
    shards: list[Shard] = []
    errors: list[InputError] = []
    size = 0
    for source in expand(sources):
        shard = source if isinstance(source, InputError) else shard_of(source, format_, request)
        error = shard if isinstance(shard, InputError) else _misfit(shard, shards)
        if error is not None and not skip_bad:
            raise error
        if error is not None:
            errors.append(error)
        elif isinstance(shard, Shard):
            shards.append(shard)
            size += shard.source.size
    if not shards:
        raise errors[0] if errors else InputError("no log given; name a file, a folder of Parquet or a pattern")
    return shards, size, errors


def _misfit(shard: Shard, before: Sequence[Shard]) -> InputError | None:
    first = next((other for other in before if other.contents is not None), None)
    if first is None or shard.contents is None or first.contents is None or shard.contents == first.contents:
        return None
    if shard.contents[:2] == first.contents[:2]:
        return InputError(f"{shard.name}: names another coordinate system than {first.name}; bring them to one, or read them apart")
    return InputError(f"{shard.name}: holds {_kind(shard.contents)}, but {first.name} {_kind(first.contents)}; read them apart")


def _kind(contents: tuple[bool, int, str]) -> str:
    return "lat,lon" if contents[0] else ",".join("xyz"[: contents[1]])


def _take_in(sorter: _Sorter, shard: Shard, *, alone: bool, skip_bad: bool) -> None:
    sorter.begin(shard, "0" if alone else shard.source.stem)
    try:
        for raw in shard.batches():
            sorter.add(raw)
        sorter.end()
    except InputError as error:
        if not skip_bad:
            raise
        sorter.errors.append(error)
        sorter.drop_shard()


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


class _Sorter:
    """Gathers rows, writes them as sorted runs, and at last as one sorted file."""

    def __init__(self, room: Path, rows: int, sort: bool, split: bool) -> None:
        self.room, self.rows, self.sort, self.split = room, rows, sort, split
        self.parts: list[_Part] = []
        self.errors: list[InputError] = []
        self.repairs: list[Repair] = []
        self.dropped: dict[str, None] = {}
        self.points, self.dimension, self.geographic = 0, 0, False
        self.plane: Plane | None = None
        self._alive: list[int] = []
        self._own: dict[str, int] = {}  # the part that each name of the present file stands for
        self._here: list[int] = []  # all of its parts, and those that keep their names
        self._first: set[int] = set()
        self._shard: tuple[Shard, str] | None = None
        self._before: tuple[int, list[Repair]] = (0, [])
        self._held: list[tuple[NDArray[np.int32], Floats, Floats]] = []
        self._gathered = self._runs = self._usable = 0
        self._sample = _Sample()

    def begin(self, shard: Shard, stem: str) -> None:
        self._shard, self._own, self._here, self._first, self._usable = (shard, stem), {}, [], set(), 0
        self._before = (self.points, list(self.repairs))

    def end(self) -> None:
        """Refuse a file of which no row can be used, and one whose times go back."""
        assert self._shard is not None
        name = self._shard[0].name
        if not self._usable:
            raise InputError(f"{name}: no row has a time and position that can be read; name the columns: --columns t=COLUMN,...")
        for number in self._here:
            part = self.parts[number]
            if part.back and not self.sort:
                raise InputError(f"{name}: time goes back in track {part.name!r}; --sort orders the points, --split starts a new track")
            if part.back:
                self.repairs.append(Repair("points put in the order of time", part.back, name, drops=False))
        taken = set(self._own)
        for part in (self.parts[number] for number in self._here if number not in self._first):
            part.name = unused(part.name, taken)
            taken.add(part.name)
        self._alive += self._here

    def drop_shard(self) -> None:
        """Forget what the present file has brought."""
        self.points, self.repairs = self._before[0], self._before[1]

    def left_out(self) -> Iterator[LeftOut]:
        for error in self.errors:
            name, _, reason = str(error).partition(": ")
            yield LeftOut(name, reason)

    def add(self, raw: RawLog) -> None:
        """Take in a batch; rows that can't be used are dropped and counted."""
        self._check_kind(raw)
        self.points += len(raw.times) + sum(repair.count for repair in raw.repairs if repair.drops)
        self.repairs += raw.repairs
        self.dropped |= dict.fromkeys(raw.dropped)
        good = self._usable_rows(raw)
        self._usable += int(good.sum())
        times, places = raw.times[good], raw.coordinates[good]
        codes = self._codes(raw, good)
        if self.split:
            codes = self._split(codes, times, f"{raw.name}: {raw.word} {raw.first}")
        self._count(codes, times)
        if raw.geographic:
            self._sample.add(places)
        self._held.append((codes, times, places))
        self._gathered += len(times)
        if self._gathered >= self.rows:
            self.flush()

    def _check_kind(self, raw: RawLog) -> None:
        own = (raw.geographic, raw.coordinates.shape[1])
        if self.dimension and own != (self.geographic, self.dimension):
            raise InputError(f"{raw.name}: holds {_kind((*own, ''))}, but the logs before {_kind((self.geographic, self.dimension, ''))}")
        self.geographic, self.dimension = own

    def _usable_rows(self, raw: RawLog) -> NDArray[np.bool_]:
        timed = np.isfinite(raw.times)
        placed = np.asarray(np.isfinite(raw.coordinates).all(axis=1))
        self._repair(raw, "rows without a time dropped", ~timed)
        self._repair(raw, "rows without a position dropped", timed & ~placed)
        good: NDArray[np.bool_] = timed & placed
        if raw.geographic:
            lat, lon = raw.coordinates[:, 0], raw.coordinates[:, 1]
            off = good & ((np.abs(lat) > 90) | (lon < -180) | (lon > 360))
            if off.sum() > _STRAYS * max(good.sum(), 1):
                at = int(off.argmax())
                raise InputError(
                    f"{raw.name}: {raw.word} {raw.first + at}: latitude {lat[at]:g}, longitude {lon[at]:g}: not degrees; "
                    "name the right columns with --columns"
                )
            self._repair(raw, "rows off the globe dropped", off)
            good &= ~off
        return good

    def _repair(self, raw: RawLog, what: str, rows: NDArray[np.bool_]) -> None:
        lost = int(rows.sum())
        if lost:
            self._add_repair(Repair(what, lost, f"{raw.name}: {raw.word} {raw.first + int(rows.argmax())}"))

    def _add_repair(self, new: Repair) -> None:
        """Count on where the same was mended in the same file before."""
        name = new.where.split(": ")[0]
        for i, old in enumerate(self.repairs):
            if old.what == new.what and old.where.split(": ")[0] == name:
                self.repairs[i] = Repair(old.what, old.count + new.count, old.where, old.drops)
                return
        self.repairs.append(new)

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

    def flush(self) -> None:
        """Write what was gathered as a sorted run."""
        if not self._gathered:
            return
        codes, times, places = (np.concatenate(columns) for columns in zip(*self._held, strict=True))
        self._held, self._gathered = [], 0
        order = np.lexsort((times, codes))
        codes = codes[order]
        with self._run(self._runs).open("wb") as file:
            np.column_stack([times[order], places[order]]).tofile(file)
        starts = np.flatnonzero(np.diff(codes, prepend=-1))
        for start, after in zip(starts.tolist(), [*starts[1:].tolist(), len(codes)], strict=True):
            part = self.parts[int(codes[start])]
            part.slices.append((self._runs, start, after - start))
            part.count += after - start
        self._runs += 1

    def _run(self, number: int) -> Path:
        return self.room / f"run-{number}"

    def finish(self, skip_bad: bool) -> tuple[StoredTrack, ...]:
        """Write the samples of each track one after the other, on their plane, without those of a time that is there already."""
        chains = self._chains(skip_bad)
        self.plane = self._sample.plane() if self.geographic else None
        tracks, offset = [], 0
        with (self.room / "samples").open("wb") as file:
            for name, chain in chains.items():
                count = self._write(name, chain, file)
                tracks.append(StoredTrack(name, offset, count))
                offset += count
        for number in range(self._runs):
            self._run(number).unlink()
        if not tracks:
            raise self.errors[0] if self.errors else InputError("no log holds a sample")
        return tuple(tracks)

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
        return {name: sorted(chain, key=lambda part: part.first) for name, chain in chains.items()}

    def _write(self, name: str, chain: list[_Part], file: Any) -> int:
        count, last = 0, -np.inf
        for part in chain:
            for every in self._blocks(part):
                fresh = np.diff(every[:, 0], prepend=last) > 0
                last = float(every[-1, 0])
                block = every[fresh]
                if len(block) < len(every):
                    lost = len(every) - len(block)
                    self._add_repair(Repair("rows at a time that the track has already dropped", lost, f"{part.where}: track {name!r}"))
                if self.plane is not None:
                    block[:, 1:] = to_plane(block[:, 1], block[:, 2], self.plane)
                block.tofile(file)
                count += len(block)
        return count

    def _blocks(self, part: _Part) -> Iterator[Floats]:
        """Samples of a part in the order of time, in blocks that fit in memory."""
        width = 1 + self.dimension
        if part.back == 0 or len(part.slices) == 1:
            for run, row, count in part.slices:
                for a in range(0, count, self.rows):
                    yield _read(self._run(run), row + a, min(self.rows, count - a), width)
            return
        share = max(self.rows // len(part.slices), 1)
        heads = [np.empty((0, width)) for _ in part.slices]
        done = [0] * len(part.slices)
        while True:
            for i, (run, row, count) in enumerate(part.slices):
                if not len(heads[i]) and done[i] < count:
                    heads[i] = _read(self._run(run), row + done[i], min(share, count - done[i]), width)
                    done[i] += len(heads[i])
            open_ = [heads[i][-1, 0] for i, (_, _, count) in enumerate(part.slices) if done[i] < count and len(heads[i])]
            limit = min(open_, default=np.inf)
            cuts = [int(np.searchsorted(head[:, 0], limit, side="right")) for head in heads]
            block = np.concatenate([head[:cut] for head, cut in zip(heads, cuts, strict=True)])
            heads = [head[cut:] for head, cut in zip(heads, cuts, strict=True)]
            if not len(block):
                return
            yield block[np.argsort(block[:, 0], kind="stable")]


class _Sample:
    """A share of all positions, and one of each place where there are any, from which the planes are chosen."""

    def __init__(self) -> None:
        self._kept: list[Floats] = []
        self._stride, self._seen, self._count = 1, 0, 0
        self._cells: dict[tuple[int, int], Floats] = {}

    def add(self, degrees: Floats) -> None:
        own = degrees[-self._seen % self._stride :: self._stride]
        self._seen += len(degrees)
        self._kept.append(own.copy())
        self._count += len(own)
        cells = np.floor(degrees / _CELL).astype(np.int64)
        _, first = np.unique(cells[:, 0] * 10_000 + cells[:, 1], return_index=True)
        for i in first.tolist():
            self._cells.setdefault((int(cells[i, 0]), int(cells[i, 1])), degrees[i].copy())
        if self._count > _SAMPLE:
            self._kept = [np.concatenate(self._kept)[::2]]
            self._count, self._stride = len(self._kept[0]), 2 * self._stride

    def plane(self) -> Plane:
        degrees = np.concatenate([*self._kept, *(place[None] for place in self._cells.values())])
        return choose_plane(degrees[:, 0], degrees[:, 1])


def _read(path: Path, row: int, count: int, width: int) -> Floats:
    return np.fromfile(path, np.float64, count * width, offset=8 * row * width).reshape(count, width)
