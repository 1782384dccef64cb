"""Columns kept within an error: piecewise-linear curves over time, with knots of their own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpszip.codec.kernels.curves import (
    BEGINS_RUN,
    BEGINS_TRACK,
    CURVE_CONTEXTS,
    GOES_ON,
    code_knots,
    find_knots,
)
from gpszip.codec.kernels.range_coder import finish, new_decoder, new_encoder
from gpszip.errors import OptionError

__all__ = [
    "MAX_FIRST",
    "UNITS",
    "Curve",
    "CurveColumn",
    "CurveSlice",
    "check_range",
    "decode_knots",
    "encode_knots",
    "fit_column",
    "fit_slices",
    "max_rows",
    "times_of_knots",
]

#: Values lie on a grid of this share of the bound: finer ones save knots and cost bits.
_STEP_SHARE = 0.5

#: Shares of the bound that are left for rounding, one tried after the other: of floating-point
#: numbers, and of times that lie on no unit.
_SLACK_SHARES = (1e-9, 0.02)

#: Units of time that are tried, a second divided by each.
UNITS = (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)

#: Seconds by which a time may be off a unit: float64 seconds since 1970 are good to 2.4e-7 s.
_UNIT_TOLERANCE = 1e-6

#: Samples that one line passes over at most, which bounds the work for each.
_MAX_SAMPLES = 1024

#: Samples of a run whose states are in memory at once, in 80 bytes each.
_SLICE_SAMPLES = 1 << 16

#: Values, and times from the first one on, stay below this in their units: integers are coded up to
#: 2^48.
_MAX_MAGNITUDE = 2.0**46

#: Times themselves stay below this in their unit, where float64 counts them.
MAX_FIRST = 2.0**52

#: Initial count of each bit.
_INITIAL_COUNT = 10

#: A payload holds at most so many knots, and so many more for each of its bytes: forged counts
#: can't ask for memory.
_FREE_KNOTS = 4096
_KNOTS_PER_BYTE = 1024

Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


class Curve(NamedTuple):
    """A curve over the time of one track.

    Parameters
    ----------
    times, values : float64 arrays, shape (k,)
        Knots; times in seconds increase.
    holes : bool array, shape (k,)
        Whether there are no values from each knot to the next; true after the last one.
    """

    times: Floats
    values: Floats
    holes: NDArray[np.bool_]

    def at(self, times: ArrayLike, slack: float = 1e-3) -> Floats:
        """Values at times in seconds; NaN in holes, before and after, but for a slack in seconds.

        Examples
        --------
        >>> curve = Curve(np.array([0.0, 4.0]), np.array([1.0, 3.0]), np.array([False, True]))
        >>> curve.at([1.0, 9.0]).tolist()
        [1.5, nan]
        """
        # The knots around each time.
        when = np.asarray(times, np.float64)
        if not len(self.times):
            return np.full(when.shape, np.nan)
        after = np.searchsorted(self.times, when, side="right")
        left = np.maximum(after - 1, 0)
        right = np.minimum(after, len(self.times) - 1)

        # Between them, or at the nearer of them beside a hole.
        duration = self.times[right] - self.times[left]
        fraction = (when - self.times[left]) / np.where(duration > 0, duration, 1.0)
        values = self.values[left] + fraction * (self.values[right] - self.values[left])
        is_off = (left == right) | self.holes[left]
        to_left, to_right = np.abs(when - self.times[left]), np.abs(when - self.times[right])
        nearest = np.where(to_left <= to_right, self.values[left], self.values[right])
        is_near = np.minimum(to_left, to_right) <= slack
        found: Floats = np.where(is_off, np.where(is_near, nearest, np.nan), values)
        return found


@dataclass(frozen=True, eq=False)
class CurveColumn:
    """The curves of one column, one for each track, on a grid.

    Parameters
    ----------
    bound : float
        Largest distance from any sample.
    step : float
        Unit of values.
    unit : int
        Units of time in a second.
    knots : tuple of int64 array, shape (k, 3)
        For each track, kind, time and value of its knots.
    """

    bound: float
    step: float
    unit: int
    knots: tuple[_Ints, ...]

    def curve(self, track: int) -> Curve:
        """The curve of the track with this number."""
        kinds, times, values = self.knots[track].T
        return Curve(times / self.unit, values * self.step, np.append(kinds[1:] != GOES_ON, True))


class CurveSlice(NamedTuple):
    """Samples of one track that follow each other.

    Parameters
    ----------
    track : int
        Number of the track.
    times : float64 array, shape (n,)
        Seconds.
    values : array, shape (n,)
        NaN where there is none.
    """

    track: int
    times: Floats
    values: NDArray[np.generic]


def fit_column(
    times: Sequence[Floats], values: Sequence[NDArray[np.generic]], bound: float, name: str = ""
) -> CurveColumn:
    """Fit a curve with the fewest knots to each track, within the bound at every sample.

    Parameters
    ----------
    times, values : sequence of arrays, shape (n,)
        Seconds, and values of each track; NaN where there is none.
    bound : float
        Largest distance.
    name : str
        Name of the column, for errors.

    Raises
    ------
    OptionError
        If the column holds texts, or values or times too large, or too close, for the bound.

    Examples
    --------
    >>> column = fit_column([np.arange(5.0)], [np.array([0.0, 1, 2.2, 2.9, 4])], 0.5)
    >>> column.knots[0].tolist()
    [[2, 0, 0], [0, 4, 16]]
    """
    slices = [
        CurveSlice(track, when, own)
        for track, (when, own) in enumerate(zip(times, values, strict=True))
    ]
    return fit_slices(lambda: slices, len(slices), bound, name)


def fit_slices(
    slices: Callable[[], Iterable[CurveSlice]],
    tracks: int,
    bound: float,
    name: str = "",
    *,
    step: float | None = None,
    max_knots: int | None = None,
) -> CurveColumn:
    """Fit curves as :func:`fit_column` does to a log of any length, slice by slice.

    A knot more may stand where two slices of a track meet.

    Parameters
    ----------
    slices : callable
        Returns all slices, track by track and in the order of time; it is called several times.
    tracks : int
        Number of tracks.
    bound, name
        As for :func:`fit_column`.
    step : float, optional
        Unit of values; half of the bound by default.
    max_knots : int, optional
        Most knots that there is memory for.

    Raises
    ------
    OptionError
        As for :func:`fit_column`; also if there are too many knots.

    Examples
    --------
    >>> when = np.arange(4.0)
    >>> slices = [CurveSlice(0, when, when), CurveSlice(0, when + 4, when + 4)]
    >>> fit_slices(lambda: slices, 1, 0.5).knots[0][:, 1].tolist()
    [0, 3, 4, 7]
    """
    # Values that the grid can count.
    step = bound * _STEP_SHARE if step is None else step
    largest, coarsest = 0.0, 0
    for each in slices():
        numbers = np.abs(_as_numbers(each.values, name))
        largest = max(largest, float(np.fmax.reduce(numbers, initial=0.0)))
        coarsest = max(coarsest, _coarsest_unit(each.times))
    if not largest / step < _MAX_MAGNITUDE:
        raise OptionError(
            f"column {name!r} has values up to {largest:.3g}, too many for a bound of {bound:g}",
            remedy="keep it exactly, or allow a larger error",
        )

    # The coarsest unit of time that all times are on; finer ones where rounding breaks the bound.
    for unit, slack in product(UNITS[coarsest:], _SLACK_SHARES):
        grid = CurveColumn(bound, step, unit, ())
        knots = _fit_all(slices(), tracks, grid, slack, name, max_knots)
        if knots is None:
            continue
        column = CurveColumn(bound, step, unit, knots)
        if np.ptp(times_of_knots(column)) < _MAX_MAGNITUDE:
            return column
    raise OptionError(
        f"column {name!r} changes too fast, or at times too close, for a bound of {bound:g}",
        remedy="keep it exactly",
    )


def _fit_all(
    slices: Iterable[CurveSlice],
    tracks: int,
    grid: CurveColumn,
    slack: float,
    name: str,
    max_knots: int | None,
) -> tuple[_Ints, ...] | None:
    """Knots of all tracks; None where the grid of times doesn't hold the bound."""
    found: list[list[_Ints]] = [[] for _ in range(tracks)]
    before, count = None, 0
    for each in slices:
        # The knots of the slice, continuing those of the slice before.
        numbers = _as_numbers(each.values, name)
        own = _fit(each.times, numbers, (1 - slack) * grid.bound, grid.step, grid.unit)
        before = before if before is not None and before.track == each.track else None
        earlier = found[each.track]
        if own is None or (len(own) and earlier and earlier[-1][-1, 1] >= own[0, 1]):
            return None
        if len(own) and earlier:
            goes_on = before is not None and not np.isnan([before.values[-1], numbers[0]]).any()
            own[0, 0] = GOES_ON if goes_on else BEGINS_RUN

        # The bound, also at the last sample before: between two slices lies a line, too.
        window = np.concatenate([earlier[-1][-2:], own]) if earlier else own
        times, values = each.times, numbers
        if before is not None and len(own):
            times = np.append(before.times[-1:], times)
            values = np.append(before.values[-1:].astype(np.float64), values)
        if not _holds(CurveColumn(grid.bound, grid.step, grid.unit, (window,)), times, values):
            return None
        if len(own):
            earlier.append(own)
        if len(numbers):
            before = CurveSlice(each.track, each.times, numbers)

        # Knots that there is memory for.
        count += len(own)
        if max_knots is not None and count > max_knots:
            raise OptionError(
                f"column {name!r} takes more than {max_knots:,} knots within {grid.bound:g}, "
                "more than fit the memory",
                remedy="allow a larger error or more --memory, or keep it exactly",
            )
    return tuple(np.concatenate([np.zeros((0, 3), np.int64), *own]) for own in found)


