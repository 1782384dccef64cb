"""Joining curves of several archives, on one grid and track by track."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.curves import MAX_FIRST, UNITS, CurveColumn, check_range
from gpszip.codec.kernels.curves import BEGINS_RUN, BEGINS_TRACK, GOES_ON
from gpszip.errors import OptionError

__all__ = ["CurvePart", "join_columns"]

#: Seconds by which a curve may begin after its track, or end before it, without a hole in between:
#: ends of tracks are kept to a millisecond.
_SLACK = 2e-3

#: Share by which rounding values to another step may make a bound grow.
_GROWTH = 1e-3

#: Refinements of a step at most, by half, before no grid is found.
_MAX_REFINEMENTS = 64

#: Relative error of floating-point rounding, generously.
_ROUNDING = 1e-9

#: Units of time in a second, at least, where a curve is cut between its knots.
_CUT_UNIT = 1000

_Ints = NDArray[np.int64]


class CurvePart(NamedTuple):
    """The curve of a track over a part of its time.

    Parameters
    ----------
    column : CurveColumn or None
        Where it is; None where the track has no such column in this part.
    track : int
        Its number there.
    begin, end : float
        Seconds of the first and the last sample.
    """

    column: CurveColumn | None
    track: int
    begin: float
    end: float


class _Grid(NamedTuple):
    """Bound, step and unit of time of joined curves."""

    bound: float
    step: float
    unit: int


def join_columns(tracks: Sequence[Sequence[CurvePart]], name: str = "") -> CurveColumn:
    """Join the curves of the parts of each track.

    1. All knots move to one grid. It states the largest of the bounds. Its step is so fine that
       rounding stays within that bound, or adds a thousandth where bounds hardly differ.
    2. Knots that two parts have in common, as parts of one archive do, stand once.
    3. A curve that goes to the end of its part goes on to the beginning of the next one, as within
       one log. Else there is a hole.
    4. Where two parts overlap with different knots, each curve is cut at the end of its own part,
       and rounding adds a thousandth to the bound.

    Parameters
    ----------
    tracks : sequence of sequence of CurvePart
        The parts of each track, in any order. Those of one track don't overlap in time, but for
        rounding.
    name : str
        Name of the column, for errors.

    Raises
    ------
    OptionError
        If no grid holds all curves.

    Examples
    --------
    >>> from gpszip.codec.curves import fit_column
    >>> first = fit_column([np.arange(5.0)], [np.arange(5.0)], 1.0)
    >>> second = fit_column([np.arange(5.0, 9.0)], [np.arange(5.0, 9.0)], 0.5)
    >>> joined = join_columns([[CurvePart(first, 0, 0.0, 4.0), CurvePart(second, 0, 5.0, 8.0)]])
    >>> joined.bound, joined.curve(0).at([4.5]).tolist()
    (1.0, [4.5])
    """
    columns = list({id(p.column): p.column for own in tracks for p in own if p.column}.values())
    ordered = [sorted(own, key=lambda part: (part.begin, part.end)) for own in tracks]
    grid = _common_grid(columns)
    joined = [_join_parts(own, grid, may_cut=False) for own in ordered]
    found = [own for own in joined if own is not None]

    # Where curves have to be cut, on a finer grid.
    if len(found) < len(joined):
        step = grid.step
        while step / 2 > _GROWTH * grid.bound:
            step /= 2
        grid = _Grid(grid.bound + step / 2, step, max(grid.unit, _CUT_UNIT))
        cut = [_join_parts(own, grid, may_cut=True) for own in ordered]
        found = [own for own in cut if own is not None]
    return check_range(CurveColumn(grid.bound, grid.step, grid.unit, tuple(found)), name)


def _common_grid(columns: Sequence[CurveColumn]) -> _Grid:
    """A grid on which all columns stay within the largest of their bounds.

    Rounding the values of knots moves a curve by half a step at most.
    """
    if not columns:
        return _Grid(1.0, 1.0, UNITS[0])
    loosest = max(columns, key=lambda column: column.bound)
    for refinements in range(_MAX_REFINEMENTS):
        step = loosest.step / 2**refinements
        if step == 0:
            break
        bounds = [
            column.bound + (0 if _is_multiple(column.step, step) else (1 + _ROUNDING) * step / 2)
            for column in columns
        ]
        if max(bounds) <= (1 + _GROWTH) * loosest.bound:
            return _Grid(max(bounds), step, max(column.unit for column in columns))
    raise _no_grid_error()


def _is_multiple(step: float, of: float) -> bool:
    """Whether a step is a whole number of others, exactly."""
    ratio = step / of
    return ratio.is_integer() and ratio >= 1 and ratio * of == step


def _join_parts(parts: Sequence[CurvePart], grid: _Grid, *, may_cut: bool) -> _Ints | None:
    """Knots of one track on a grid; None where parts overlap, unless they may be cut."""
    whole, end, is_hole = np.zeros((0, 3), np.int64), -math.inf, False
    for part in parts:
        own = _on_grid(part, grid)
        if not len(own):
            is_hole = True
            continue

        # Knots that both have stand once.
        shared = whole[np.searchsorted(whole[:, 1], own[0, 1]) :]
        count = min(len(shared), len(own))
        if count and _are_equal(shared[:count], own[:count]):
            whole = np.concatenate([whole, own[count:]])
            end, is_hole = part.end, False
            continue

        # Curves that overlap end and begin where the parts do.
        if len(shared):
            if not may_cut:
                return None
            last, first = _cut_times(end, part.begin, grid.unit)
            whole, own = _until(whole, last), _from(own, first)
        if not len(own):
            continue

        # The one goes on to the other unless there is a hole.
        if len(whole):
            to_end = whole[-1, 1] / grid.unit >= end - _SLACK
            from_begin = own[0, 1] / grid.unit <= part.begin + _SLACK
            own[0, 0] = GOES_ON if to_end and from_begin and not is_hole else BEGINS_RUN
        else:
            own[0, 0] = BEGINS_TRACK
        whole = np.concatenate([whole, own])
        end, is_hole = part.end, False
    return whole


def _on_grid(part: CurvePart, grid: _Grid) -> _Ints:
    """Knots of a part, its times and values in units of a grid."""
    if part.column is None:
        return np.zeros((0, 3), np.int64)
    kinds, times, values = part.column.knots[part.track].T
    scaled = [
        _scale(times, grid.unit / part.column.unit),
        _scale(values, part.column.step / grid.step),
    ]
    return np.stack([kinds, *scaled], axis=1)


def _scale(numbers: _Ints, ratio: float) -> _Ints:
    """Multiply integers, exactly by whole numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        product = np.rint(numbers * ratio)
    if not np.abs(product).max(initial=0.0) < MAX_FIRST:
        raise _no_grid_error()
    scaled: _Ints = product.astype(np.int64)
    return scaled


