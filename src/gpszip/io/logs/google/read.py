"""Location histories of Google: what phones measured, or else the paths that Google made of it.

Histories are read in batches, so they may be larger than memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gpszip.errors import InputError, NoPositionsError
from gpszip.io.logs.google.entries import (
    DEVICE_LISTS,
    LISTS,
    RAW_LISTS,
    Position,
    positions_in,
)
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import (
    HEIGHT_NAMES,
    RawLog,
    Request,
    UnreadableCell,
    find_kept,
    join_batches,
)
from gpszip.io.storage.source import Source
from gpszip.io.values.coordinates import parse_degrees
from gpszip.io.values.json_stream import Element, read_json
from gpszip.io.values.timestamps import times_to_seconds
from gpszip.model.read_result import LeftOut, Repair

__all__ = [
    "read_google",
    "read_google_batches",
    "read_google_paths",
    "read_google_paths_batches",
]

#: Positions that are turned into columns together.
_BATCH_ROWS = 1 << 16

#: Degrees in the numbers of E7.
_E7 = 1e7

#: Largest numbers of E7 on each axis. Larger ones have overflowed 32 bits.
_LARGEST_E7 = (900_000_000, 1_800_000_000)

#: What is added to a number that overflows 32 bits.
_OVERFLOW = 2**32

#: Attributes of positions, and the names under which they may be kept.
_SYNONYMS = {
    "accuracy": ("accuracy",),
    "alt": HEIGHT_NAMES,
    "speed": ("speed", "velocity"),
    "heading": ("heading", "course"),
}

#: Kinds of entries that messages name.
_MAX_SHOWN_KINDS = 8

#: Letters of a kind of entries that messages show.
_MAX_KIND_LETTERS = 30

#: Kinds of entries that are counted one by one.
_MAX_KINDS = 100

Floats = NDArray[np.float64]


def read_google(source: Source, request: Request) -> RawLog:
    """Read the positions of a location history.

    What devices measured is read, as a track for each device; if there is nothing of that, the
    points of paths that have times. The two are never mixed. What is not read is counted.

    Parameters
    ----------
    source : Source
        ``Records.json``, ``Timeline.json``, ``location-history.json``, ``Timeline Edits.json``, or
        a month of the Semantic Location History.
    request : Request
        Attributes to keep (accuracy and alt in metres, speed in m/s, heading in degrees), and
        whether to read a damaged file up to the damage.

    Returns
    -------
    RawLog
        In the order of the file.

    Raises
    ------
    InputError
        If it is no JSON, has no position, or an attribute to keep is none of these.

    Examples
    --------
    >>> data = b'[{"startTime": "1970-01-01T00:00:00Z", "timelinePath": [{"point":'
    >>> data += b' "geo:48.1,11.5", "durationMinutesOffsetFromStartTime": "2"}]}]'
    >>> log = read_google(Source("a.json", data=data), Request())
    >>> log.times.tolist(), log.coordinates.tolist()
    ([120.0], [[48.1, 11.5]])
    """
    return _read(_Reader(source, request, paths_only=False))


def read_google_batches(source: Source, request: Request) -> LogBatches:
    """Open a location history to be read in batches; see :func:`read_google`."""
    return _open(_Reader(source, request, paths_only=False))


def read_google_paths(source: Source, request: Request) -> RawLog:
    """Read the paths of a location history, even if it has positions; see :func:`read_google`."""
    return _read(_Reader(source, request, paths_only=True))


def read_google_paths_batches(source: Source, request: Request) -> LogBatches:
    """Open the paths of a location history to be read in batches; see :func:`read_google`."""
    return _open(_Reader(source, request, paths_only=True))


def _read(reader: _Reader) -> RawLog:
    return join_batches(list(_read_batches(reader)))


def _open(reader: _Reader) -> LogBatches:
    return LogBatches(_read_batches(reader), CoordinateKind(geographic=True, dimension=2))


def _read_batches(reader: _Reader) -> Iterator[RawLog]:
    # What was left out is known at the end of the file, so an empty batch tells it.
    first = 1
    for positions in reader.batches():
        yield reader.log(positions, first)
        first += len(positions)
    yield reader.log([], first, is_last=True)


@dataclass
class _Counts:
    """What a file holds besides the positions that are read.

    Parameters
    ----------
    entries : int
        Number of entries so far.
    unread : int
        Positions of the kind that is not read.
    others : Counter of str
        What has no position, by kind.
    overflows : int
        Positions whose numbers have overflowed.
    damage : str
        Why the rest of the file is not read; empty if all of it is.
    """

    entries: int = 0
    unread: int = 0
    others: Counter[str] = field(default_factory=Counter)
    overflows: int = 0
    damage: str = ""


class _Reader:
    """Reads one file, and counts what is left out."""

    def __init__(self, source: Source, request: Request, *, paths_only: bool) -> None:
        self._source, self._name = source, source.name
        self._request = request
        self._kept = find_kept(request, _SYNONYMS, "heading", source.name)
        self._paths_only = paths_only
        self._counts = _Counts()
        self._devices: dict[str, int] | None = None  # codes by name, if entries may name devices

    def batches(self) -> Iterator[list[Position]]:
        """Yield the positions of the file in the order of the file."""
        # Collect positions of one kind. The first one shows whether devices are named.
        is_raw = not self._paths_only and self._has_raw_positions()
        batch: list[Position] = []
        rows = 0
        for member, found in self._entries(self._counts):
            if (member in RAW_LISTS) != is_raw:
                self._counts.unread += len(found)
                continue
            if found and not rows + len(batch) and member in DEVICE_LISTS:
                self._devices = {}
            batch += found
            if len(batch) >= _BATCH_ROWS:
                rows += len(batch)
                yield batch
                batch = []
        rows += len(batch)
        if batch:
            yield batch

        # The log is not empty.
        if not rows:
            raise self._no_position_error()

    def log(self, positions: list[Position], first: int, *, is_last: bool = False) -> RawLog:
        """Return positions as a log; the last one of a file tells what was left out."""
        # Read the columns.
        by_field = zip(*positions, strict=True) if positions else ((),) * len(Position._fields)
        columns: dict[str, tuple[Any, ...]] = dict(zip(Position._fields, by_field, strict=True))
        points = pa.chunked_array([pa.array(columns["point"], pa.string())])
        coordinates = self._coordinates(points, columns)
        times = self._times(columns)
        values = {name: np.array(columns[name], np.float64) for name in _SYNONYMS}

        # Devices are tracks.
        ids, codes = self._tracks(columns["device"])
        used = set(self._kept.values())
        return RawLog(
            name=self._name,
            ids=ids,
            codes=codes,
            times=times,
            coordinates=coordinates,
            geographic=True,
            attributes={name: values[column] for name, column in self._kept.items()},
            first=first,
            row_noun="point",
            dropped_columns=tuple(
                name
                for name, column in values.items()
                if name not in used and np.isfinite(column).any()
            ),
            repairs=self._repairs() if is_last else (),
            left_out=self._left_out() if is_last else (),
            unreadable=_unreadable(points, coordinates),
        )

    # The file

    def _entries(self, counts: _Counts) -> Iterator[tuple[str, list[Position]]]:
        """Yield the list and the positions of each entry; of a damaged file, as the user wants."""
        try:
            with self._source.open() as stream:
                for part in read_json(stream, self._name, LISTS):
                    if isinstance(part, Element) and part.member in LISTS:
                        counts.entries += 1
                        found = list(positions_in(part.member, part.value, counts.others))
                        yield part.member, found
                        if len(counts.others) > _MAX_KINDS:
                            _fold(counts.others)
        except InputError as error:
            if not (self._request.skip_bad and counts.entries):
                raise
            counts.damage = error.detail

    def _has_raw_positions(self) -> bool:
        """Whether some position was measured; the file is read up to the first one."""
        return any(found and member in RAW_LISTS for member, found in self._entries(_Counts()))

    # Columns

    def _coordinates(self, points: Any, columns: dict[str, tuple[Any, ...]]) -> Floats:
        """Return latitudes and longitudes; NaN for those that can't be read."""
        # Numbers. Some exports have added 2**32 to negative ones.
        numbers = np.column_stack([columns["lat_e7"], columns["lon_e7"]]).reshape(-1, 2)
        largest = np.array(_LARGEST_E7)
        has_overflowed = (numbers > largest) & (np.abs(numbers - _OVERFLOW) <= largest)
        self._counts.overflows += int(has_overflowed.any(axis=1).sum())
        degrees = np.where(has_overflowed, numbers - _OVERFLOW, numbers) / _E7

        # Texts.
        if points.null_count < len(points):
            plain = pc.replace_substring_regex(points, r"^\s*geo:|;.*$", "")
            pair = pc.extract_regex(plain, r"^(?P<lat>[^,]*),(?P<lon>[^,]*)$")
            lat = parse_degrees(pc.struct_field(pair, "lat"), "lat")
            lon = parse_degrees(pc.struct_field(pair, "lon"), "lon")
            is_text = points.is_valid().to_numpy()
            degrees = np.where(is_text[:, None], np.stack([lat, lon], axis=1), degrees)
        return degrees

    def _times(self, columns: dict[str, tuple[Any, ...]]) -> Floats:
        """Return times in seconds since 1970; NaN for those that can't be read."""
        texts = pa.chunked_array([pa.array(columns["time"], pa.string())])
        seconds = np.array(columns["seconds"], np.float64)
        if texts.null_count == len(texts):
            return seconds
        starts = times_to_seconds(texts, None, self._name, "time", dates=self._request.dates)
        is_text = texts.is_valid().to_numpy()
        return np.where(is_text, starts, 0.0) + seconds

    def _tracks(self, devices: tuple[str, ...]) -> tuple[tuple[str, ...], NDArray[np.int32] | None]:
        """Return the names of all devices so far, and an index into them for each position."""
        if self._devices is None:
            return (), None
        # A position without a device is in a track that is named after the file.
        names = [name or self._source.stem for name in devices]
        for name in dict.fromkeys(names):
            self._devices.setdefault(name, len(self._devices))
        return tuple(self._devices), np.array([self._devices[name] for name in names], np.int32)

    # What was repaired and left out

    def _repairs(self) -> tuple[Repair, ...]:
        others = self._counts.others
        what = "entries and points without a position or a time ignored"
        value = ", ".join(_shown(others))
        overflow = "positions corrected whose numbers have overflowed 32 bits"
        found = (
            Repair(what, sum(others.values()), self._name, drops=False, value=value),
            Repair(overflow, self._counts.overflows, self._name, drops=False),
        )
        return tuple(repair for repair in found if repair.count)

    def _left_out(self) -> tuple[LeftOut, ...]:
        found = []
        if self._counts.unread:
            what = "points of paths" if not self._paths_only else "positions of devices"
            other = "google-paths" if not self._paths_only else "google"
            name = f"{self._name}: {self._counts.unread:,} {what}"
            found.append(LeftOut(name, f"are not mixed with others; --format {other} reads them"))
        if self._counts.damage:
            name = f"{self._name}: all after entry {self._counts.entries:,}"
            found.append(LeftOut(name, self._counts.damage))
        return tuple(found)

    def _no_position_error(self) -> InputError:
        if self._counts.unread:
            reason = f"no path in this location history, only {self._counts.unread:,} positions"
            return NoPositionsError(reason, path=self._name, remedy="--format google reads them")
        only = ", ".join(_shown(self._counts.others, with_counts=True))
        return NoPositionsError(
            f"no position in this location history{f', only {only}' if only else ''}",
            path=self._name,
            remedy="export the timeline from the phone's settings, or Records.json",
        )


def _shown(others: Counter[str], *, with_counts: bool = False) -> list[str]:
    return [
        f"{count:,} {kind[:_MAX_KIND_LETTERS]}" if with_counts else kind[:_MAX_KIND_LETTERS]
        for kind, count in others.most_common(_MAX_SHOWN_KINDS)
    ]


def _fold(others: Counter[str]) -> None:
    """Count rare kinds together, as their names take memory."""
    for kind, count in others.most_common()[_MAX_KINDS // 2 :]:
        del others[kind]
        others["others"] += count


def _unreadable(points: Any, coordinates: Floats) -> tuple[UnreadableCell, ...]:
    """Return the first text that is no point."""
    bad = points.is_valid().to_numpy() & ~np.isfinite(coordinates).all(axis=1)
    if not bad.any():
        return ()
    row = int(bad.argmax())
    return (UnreadableCell("point", row, points[row].as_py()),)