def _as_numbers(values: NDArray[np.generic], name: str) -> Floats:
    """A column as numbers, with NaN for infinite ones."""
    if values.dtype.kind not in "biuf":
        raise OptionError(
            f"column {name!r} holds texts, which have no error",
            remedy=f"keep it exactly: {name}",
        )
    numbers = values.astype(np.float64)
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _coarsest_unit(times: Floats) -> int:
    """Number of the coarsest unit on which all times lie; that of a millisecond where none is."""
    milliseconds = UNITS.index(1000)
    for number, unit in enumerate(UNITS[:milliseconds]):
        if (np.abs(np.rint(times * unit) / unit - times) <= _UNIT_TOLERANCE).all():
            return number
    return milliseconds


def _fit(times: Floats, values: Floats, bound: float, step: float, unit: int) -> _Ints | None:
    """Knots of one slice; None where times are too close, or too large, for the unit."""
    # Times in their unit, of the samples that have a value.
    present = np.flatnonzero(~np.isnan(values))
    if not len(present):
        return np.zeros((0, 3), np.int64)
    scaled = np.rint(times[present] * unit)
    if np.abs(scaled).max() >= MAX_FIRST or (np.diff(scaled) <= 0).any():
        return None
    ticks = scaled.astype(np.int64)

    # Each run between holes by itself.
    starts = np.flatnonzero(np.append(True, np.diff(present) > 1))
    ends = np.append(starts[1:], len(present))
    runs: list[_Ints] = []
    for begin, end in zip(starts.tolist(), ends.tolist(), strict=True):
        run = _fit_run(ticks[begin:end], values[present[begin:end]] / step, bound / step)
        if run is None:
            return None
        run[0, 0] = BEGINS_RUN if runs else BEGINS_TRACK
        runs.append(run)
    return np.concatenate(runs)