def _no_grid_error() -> OptionError:
    return OptionError(
        "times or values of the curves are too far apart for one archive",
        remedy="keep the archives apart",
    )


def _are_equal(first: _Ints, second: _Ints) -> bool:
    """Whether two series of knots are equal; what the first one begins doesn't matter."""
    same = np.array_equal(first[:, 1:], second[:, 1:])
    return same and np.array_equal(first[1:, 0], second[1:, 0])


def _cut_times(end: float, begin: float, unit: int) -> tuple[int, int]:
    """Time at which a curve ends, and a later one at which the next one begins."""
    last, first = math.ceil(end * unit - _ROUNDING), math.floor(begin * unit + _ROUNDING)
    if last >= first:
        last = (last + first) // 2
        first = last + 1
    return last, first


def _until(knots: _Ints, tick: int) -> _Ints:
    """The curve up to a time."""
    after = int(np.searchsorted(knots[:, 1], tick, side="right"))
    kept = knots[:after]
    if 0 < after < len(knots) and kept[-1, 1] < tick and knots[after, 0] == GOES_ON:
        kept = np.concatenate([kept, [_between(knots[after - 1], knots[after], tick)]])
    return kept


def _from(knots: _Ints, tick: int) -> _Ints:
    """The curve from a time on."""
    first = int(np.searchsorted(knots[:, 1], tick))
    kept = knots[first:].copy()
    if 0 < first < len(knots) and kept[0, 1] > tick and kept[0, 0] == GOES_ON:
        kept = np.concatenate([[_between(knots[first - 1], knots[first], tick)], kept])
    return kept


def _between(left: _Ints, right: _Ints, tick: int) -> _Ints:
    """A knot on the line between two."""
    fraction = (tick - left[1]) / (right[1] - left[1])
    value = left[2] + round(fraction * (right[2] - left[2]))
    return np.array([GOES_ON, tick, value], np.int64)
