"""What walks tell of a table: which rows lie on which walk, and which columns it predicts.

A *guide* of a column holds the walk's own numbers for it: of the column of times, the times of
knots that are to come; of coordinates, where the walk is at the time of each row.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_signed, encode_varint
from gpszip.lossless.columns import decode_column, encode_column
from gpszip.lossless.grids import Grid
from gpszip.lossless.setting import Guide
from gpszip.lossless.trails import Trail, Trails

__all__ = [
    "MAX_EXPONENT",
    "MAX_SHIFT",
    "NAME_ROLE",
    "NO_ROLE",
    "Guided",
    "Knots",
    "Places",
    "Role",
    "TableGuide",
    "decode_guide",
    "encode_guide",
    "has_too_many_knots",
    "max_runs",
    "numbers_of_names",
]

#: Roles of columns: none, or 1 + the axis of the walk's positions, or one that stands for the
#: track's name, whose number follows.
NO_ROLE = 0
NAME_ROLE = 255

#: Rows that a run has on average at least.
_MIN_RUN = 4

#: Runs have at most this many knots, and so many more for each row, and in all: a forged guide must
#: not ask for the knots of a long track again and again. A knot takes 38 bytes of memory.
_FREE_KNOTS = 1 << 21
_KNOTS_PER_ROW = 16
_MAX_KNOTS = 1 << 23

#: Powers of ten by which seconds, degrees or metres are multiplied.
MAX_EXPONENT = 18

#: Largest zone and slack: more would not fit 64 bits.
MAX_SHIFT = 1 << 60

#: Classes of what a walk tells: at a knot, at the end of a piece, on the move, at a stop, in a gap.
AT_KNOT = 1
AT_END = 2
_MOVING = 3
_STOPPED = 4
_IN_GAP = 5

#: Numbers of a guide are at most this, in sixteenths; their differences at most that.
_MAX_NUMBER = float(1 << 60)
_MAX_DIFFERENCE = 1 << 45
_SUBSTEPS = 16

#: Binary digits of a share of the time between two knots.
_SHARE_BITS = 16

#: Times of knots within a run have so many binary digits, below those of the number of the run.
_TIME_BITS = 42

#: Numbers in a name, as in text: long ones are cut, and a minus after a digit is none.
_NUMBER = re.compile(r"(?:(?<![0-9])-)?[0-9]{1,17}")

_Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Role:
    """What a column is: an axis of positions times a power of ten, or a number in names."""

    kind: int = NO_ROLE
    detail: int = 0


@dataclass(frozen=True, eq=False)
class TableGuide:
    """Which rows lie on which walk, and what the columns are.

    Parameters
    ----------
    tracks, rows : int64 array, shape (r,)
        For each run of rows 1 + the number of its track, or 0 if it has none, and the number of
        rows.
    exponent, zone : int
        A time is seconds * 10**exponent + zone.
    slack : int
        Knots this little after a row are passed, in sixteenths of the steps of times.
    roles : tuple of Role
        Of each column; that of times has none.
    """

    tracks: _Ints
    rows: _Ints
    exponent: int
    zone: int
    slack: int
    roles: tuple[Role, ...]


class Guided:
    """A table whose rows lie on walks.

    Parameters
    ----------
    guide : TableGuide
        Which rows lie on which walk.
    trails : Trails
        The walks.
    knots, places : Knots and Places, optional
        Where a writer has found them already: the knots, and where rows lie between them.
    """

    def __init__(
        self,
        guide: TableGuide,
        trails: Trails,
        knots: Knots | None = None,
        places: Places | None = None,
    ) -> None:
        self.guide = guide
        self._trails = trails
        self._knots = knots
        self._places = places

    def column_guide(self, i: int, times: int | None, grid: Grid) -> Guide | None:
        """Guide of column i, whose grid is known; None where walks tell nothing of it.

        That of the column of times comes first.
        """
        if i == times:
            if self._knots is None:
                self._knots = Knots(self.guide, self._trails, grid)
            return self._knots.times_guide()
        role = self.guide.roles[i]
        if role.kind == NO_ROLE or self._knots is None or self._places is None:
            return None
        return self._knots.positions_guide(role, grid, self._places)

    def locate(self, times: _Ints) -> None:
        """Find out where rows lie between knots, from the integers of the column of times."""
        if self._knots is not None:
            self._places = self._knots.locate(times)

    def names(self, i: int) -> _Ints:
        """The column i of numbers in names."""
        numbers = numbers_of_names(self.guide, self._trails, self.guide.roles[i].detail)
        empty = np.zeros(int(self.guide.rows.sum()), np.int64)
        return empty if numbers is None else numbers


class Knots:
    """Knots of all runs of a table, one after the other.

    Parameters
    ----------
    guide : TableGuide
        The runs.
    trails : Trails
        The walks.
    grid : Grid
        That of the column of times.
    """

    def __init__(self, guide: TableGuide, trails: Trails, grid: Grid) -> None:
        # Runs may be on the same track.
        by_track = {0: _empty_trail(trails.axes)}
        for track in np.unique(guide.tracks[guide.tracks > 0]).tolist():
            by_track[track] = trails.trail(track - 1) or by_track[0]
        self._trails = [by_track[track] for track in guide.tracks.tolist()]
        self._table = guide
        counts = [len(trail.times) for trail in self._trails]
        self.run_rows = np.append(0, np.cumsum(guide.rows)).astype(np.int64)
        self.run_events = np.append(0, np.cumsum(counts)).astype(np.int64)
        times = np.concatenate([trail.times for trail in self._trails])
        self.times = _on_grid(times, guide.exponent, guide.zone, grid)

    def times_guide(self) -> Guide:
        """Guide of the column of times."""
        is_end = np.concatenate([trail.is_end for trail in self._trails])
        is_stay = np.concatenate([trail.is_stay for trail in self._trails])
        classes = np.where(is_end, AT_END, np.where(is_stay, _STOPPED, AT_KNOT)).astype(np.uint8)
        return Guide(self.times, classes, self.run_rows, self.run_events, self._table.slack)

    def locate(self, times: _Ints) -> Places:
        """Where rows lie between knots.

        Parameters
        ----------
        times : int64 array, shape (n,)
            Times of all rows, in steps.
        """
        # Times of rows and knots since the first knot of their run, in one order of all runs.
        starts = np.zeros(len(self._trails), np.int64)
        has_knots = self.run_events[1:] > self.run_events[:-1]
        starts[has_knots] = self.times[self.run_events[:-1][has_knots]]
        run_of_row = np.repeat(np.arange(len(starts)), self._table.rows)
        run_of_knot = np.repeat(np.arange(len(starts)), np.diff(self.run_events))
        knots = self.times - starts[run_of_knot]
        shift = max(int(knots.max(initial=0)).bit_length() - _TIME_BITS, 0)
        knots >>= shift
        limit = (1 << _TIME_BITS) - 1
        since = np.clip((times * _SUBSTEPS - starts[run_of_row]) >> shift, 0, limit)

        # The last knot before each row, unless it is the last of all.
        before = np.searchsorted(
            (run_of_knot << _TIME_BITS) + knots, (run_of_row << _TIME_BITS) + since, "right"
        )
        first = self.run_events[run_of_row]
        last = np.maximum(self.run_events[run_of_row + 1] - 1, first)
        knot = np.clip(before - 1, first, np.maximum(last - 1, first))
        after = np.minimum(knot + 1, last)
        exists = has_knots[run_of_row]
        knot, after = np.where(exists, knot, 0), np.where(exists, after, 0)

        # The share of the time between the knots, and what kind of a place that is.
        if not len(knots):
            nowhere = np.zeros(len(times), np.int64)
            return Places(nowhere, nowhere, nowhere, nowhere.astype(np.uint8))
        elapsed = np.clip(since - knots[knot], 0, None)
        left = knots[after] - since
        duration = np.maximum(knots[after] - knots[knot], 1)
        share = np.minimum((elapsed << _SHARE_BITS) // duration, 1 << _SHARE_BITS)
        is_near = np.minimum(np.abs(elapsed), np.abs(left)) <= self._table.slack >> shift
        is_stay = np.concatenate([trail.is_stay for trail in self._trails])[after]
        is_gap = np.concatenate([trail.is_gap for trail in self._trails])[after]
        classes = np.where(is_gap, _IN_GAP, np.where(is_stay, _STOPPED, _MOVING))
        classes = np.where(exists, np.where(is_near, AT_KNOT, classes), 0)
        return Places(knot, after, share, classes.astype(np.uint8))

    def positions_guide(self, role: Role, grid: Grid, places: Places) -> Guide:
        """Guide of a column of coordinates.

        Parameters
        ----------
        role : Role
            Its axis and power of ten.
        grid : Grid
            The column's grid.
        places : Places
            Where its rows lie.
        """
        # Where the knots are; without any, nothing is told.
        axis = role.kind - 1
        coordinates = np.concatenate([trail.positions[:, axis] for trail in self._trails])
        empty = np.zeros(0, np.int64)
        if not len(coordinates):
            return Guide(np.zeros(len(places.knots), np.int64), places.classes, empty, empty, 0)

        # Between two knots, the share of the way is that of the time.
        numbers = _on_grid(coordinates, role.detail, 0, grid)
        start = numbers[places.knots]
        way = np.clip(numbers[places.after] - start, -_MAX_DIFFERENCE, _MAX_DIFFERENCE)
        values = start + ((way * places.shares) >> _SHARE_BITS)
        values[places.classes == 0] = 0
        return Guide(values, places.classes, empty, empty, 0)

    def coordinates(self, axis: int, places: Places, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """About where walks are at some rows, on one axis."""
        numbers = np.concatenate([trail.positions[:, axis] for trail in self._trails])
        start, end = numbers[places.knots[rows]], numbers[places.after[rows]]
        about: NDArray[np.float64] = start + (end - start) * (places.shares[rows] / 65536)
        return about


@dataclass(frozen=True, eq=False)
class Places:
    """Between which knots rows lie.

    Parameters
    ----------
    knots, after : int64 array, shape (n,)
        The knots.
    shares : int64 array, shape (n,)
        Share of the time between them, in units of 2**-16.
    classes : uint8 array, shape (n,)
        What kind of a place it is.
    """

    knots: _Ints
    after: _Ints
    shares: _Ints
    classes: NDArray[np.uint8]


def numbers_of_names(guide: TableGuide, trails: Trails, which: int) -> _Ints | None:
    """The number in the name of each row's track, counted from 0; None if no name has as many.

    Rows without a track, and tracks without such a number, have 0.
    """
    found, numbers = False, []
    for track in guide.tracks.tolist():
        digits = _NUMBER.findall(trails.names[track - 1]) if track else []
        found |= which < len(digits)
        numbers.append(int(digits[which]) if which < len(digits) else 0)
    return np.repeat(np.array(numbers, np.int64), guide.rows) if found else None


def max_runs(rows: int) -> int:
    """Most runs of a guide: more would take more bytes than they save."""
    return max(rows // _MIN_RUN, 1)


def has_too_many_knots(tracks: _Ints, rows: int, trails: Trails) -> bool:
    """Whether runs on these tracks have more knots than a guide of so many rows may have."""
    numbers, runs = np.unique(tracks[tracks > 0], return_counts=True)
    knots = 0
    for track, count in zip(numbers.tolist(), runs.tolist(), strict=True):
        trail = trails.trail(track - 1)
        knots += 0 if trail is None else count * len(trail.times)
    return knots > min(_FREE_KNOTS + _KNOTS_PER_ROW * rows, _MAX_KNOTS)


def encode_guide(guide: TableGuide | None) -> bytes:
    """Encode the guide of a table, or that there is none."""
    if guide is None:
        return encode_varint(0)

    # The runs, and how times are told.
    parts = [
        encode_varint(len(guide.tracks)),
        encode_column(guide.tracks)[0],
        encode_column(guide.rows)[0],
        bytes([guide.exponent]),
        encode_signed(guide.zone),
        encode_varint(guide.slack),
    ]

    # What each column is.
    for role in guide.roles:
        parts.append(bytes([role.kind]))
        if role.kind != NO_ROLE:
            parts.append(bytes([role.detail]))
    return b"".join(parts)


def decode_guide(cursor: Cursor, rows: int, columns: int, trails: Trails) -> TableGuide | None:
    """Undo :func:`encode_guide`.

    Raises
    ------
    CorruptArchiveError
        If the bytes are no guide of a table with so many rows and columns.
    """
    runs = cursor.read_varint("the number of runs")
    if runs == 0:
        return None
    if runs > max_runs(rows):
        raise cursor.error(f"{runs} runs of {rows} rows")

    # The runs.
    tracks, _ = decode_column(cursor, runs)
    lengths, _ = decode_column(cursor, runs)
    if tracks.min() < 0 or tracks.max() > len(trails.names):
        raise cursor.error(f"a run is on none of {len(trails.names)} tracks")
    if lengths.min() < 1 or lengths.max() > rows or int(lengths.sum()) != rows:
        raise cursor.error(f"the runs do not have {rows} rows")
    if has_too_many_knots(tracks, rows, trails):
        raise cursor.error(f"the runs have too many knots for {rows} rows")

    # Times and roles.
    exponent = cursor.read_byte("a power of ten")
    zone = cursor.read_signed("a difference of times")
    slack = cursor.read_varint("a slack of times")
    if exponent > MAX_EXPONENT or max(abs(zone), slack) > MAX_SHIFT:
        raise cursor.error("times of a guide are out of range")
    roles = tuple(_read_role(cursor, trails) for _ in range(columns))
    return TableGuide(tracks, lengths, exponent, zone, slack, roles)


def _read_role(cursor: Cursor, trails: Trails) -> Role:
    """Read the role of a column."""
    kind = cursor.read_byte("the role of a column")
    if kind == NO_ROLE:
        return Role()
    detail = cursor.read_byte("the detail of a role")
    if kind != NAME_ROLE and (kind > trails.axes or detail > MAX_EXPONENT):
        raise cursor.error(f"no column has role {kind}, {detail}")
    return Role(kind, detail)


def _empty_trail(axes: int) -> Trail:
    """A trail without knots."""
    nothing = np.zeros(0, np.bool_)
    return Trail(np.zeros(0), np.zeros((0, axes)), nothing, nothing, nothing)


def _on_grid(numbers: NDArray[np.float64], exponent: int, zone: int, grid: Grid) -> _Ints:
    """Numbers in sixteenths of a grid's step, rounded down, the same on every machine."""
    with np.errstate(all="ignore"):
        units = numbers * 10.0**exponent + float(zone - grid.offset)
        scaled = units * (_SUBSTEPS * grid.denominator / grid.numerator)
    scaled = np.clip(np.nan_to_num(scaled), -_MAX_NUMBER, _MAX_NUMBER)
    return np.floor(scaled).astype(np.int64)