def _fit_run(ticks: _Ints, values: Floats, bound: float) -> _Ints | None:
    """Kind, time and value of the fewest knots within a bound of a run of samples."""
    # Lines between slices pass no sample, so that any will do.
    if len(ticks) > _SLICE_SAMPLES:
        slices = [
            _fit_run(ticks[i : i + _SLICE_SAMPLES], values[i : i + _SLICE_SAMPLES], bound)
            for i in range(0, len(ticks), _SLICE_SAMPLES)
        ]
        found = [each for each in slices if each is not None]
        return np.concatenate(found) if len(found) == len(slices) else None

    # The states that are visited.
    width = math.floor(2 * bound) + 1
    lowest = np.empty(len(ticks), np.int64)
    parents = np.empty((len(ticks), width), np.int64)
    queue = np.empty(parents.size, np.int64)
    state = find_knots(ticks, values, bound, _MAX_SAMPLES, lowest, parents, queue)
    if state < 0:
        return None

    # From the last knot back to the first.
    knots = []
    while state >= 0:
        sample, k = divmod(state, width)
        knots.append((GOES_ON, ticks[sample], lowest[sample] + k))
        state = int(parents[sample, k])
    return np.array(knots[::-1], np.int64)


def _holds(column: CurveColumn, times: Floats, values: Floats) -> bool:
    """Whether the first curve of a column is within the bound of samples."""
    found = column.curve(0).at(times)
    is_off = ~(np.abs(found - values) <= column.bound) & ~np.isnan(values)
    return not is_off.any()


