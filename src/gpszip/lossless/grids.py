"""Grids on which the numbers of a column lie: steps that are longer than its last digit.

A receiver that reports minutes of arc to four places, written in degrees to seven, uses one of 17
numbers. So numbers become multiples of a step, plus exceptions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.container.layout import Cursor, encode_signed, encode_varint

__all__ = ["Grid", "decode_grid", "encode_grid", "find_grid"]

#: Fractions of a degree that devices count in: ten-thousandths and hundred-thousandths of a minute,
#: seconds, and tenths and hundredths of a second.
_FRACTIONS = (60_000, 600_000, 6_000_000, 3_600, 36_000, 360_000)

#: Decimals of numbers that may be such fractions, rounded.
_FRACTION_DECIMALS = range(4, 11)

#: Exceptions are at most one in so many numbers, and a finer grid must have so many fewer values.
_EXCEPTION_SHARE = 200
_GAIN = 0.7

#: Numbers by which grids are ruled out before all are looked at.
_SAMPLE = 1 << 10

#: Numerator and denominator of a step are at most this, so that products fit 64 bits for numbers
#: that matter; others take a step of 1.
_MAX_PART = 10**12
_MAX_PRODUCT = 1 << 62

_Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Grid:
    """The numbers ``offset + k * numerator / denominator``, rounded half up.

    Parameters
    ----------
    numerator, denominator : int, default 1
        The step.
    offset : int, default 0
        Added to all.
    """

    numerator: int = 1
    denominator: int = 1
    offset: int = 0

    def numbers(self, multiples: _Ints) -> _Ints:
        """Return the numbers of these multiples of the step."""
        half = self.denominator // 2
        products = multiples * np.int64(self.numerator) + np.int64(half)
        rounded: _Ints = products // np.int64(self.denominator) + np.int64(self.offset)
        return rounded

    def multiples(self, numbers: _Ints) -> _Ints:
        """Return the nearest multiple of the step for each number."""
        half = self.numerator // 2
        scaled = (numbers - np.int64(self.offset)) * np.int64(self.denominator)
        nearest: _Ints = (scaled + np.int64(half)) // np.int64(self.numerator)
        return nearest

    def fits(self, numbers: _Ints) -> bool:
        """Whether products of these numbers fit 64 bits, and the step a file."""
        if max(self.numerator, self.denominator) > _MAX_PART:
            return False
        largest = int(np.abs(numbers).max(initial=0)) + abs(self.offset)
        return largest * max(self.denominator, 1) + self.numerator < _MAX_PRODUCT


def find_grid(numbers: _Ints, decimals: int) -> Grid:
    """Find the grid of a column.

    Parameters
    ----------
    numbers : int64 array, shape (n,)
        In units of the last digit.
    decimals : int
        Digits after the decimal point.

    Examples
    --------
    >>> find_grid(np.array([100, 400, 250]), 2)
    Grid(numerator=150, denominator=1, offset=100)
    """
    if len(numbers) == 0 or (numbers == numbers[0]).all():
        return Grid()

    # The greatest common divisor of the differences, and of those that are not exceptions.
    first = int(numbers[0])
    candidates = [_common_step(numbers)]
    candidates += [Grid(10**power, 1, first % 10**power) for power in range(1, decimals + 1)]
    if decimals in _FRACTION_DECIMALS:
        candidates += [_fraction(10**decimals, fraction) for fraction in _FRACTIONS]

    # The coarsest grid that nearly all numbers lie on.
    best = Grid()
    for grid in candidates:
        is_coarser = grid.numerator * best.denominator * _GAIN > best.numerator * grid.denominator
        if is_coarser and grid.fits(numbers) and _holds(grid, numbers):
            best = grid
    return best


def encode_grid(grid: Grid, numbers: _Ints) -> tuple[bytes, _Ints]:
    """Encode a grid and the exceptions from it; return them and the multiples of the step."""
    multiples = grid.multiples(numbers)
    differences = numbers - grid.numbers(multiples)
    rows = np.flatnonzero(differences)
    record = [
        encode_varint(grid.numerator),
        encode_varint(grid.denominator),
        encode_varint(grid.offset),
        encode_varint(len(rows)),
    ]
    skipped = np.diff(rows, prepend=-1) - 1
    for skip, difference in zip(skipped.tolist(), differences[rows].tolist(), strict=True):
        record += [encode_varint(skip), encode_signed(difference)]
    return b"".join(record), multiples


def decode_grid(cursor: Cursor, count: int) -> tuple[Grid, _Ints]:
    """Read a grid, and what exceptions add to each of ``count`` numbers."""
    # The grid.
    numerator = cursor.read_varint("a step's numerator")
    denominator = cursor.read_varint("a step's denominator")
    offset = cursor.read_varint("a grid's offset")
    if not 0 < numerator <= _MAX_PART or not 0 < denominator <= _MAX_PART or offset > _MAX_PRODUCT:
        raise cursor.error("the step of a grid is out of range")

    # Numbers off it: how many rows to skip to each, and what it differs by.
    exceptions = cursor.read_varint("the number of exceptions")
    if exceptions > min(count, cursor.remaining):
        raise cursor.error(f"{exceptions} exceptions of {count} numbers")
    differences = np.zeros(count, np.int64)
    row = -1
    for _ in range(exceptions):
        row += cursor.read_varint("an exception's row") + 1
        if row >= count:
            raise cursor.error(f"an exception past the last of {count} numbers")
        differences[row] = np.int64(_wrapped(cursor.read_signed("an exception")))
    return Grid(numerator, denominator, offset), differences


def _wrapped(value: int) -> int:
    """A number of 65 bits at most, modulo 2**64."""
    return (value + (1 << 63)) % (1 << 64) - (1 << 63)


def _common_step(numbers: _Ints) -> Grid:
    """Grid of the greatest common divisor of all differences."""
    step = int(np.gcd.reduce(np.abs(np.diff(numbers))))
    if not 1 < step <= _MAX_PART:
        return Grid()
    return Grid(step, 1, int(numbers[0]) % step)


def _fraction(scale: int, fraction: int) -> Grid:
    """Grid of a fraction of a degree, in units of the last digit."""
    shared = int(np.gcd(scale, fraction))
    return Grid(scale // shared, fraction // shared)


def _holds(grid: Grid, numbers: _Ints) -> bool:
    """Whether nearly all numbers lie on a grid."""
    for part in (numbers[:_SAMPLE], numbers):
        misses = np.count_nonzero(grid.numbers(grid.multiples(part)) != part)
        if misses * _EXCEPTION_SHARE > len(part):
            return False
    return True
