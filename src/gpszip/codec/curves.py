"""Columns kept within an error: piecewise-linear curves over time, with knots of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    "decode_knots",
    "encode_knots",
    "fit_column",
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
    columns = [_as_numbers(each, name) for each in values]
    largest = max(
        (float(np.nanmax(np.abs(v))) for v in columns if not np.isnan(v).all()), default=0
    )
    if not largest / (bound * _STEP_SHARE) < _MAX_MAGNITUDE:
        raise OptionError(
            f"column {name!r} has values up to {largest:.3g}, too many for a bound of {bound:g}",
            remedy="keep it exactly, or allow a larger error",
        )

    # The coarsest unit of time that all times are on; finer ones where rounding breaks the bound.
    step = bound * _STEP_SHARE
    for unit, slack in product(UNITS[_coarsest_unit(times) :], _SLACK_SHARES):
        knots = tuple(
            _fit(each, numbers, (1 - slack) * bound, step, unit)
            for each, numbers in zip(times, columns, strict=True)
        )
        column = CurveColumn(bound, step, unit, tuple(k for k in knots if k is not None))
        if len(column.knots) < len(times) or np.ptp(times_of_knots(column)) >= _MAX_MAGNITUDE:
            continue
        if _holds(column, times, columns):
            return column
    raise OptionError(
        f"column {name!r} changes too fast, or at times too close, for a bound of {bound:g}",
        remedy="keep it exactly",
    )


def _as_numbers(values: NDArray[np.generic], name: str) -> Floats:
    """A column as numbers, with NaN for infinite ones."""
    if values.dtype.kind not in "biuf":
        raise OptionError(
            f"column {name!r} holds texts, which have no error",
            remedy=f"keep it exactly: {name}",
        )
    numbers = values.astype(np.float64)
    return np.where(np.isfinite(numbers), numbers, np.nan)


def _coarsest_unit(times: Sequence[Floats]) -> int:
    """Number of the coarsest unit on which all times lie; that of a millisecond where none is."""
    milliseconds = UNITS.index(1000)
    for number, unit in enumerate(UNITS[:milliseconds]):
        if all((np.abs(np.rint(t * unit) / unit - t) <= _UNIT_TOLERANCE).all() for t in times):
            return number
    return milliseconds


def _fit(times: Floats, values: Floats, bound: float, step: float, unit: int) -> _Ints | None:
    """Knots of one track; None where times are too close, or too large, for the unit."""
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


def _holds(column: CurveColumn, times: Sequence[Floats], values: Sequence[Floats]) -> bool:
    """Whether the bound holds at every sample, and holes are where they were."""
    for track, (when, own) in enumerate(zip(times, values, strict=True)):
        found = column.curve(track).at(when)
        is_off = ~(np.abs(found - own) <= column.bound) & ~np.isnan(own)
        if is_off.any():
            return False
    return True


def times_of_knots(column: CurveColumn) -> _Ints:
    """Times of the knots of all tracks; a zero where there are none."""
    times = np.concatenate([np.zeros(0, np.int64), *(own[:, 1] for own in column.knots)])
    return times if len(times) else np.zeros(1, np.int64)


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