def times_of_knots(column: CurveColumn) -> _Ints:
    """Times of the knots of all tracks; a zero where there are none."""
    times = np.concatenate([np.zeros(0, np.int64), *(own[:, 1] for own in column.knots)])
    return times if len(times) else np.zeros(1, np.int64)


def check_range(column: CurveColumn, name: str) -> CurveColumn:
    """Return a column whose numbers can be coded.

    Raises
    ------
    OptionError
        If times span too much, or values are too large, for their units.
    """
    times = times_of_knots(column)
    values = max((int(np.abs(own[:, 2]).max(initial=0)) for own in column.knots), default=0)
    if np.abs(times).max() >= MAX_FIRST or max(int(np.ptp(times)), values) >= _MAX_MAGNITUDE:
        raise OptionError(
            f"the times or values of column {name!r} are too far apart for one archive",
            remedy="keep the archives apart",
        )
    return column


def max_rows(size: int) -> int:
    """Most rows that a payload of ``size`` bytes may have."""
    return _FREE_KNOTS + _KNOTS_PER_BYTE * size


def encode_knots(column: CurveColumn) -> tuple[bytes, int]:
    """Payload of a column, and number of its rows."""
    # A track without knots takes a row of its own.
    first = times_of_knots(column)[0]
    nothing = np.array([[-1, first, 0]], np.int64)
    rows = [own if len(own) else nothing for own in column.knots]
    table = np.concatenate([np.zeros((0, 3), np.int64), *rows])
    kinds, times, values = (np.ascontiguousarray(axis) for axis in table.T)
    times -= first

    # Encode again where the buffer was too short.
    capacity = 64 + 8 * len(table)
    while True:
        coder = new_encoder(capacity)
        code_knots(coder, kinds, times, values, _new_counts(), len(column.knots))
        payload = finish(coder)
        if payload is not None:
            break
        capacity *= 2

    # Zeros up to the bytes that so many knots must have; a decoder reads zeros there anyway.
    needed = -(-(len(table) - max_rows(0)) // _KNOTS_PER_BYTE)
    return payload + bytes(max(0, needed - len(payload))), len(table)


def _new_counts() -> NDArray[np.int32]:
    return np.full((CURVE_CONTEXTS, 2), _INITIAL_COUNT, np.int32)


def decode_knots(payload: bytes, rows: int, first: int, tracks: int) -> tuple[_Ints, ...] | None:
    """Undo :func:`encode_knots`.

    Parameters
    ----------
    payload : bytes
        Untrusted.
    rows : int
        Number of rows, at most :func:`max_rows`.
    first : int
        Time from which knots count.
    tracks : int
        Number of tracks.

    Returns
    -------
    tuple of int64 array, shape (k, 3)
        The knots of each track; None where the bytes are none.
    """
    # Each track takes a row at least.
    if rows < tracks:
        return None
    kinds, times, values = (np.zeros(rows, np.int64) for _ in range(3))
    if code_knots(new_decoder(payload), kinds, times, values, _new_counts(), tracks) != rows:
        return None
    # Sums of forged steps may leave the range, or wrap round.
    largest = max(np.abs(axis.astype(np.float64)).max(initial=0) for axis in (times, values))
    if largest >= 2 * _MAX_MAGNITUDE:
        return None
    times += first

    # Cut before each track.
    table = np.stack([kinds, times, values], axis=1)
    begins = np.flatnonzero((kinds == BEGINS_TRACK) | (kinds < 0))
    own = np.split(table, begins[1:]) if tracks else []
    if any((np.diff(each[:, 1]) <= 0).any() for each in own):
        return None
    return tuple(each if each[0, 0] >= 0 else each[:0] for each in own)
