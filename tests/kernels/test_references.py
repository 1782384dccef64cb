import gc
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import inner, inner_uncounted, jit, jit_uncounted


class Pair(NamedTuple):
    numbers: NDArray[np.int64]
    squares: NDArray[np.int64]


class Mixed(NamedTuple):
    flag: bool
    grid: NDArray[np.float64]
    scale: float
    pair: Pair
    count: int


class Numbers(NamedTuple):
    one: int
    two: float


@inner_uncounted
def _add(pair, more):
    for i in range(len(pair.numbers)):
        pair.numbers[i] += more
        pair.squares[i] = pair.numbers[i] ** 2


@inner_uncounted
def _total(mixed):
    total = 0.0
    for i in range(mixed.grid.shape[0]):
        for j in range(mixed.grid.shape[1]):
            total += mixed.grid[i, j]
    return (total * mixed.scale + mixed.count) * (1 if mixed.flag else -1)


@jit_uncounted
def _add_to_part(mixed, more):
    _add(mixed.pair, more)
    mixed.grid[0, 1] = mixed.pair.squares[1]
    return _total(mixed)


@jit
def _add_twice(pair, more):
    _add(pair, more)
    _add(pair, more)
    return pair.numbers.copy()


@jit
def _choose(pair, first):
    return pair.numbers if first else pair.squares


@inner
def _unite(pair):
    return np.concatenate((pair.numbers, pair.squares))


@jit
def _call_outer(mixed):
    return _add_twice(mixed.pair, 1).sum() + _unite(mixed.pair).sum()


@jit_uncounted
def _sum(numbers):
    one, two = numbers
    return one + two


def _pair():
    return Pair(np.arange(4), np.zeros(4, np.int64))


def test_kernels_change_the_arrays_themselves():
    pair = _pair()
    assert _add_twice(pair, 3).tolist() == [6, 7, 8, 9]
    assert pair.numbers.tolist() == [6, 7, 8, 9]
    assert pair.squares.tolist() == [36, 49, 64, 81]


def test_attributes_of_all_kinds_and_tuples_in_tuples_are_read():
    for flag, sign in ((True, 1), (False, -1)):
        mixed = Mixed(flag, np.ones((2, 3)), 0.5, _pair(), 7)
        # The numbers 2 ... 5 have the squares 4, 9, ...; 9 replaces a one of six.
        assert _add_to_part(mixed, 2) == sign * ((5 + 9) * 0.5 + 7)
        assert mixed.pair.squares.tolist() == [4, 9, 16, 25]


def test_kernels_that_python_calls_are_called_by_kernels_with_references():
    mixed = Mixed(True, np.ones((1, 1)), 1.0, _pair(), 0)
    assert _call_outer(mixed) == (2 + 3 + 4 + 5) * 2 + 4 + 9 + 16 + 25


def test_tuples_of_numbers_are_passed_as_they_are():
    assert _sum(Numbers(2, 0.5)) == 2.5


def test_returned_arrays_outlive_the_tuple():
    pair = Pair(np.full(1000, 5), np.full(1000, 25))
    first, second = _choose(pair, True), _choose(pair, False)
    del pair
    gc.collect()
    others = [np.zeros(1000, np.int64) for _ in range(50)]
    assert first.tolist() == [5] * 1000
    assert second.tolist() == [25] * 1000
    assert len(others) == 50


def test_reference_counts_stay_as_they_were():
    pair = Pair(np.arange(1000), np.zeros(1000, np.int64))
    mixed = Mixed(True, np.ones((2, 3)), 0.5, pair, 7)
    arrays = (*pair, mixed.grid)

    def use():
        _add_twice(pair, 1)
        _add_to_part(mixed, 1)
        _call_outer(mixed)
        _choose(pair, True)

    use()
    before = [sys.getrefcount(array) for array in arrays]
    for _ in range(50):
        use()
    gc.collect()
    assert [sys.getrefcount(array) for array in arrays] == before
    assert pair.numbers[-1] == 999 + 51 * (2 + 1 + 2)


def test_layouts_of_arrays_are_told_apart():
    wide = np.arange(8).reshape(4, 2)
    assert _add_twice(Pair(wide[:, 0], np.zeros(4, np.int64)), 1).tolist() == [2, 4, 6, 8]
    assert _add_twice(_pair(), 1).tolist() == [2, 3, 4, 5]
    assert wide[:, 1].tolist() == [1, 3, 5, 7]
