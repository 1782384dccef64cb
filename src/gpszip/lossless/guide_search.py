"""Finding out which rows of a table lie on which walk, and which columns its walks predict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.lossless.grids import find_grid
from gpszip.lossless.guides import (
    MAX_EXPONENT,
    MAX_SHIFT,
    NAME_ROLE,
    Guided,
    Knots,
    Places,
    Role,
    TableGuide,
    has_too_many_knots,
    max_runs,
    numbers_of_names,
)
from gpszip.lossless.trails import Trails

__all__ = ["GuideFinder"]

#: Powers of ten by which numbers may differ from seconds, beyond their decimals: ms, us, ns.
_TIME_POWERS = (0, 3, 6, 9)

#: The same for coordinates: degrees times 1e7 or 1e6, millimetres, centimetres.
_SPACE_POWERS = (0, 7, 6, 3, 2)

#: Clocks of logs may differ from those of archives by a zone: multiples of so many seconds, and at
#: most so many.
_ZONE = 900
_MAX_ZONE = 14 * 3600

#: Share of rows that must lie on walks.
_MIN_SHARE = 0.5

#: Rows that a table has at least, and share of the steps of times that are positive.
_MIN_ROWS = 8
_MIN_INCREASING = 0.6

#: Knots are passed after so many of their own time steps, or this part of the usual time between
#: rows: measured on taxis with a position a minute, whose knots lie between rows.
_SLACK_STEPS = 1.1
_SLACK_SHARE = 12

#: Rows by which roles are found, and by how much smaller the distance from the walk must be than
#: that from the column's median.
_ROLE_ROWS = 2000
_ROLE_GAIN = 0.25

#: Groups of digits in a name that may be columns.
_MAX_NAME_NUMBERS = 8

_Ints = NDArray[np.int64]


class GuideFinder:
    """Finds guides of tables, whose rows follow one another in a log.

    Parameters
    ----------
    trails : Trails
        The walks of the archive.
    """

    def __init__(self, trails: Trails) -> None:
        self.trails = trails
        #: Whether any table was found to lie on walks.
        self.has_found = False
        self._track = -1
        self._zone: int | None = None
        found = [trails.trail(number) for number in range(len(trails.names))]
        missing = np.inf
        self._starts = np.array([missing if t is None else t.times[0] for t in found])
        self._ends = np.array([-missing if t is None else t.times[-1] for t in found])
        self._order = np.argsort(self._starts, kind="stable")
        self._sorted_starts = self._starts[self._order]

    def find_times(
        self, columns: Sequence[_Ints], decimals: Sequence[int], times: int | None
    ) -> int | None:
        """The column of times: one that has those of the walks, or else the one given."""
        candidates = [i for i, column in enumerate(columns) if _mostly_increases(column)]
        if not np.isfinite(self._starts).any():
            return times
        if times is not None:
            candidates = [times, *candidates]
        for i in candidates:
            if self._find_unit(columns[i], decimals[i]) is not None:
                return i
        return times

    def find(self, columns: Sequence[_Ints], decimals: Sequence[int], times: int) -> Guided | None:
        """Find the guide of a table; None if its rows lie on no walk.

        Parameters
        ----------
        columns : sequence of int64 array, shape (n,)
            Numbers in units of their last digits.
        decimals : sequence of int
            Digits after the point of each.
        times : int
            Number of the column of times.
        """
        if len(columns[times]) < _MIN_ROWS or not np.isfinite(self._starts).any():
            return None
        unit = self._find_unit(columns[times], decimals[times])
        if unit is None:
            return None

        # The runs.
        exponent, zone = unit
        seconds = (columns[times].astype(np.float64) - float(zone)) / 10.0**exponent
        usual = float(np.median(np.abs(np.diff(seconds))))
        runs = self._find_runs(seconds, max(self.trails.time_step, usual, 1.0))
        tracks, rows = (np.array(part, np.int64) for part in zip(*runs, strict=True))
        is_long = len(tracks) > max_runs(len(seconds))
        if is_long or has_too_many_knots(tracks, len(seconds), self.trails):
            return None
        if rows[tracks > 0].sum() < _MIN_SHARE * len(seconds):
            return None

        # What the other columns are.
        grid = find_grid(columns[times], decimals[times])
        slack = max(_SLACK_STEPS * self.trails.time_step, usual / _SLACK_SHARE) * 10.0**exponent
        slack = int(16 * slack * grid.denominator / grid.numerator)
        # Steps of times may be far finer than those of the walks.
        if max(abs(zone), slack) > MAX_SHIFT:
            return None
        roles = tuple(Role() for _ in columns)
        guide = TableGuide(tracks, rows, exponent, zone, slack, roles)
        knots = Knots(guide, self.trails, grid)
        places = knots.locate(grid.multiples(columns[times]))
        roles = tuple(
            Role() if i == times else self._find_role(column, decimals[i], guide, knots, places)
            for i, column in enumerate(columns)
        )
        self.has_found = True
        # The table is coded with the same knots and places.
        guide = TableGuide(tracks, rows, exponent, zone, slack, roles)
        return Guided(guide, self.trails, knots, places)

    def _find_unit(self, numbers: _Ints, decimals: int) -> tuple[int, int] | None:
        """Power of ten and zone of a column of times; None if they are not those of the walks."""
        # When the walks begin and end.
        known = np.isfinite(self._starts)
        start, end = float(self._starts[known].min()), float(self._ends[known].max())
        margin = max(self.trails.time_step, 1.0)

        # The first unit in which most rows lie between, in a zone that all blocks of a log share.
        for power in _TIME_POWERS:
            exponent = decimals + power
            if exponent > MAX_EXPONENT:
                break
            zones = [0, *_zones(float(numbers.min()) / 10.0**exponent - start)]
            if self._zone is not None:
                zones = [self._zone]
            for zone in zones:
                seconds = numbers / 10.0**exponent - zone
                inside = (seconds >= start - margin) & (seconds <= end + margin)
                if np.count_nonzero(inside) >= _MIN_SHARE * len(numbers):
                    self._zone = zone
                    return exponent, zone * 10**exponent
        return None

    def _find_runs(self, seconds: NDArray[np.float64], margin: float) -> list[tuple[int, int]]:
        """For each run 1 + the number of its track, or 0, and its number of rows."""
        # Within a part, times increase.
        breaks = [*(np.flatnonzero(np.diff(seconds) <= 0) + 1).tolist(), len(seconds)]
        runs: list[tuple[int, int]] = []
        row = part = 0
        while row < len(seconds):
            while breaks[part] <= row:
                part += 1
            bound = breaks[part]

            # Rows up to the end of the track that begins here.
            first = float(seconds[row])
            track = self._find_track(first, margin, begins=row > 0)
            if track is not None:
                end = float(self._ends[track]) + margin * 1e-3
                after = row + int(np.searchsorted(seconds[row:bound], end, "right"))
                self._track = track
            else:
                # Rows that were left out, up to where the next track begins.
                starts = self._sorted_starts
                following = int(np.searchsorted(starts, first + margin, "right"))
                after = bound
                if following < len(starts):
                    start = float(starts[following]) - margin * 1e-3
                    after = row + int(np.searchsorted(seconds[row:bound], start, "left"))

            # The next run.
            after = max(after, row + 1)
            runs.append((0 if track is None else track + 1, after - row))
            row = after
        return runs

    def _find_track(self, first: float, margin: float, *, begins: bool) -> int | None:
        """The track that goes on, or begins, at the time of a row."""
        # A block of text goes on with the track of the last one.
        last, following = self._track, self._track + 1
        if not begins and last >= 0 and self._starts[last] <= first <= self._ends[last]:
            return last
        if following < len(self._starts) and abs(self._starts[following] - first) <= margin:
            return following

        # Otherwise the track whose start is nearest.
        low, high = np.searchsorted(self._sorted_starts, [first - margin, first + margin])
        if low == high:
            return None
        found = self._order[low:high]
        return int(found[np.argmin(np.abs(self._starts[found] - first))])

    def _find_role(
        self, column: _Ints, decimals: int, guide: TableGuide, knots: Knots, places: Places
    ) -> Role:
        """What a column is."""
        # A number in the names of tracks.
        for which in range(_MAX_NAME_NUMBERS):
            numbers = numbers_of_names(guide, self.trails, which)
            if numbers is None:
                break
            if (numbers == column).all():
                return Role(NAME_ROLE, which)

        # An axis of the walks, where these are much nearer than the median.
        rows = np.flatnonzero(places.classes)
        rows = rows[:: max(len(rows) // _ROLE_ROWS, 1)]
        sample = column[rows].astype(np.float64)
        limit = _ROLE_GAIN * float(np.median(np.abs(sample - np.median(sample))))
        best = Role()
        for axis in range(self.trails.axes):
            coordinates = knots.coordinates(axis, places, rows)
            for power in _SPACE_POWERS:
                exponent = decimals + power
                distance = float(np.median(np.abs(sample - coordinates * 10.0**exponent)))
                if exponent <= MAX_EXPONENT and distance < limit:
                    limit, best = distance, Role(1 + axis, exponent)
        return best


def _mostly_increases(column: _Ints) -> bool:
    """Whether a column may hold times of tracks one after the other."""
    return len(column) > 1 and bool(
        np.count_nonzero(np.diff(column) > 0) >= _MIN_INCREASING * (len(column) - 1)
    )


def _zones(difference: float) -> list[int]:
    """Seconds by which a clock may be ahead, where a difference looks like that of a zone."""
    zone = round(difference / _ZONE) * _ZONE
    return [zone] if 0 < abs(zone) <= _MAX_ZONE and abs(difference - zone) < 1.0 else []
