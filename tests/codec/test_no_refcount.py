import gc
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.kernels.no_refcount import without_refcount
from gpszip.kernels.jit import jit


class Pair(NamedTuple):
    numbers: NDArray[np.int64]
    squares: NDArray[np.float64]


@jit
def _add(pair, more):
    for i in range(len(pair.numbers)):
        pair.numbers[i] += more
        pair.squares[i] = pair.numbers[i] ** 2


@jit
def _add_twice(pair, more):
    uncounted = without_refcount(pair)
    _add(uncounted, more)
    _add(uncounted, more)
    return uncounted.numbers.sum()


def test_arrays_without_counts_are_the_same_arrays():
    pair = Pair(np.arange(4), np.zeros(4))
    assert _add_twice(pair, 3) == 6 + 4 * 6
    assert pair.numbers.tolist() == [6, 7, 8, 9]
    assert pair.squares.tolist() == [36, 49, 64, 81]


def test_reference_counts_stay_as_they_were():
    pair = Pair(np.arange(1000), np.zeros(1000))
    _add_twice(pair, 1)
    before = [sys.getrefcount(array) for array in pair]
    for _ in range(50):
        _add_twice(pair, 1)
    gc.collect()
    assert [sys.getrefcount(array) for array in pair] == before
    assert pair.numbers[-1] == 999 + 2 * 51
