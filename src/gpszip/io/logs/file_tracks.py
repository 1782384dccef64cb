"""The tracks of one file: which track each row belongs to, and how far each track reaches in time.

All functions take rows that are grouped by track, so that a batch of many short tracks costs a few
array operations.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.io.logs.losses import MIN_STOPPED_POSITIONS
from gpszip.io.logs.raw import RawLog, unused_name
from gpszip.io.logs.rows import Codes, Flags, Floats, begins_run

__all__ = ["AssignedRows", "FileTracks", "NamedTrack"]

#: What is known of a track without its rows.
_TRACK = np.dtype(
    [
        ("name", np.int32),  # index of its name in the file
        ("rows", np.int64),  # number of its rows that can be used
        ("elsewhere", np.int64),  # of these, rows at another position than the first one
        ("first_time", np.float64),
        ("last_time", np.float64),
        ("row_time", np.float64),  # time of the row that was read last
    ]
)

#: A track before its first row.
_NEW_TRACK = np.array((0, 0, 0, np.inf, -np.inf, -np.inf), _TRACK)

#: Tracks that the array holds at first.
_INITIAL_CAPACITY = 8


class AssignedRows(NamedTuple):
    """The track of each row of a batch.

    Parameters
    ----------
    codes : int32 array, shape (n,)
        Code of the row's track.
    steps : float64 array, shape (n,)
        Seconds since the row before of the same name, negative where time goes back; infinite for
        its first row.
    """

    codes: Codes
    steps: Floats


class NamedTrack(NamedTuple):
    """A track of a file that has rows.

    Parameters
    ----------
    code : int
        The number by which its rows are found.
    name : str or None
        Its name in the file; None if the file names no tracks.
    first_time, last_time : float
        Its extent in seconds.
    timed : bool
        Whether it has times; those of a shape number its points.
    """

    code: int
    name: str | None
    first_time: float
    last_time: float
    timed: bool


class FileTracks:
    """Finds the tracks of one file, batch by batch.

    A name of the file stands for one track, or for several if time goes back and starts a new one.

    Parameters
    ----------
    first_code : int
        Code of its first track. Those of other files are below.
    """

    def __init__(self, first_code: int) -> None:
        self.first_code = first_code
        self.count = 0
        self.names: list[str | None] = []
        self.points = np.zeros(0, np.int64)  # rows of each name, also those that can't be used
        self.untimed: set[int] = set()  # indices of names
        self.left_out: set[int] = set()  # indices of names
        self._index_by_key: dict[tuple[str | None, int], int] = {}
        self._present = np.zeros(0, np.int32)  # the track that each name stands for at the last row
        self._tracks = np.full(_INITIAL_CAPACITY, _NEW_TRACK)
        self._first_positions = np.zeros((_INITIAL_CAPACITY, 0))
        # Of tracks with one time so far, a few positions that differ from the first one and from
        # each other.
        self._other_positions: dict[int, list[Floats]] = {}

    @property
    def next_code(self) -> int:
        """Code after those of this file."""
        return self.first_code + self.count

    @property
    def tracks(self) -> NDArray[np.void]:
        """The tracks in the order of their codes."""
        return self._tracks[: self.count]

    # Names

    def index_names(self, raw: RawLog) -> NDArray[np.int32]:
        """Return the index of the name of each row's track, and count the rows of each name."""
        # Rows of a file without names are one track.
        if raw.codes is None:
            indices = np.full(len(raw.times), self._index_of((None, 0)), np.int32)
            untimed = [self._index_of((None, 0))] if raw.untimed else []
        else:
            # Two tracks of one batch may share a title.
            index_by_id = np.zeros(len(raw.ids), np.int32)
            keys = list(_number_repeats(raw.ids))
            # A dictionary may hold ids that no row has. Only ids of rows become names.
            for i in np.unique(raw.codes).tolist():
                index_by_id[i] = self._index_of(keys[i])
            indices = index_by_id[raw.codes]
            untimed = index_by_id[sorted(raw.untimed)].tolist()
        self.untimed.update(untimed)

        # Count.
        # Names that are new in this batch begin without rows, and stand for no track yet (-1).
        if missing := len(self.names) - len(self.points):
            self.points = np.append(self.points, np.zeros(missing, np.int64))
            self._present = np.append(self._present, np.full(missing, -1, np.int32))
        self.points += np.bincount(indices, minlength=len(self.names))
        return indices

    def _index_of(self, key: tuple[str | None, int]) -> int:
        # A key is a name and how often the batch has the same name before it.
        if key not in self._index_by_key:
            self._index_by_key[key] = len(self.names)
            self.names.append(key[0])
        return self._index_by_key[key]

    def forget_rows(self, names: NDArray[np.int32]) -> None:
        """Take back that some names have a row each: nobody asked for these rows."""
        self.points -= np.bincount(names, minlength=len(self.names))

    def base_name(self, code: int) -> str | None:
        """Name in the file of a track, which may be one of several with that name."""
        return self.names[int(self._tracks["name"][code - self.first_code])]

    # Rows

    def assign(
        self, names: NDArray[np.int32], times: Floats, begins: Flags, *, split: bool
    ) -> AssignedRows:
        """Find the track of each row.

        Parameters
        ----------
        names : int32 array, shape (n,)
            Index of the name of each row's track, not decreasing.
        times : float64 array, shape (n,)
            Seconds.
        begins : bool array, shape (n,)
            Whether a new track starts with each row.
        split : bool
            Start a new track where time goes back, too.
        """
        # A name that comes for the first time stands for a new track.
        starts = begins_run(names)
        own = names[starts]
        new = own[self._present[own] < 0]
        self._present[new] = self._add_tracks(new)

        # Compare each row with the one before, the first one of a batch with that of the last.
        steps = np.empty(len(times))
        np.subtract(times[1:], times[:-1], out=steps[1:])
        steps[starts] = times[starts] - self._tracks["row_time"][self._present[own]]
        begins = begins | (steps < 0) if split else begins
        if not begins.any():
            return AssignedRows(self._present[names] + np.int32(self.first_code), steps)

        # Rows up to the next mark belong to the track that starts or goes on at a mark.
        marks = starts | begins
        codes = self._present[names[marks]]
        codes[begins[marks]] = self._add_tracks(names[begins])
        self._present[names[marks]] = codes  # the last mark of a name counts
        rows = codes[np.cumsum(marks) - 1] + np.int32(self.first_code)
        return AssignedRows(rows, steps)

    def extend(self, codes: Codes, times: Floats, coordinates: Floats) -> None:
        """Extend the tracks by the rows of a batch, which are grouped by their codes."""
        # Reduce the rows of each track.
        codes = codes - self.first_code
        if not len(codes):
            return
        starts = np.flatnonzero(begins_run(codes))
        stops = np.append(starts[1:], len(codes))
        own = codes[starts]
        tracks = self._tracks[own]

        # Note the first position of new tracks.
        if not self._first_positions.shape[1]:
            self._first_positions = np.zeros((len(self._tracks), coordinates.shape[1]))
        is_new = tracks["rows"] == 0
        self._first_positions[own[is_new]] = coordinates[starts[is_new]]

        # Extend.
        tracks["rows"] += stops - starts
        tracks["first_time"] = np.minimum(tracks["first_time"], np.minimum.reduceat(times, starts))
        tracks["last_time"] = np.maximum(tracks["last_time"], np.maximum.reduceat(times, starts))
        tracks["row_time"] = times[stops - 1]

        # Positions are compared only while all rows of a track have one time.
        for i in np.flatnonzero(tracks["first_time"] == tracks["last_time"]).tolist():
            rows = coordinates[starts[i] : stops[i]]
            rows = rows[_are_away_from(self._first_positions[own[i]], rows)]
            tracks["elsewhere"][i] += len(rows)
            if len(rows):
                self._note_positions(int(own[i]), rows)
        # Indexing by an array made a copy of these tracks.
        self._tracks[own] = tracks

    def _note_positions(self, track: int, rows: Floats) -> None:
        """Note positions that differ, as many as show that the clock of a track stood still."""
        known = self._other_positions.setdefault(track, [])
        for position in known:
            rows = rows[_are_away_from(position, rows)]
        while len(rows) and len(known) < MIN_STOPPED_POSITIONS - 1:
            known.append(rows[0].copy())
            rows = rows[_are_away_from(rows[0], rows)]

    def _add_tracks(self, names: NDArray[np.int32]) -> Codes:
        """Add a track for each of some names, and return their numbers."""
        # Full arrays double, so that adding one track after the other takes linear time.
        first, self.count = self.count, self.count + len(names)
        if self.count > len(self._tracks):
            more = max(self.count, 2 * len(self._tracks)) - len(self._tracks)
            self._tracks = np.append(self._tracks, np.full(more, _NEW_TRACK))
            unknown = np.zeros((more, self._first_positions.shape[1]))
            self._first_positions = np.concatenate([self._first_positions, unknown])
        self._tracks["name"][first : self.count] = names
        return np.arange(first, self.count, dtype=np.int32)

    # Results

    def stopped_tracks(self) -> NDArray[np.void]:
        """Return the tracks with one time, but at least three different positions.

        Points at one position count once, in whatever order they come.

        Returns
        -------
        structured array
            With fields ``name``, ``rows`` and ``first_time``, in the order of names.
        """
        tracks = self.tracks
        stopped = np.zeros(len(tracks), np.bool_)
        for track, others in self._other_positions.items():
            stopped[track] = len(others) + 1 >= MIN_STOPPED_POSITIONS
        stopped &= tracks["first_time"] == tracks["last_time"]
        # Where time goes back and splits a name into tracks, the clock runs.
        is_whole = np.bincount(tracks["name"], minlength=len(self.names)) == 1
        found = tracks[stopped & is_whole[tracks["name"]]]
        in_order: NDArray[np.void] = found[np.argsort(found["name"])]
        return in_order

    def rows_at_only_time(self) -> tuple[int, int]:
        """Return the number of rows if all of them are of one track and time.

        Returns
        -------
        int
            Number of rows; 0 if they are of several tracks or times.
        int
            Of these, rows at another position than the first one.
        """
        tracks = self.tracks[self._is_used()]
        if len(tracks) != 1 or tracks["first_time"][0] != tracks["last_time"][0]:
            return 0, 0
        return int(tracks["rows"][0]), int(tracks["elsewhere"][0])

    def _is_used(self) -> Flags:
        """Return which tracks have rows and are not left out."""
        is_left_out = np.isin(self.tracks["name"], list(self.left_out))
        used: Flags = (self.tracks["rows"] > 0) & ~is_left_out
        return used

    def named_tracks(self) -> list[NamedTrack]:
        """Return the tracks that have rows and are not left out.

        They come in the order in which the file first names them. A track that starts where time
        goes back gets a name that the file doesn't use.
        """
        # The order of codes is the order of time for the tracks of one name.
        tracks = self.tracks
        used = np.flatnonzero(self._is_used())
        used = used[np.argsort(tracks["name"][used], kind="stable")]

        # Name them.
        named: list[NamedTrack] = []
        taken = {name for name in self.names if name is not None}
        seen: set[str] = set()
        for code, track in zip(used.tolist(), tracks[used].tolist(), strict=True):
            index, _, _, first_time, last_time, *_ = track
            name = self.names[index]
            if name in seen:
                name = unused_name(name, taken)
                taken.add(name)
            if name is not None:
                seen.add(name)
            timed = index not in self.untimed
            named.append(NamedTrack(self.first_code + code, name, first_time, last_time, timed))
        return named


def _are_away_from(position: Floats, rows: Floats) -> Flags:
    """Return which rows are at another position."""
    away: Flags = (rows != position).any(axis=1)
    return away


def _number_repeats(names: Iterable[str]) -> Iterable[tuple[str, int]]:
    """Yield each name with the number of times that it came before."""
    seen: dict[str, int] = {}
    for name in names:
        yield name, seen.get(name, 0)
        seen[name] = seen.get(name, 0) + 1
