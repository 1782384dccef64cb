"""Tables of integers, and the grids on which their numbers lie."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gpszip.container.layout import Cursor, encode_varint
from gpszip.errors import CorruptArchiveError
from gpszip.lossless.columns import MAX_VALUE
from gpszip.lossless.grids import Grid, decode_grid, encode_grid, find_grid
from gpszip.lossless.tables import decode_table, encode_table

VALUES = st.integers(-MAX_VALUE + 1, MAX_VALUE - 1)


@st.composite
def tables(draw):
    rows, columns = draw(st.integers(0, 30)), draw(st.integers(1, 4))
    return [
        np.array(draw(st.lists(VALUES, min_size=rows, max_size=rows)), np.int64)
        for _ in range(columns)
    ]


@given(tables())
@settings(deadline=None)
def test_any_table_comes_back(columns):
    cursor = Cursor(encode_table(columns))
    back = decode_table(cursor, len(columns[0]), len(columns))
    cursor.expect_end("the table")
    assert all(np.array_equal(a, b) for a, b in zip(columns, back, strict=True))


@given(st.lists(VALUES, max_size=40), st.integers(0, 17), st.integers(0, 17))
@example([10**15, 3 * 10**15], 15, 0)
def test_any_numbers_come_back_from_their_grid(numbers, decimals, zeros):
    # Numbers such as 1.500000000000000 end with many zeros.
    numbers = np.array([number // 10**zeros * 10**zeros for number in numbers], np.int64)
    data, multiples = encode_grid(find_grid(numbers, decimals), numbers)
    grid, differences = decode_grid(Cursor(data), len(numbers))
    assert np.array_equal(grid.numbers(multiples) + differences, numbers)


@pytest.mark.parametrize("fraction", [60_000, 600_000, 3_600])
def test_fractions_of_a_degree_are_found(fraction):
    multiples = np.random.default_rng(1).integers(-(10**6), 10**6, 5000)
    numbers = np.floor(multiples * (10**7 / fraction) + 0.5).astype(np.int64)
    grid = find_grid(numbers, 7)
    assert grid.denominator / grid.numerator == pytest.approx(fraction / 10**7)
    assert np.array_equal(grid.multiples(numbers), multiples)


def test_a_step_with_exceptions_is_found():
    numbers = np.random.default_rng(2).integers(0, 10**4, 3000) * 1000 + 5
    numbers[[7, 1500]] += [1, -2]
    grid = find_grid(numbers, 3)
    assert grid == Grid(1000, 1, 5)
    data, multiples = encode_grid(grid, numbers)
    assert len(data) < 20
    back, differences = decode_grid(Cursor(data), len(numbers))
    assert np.array_equal(back.numbers(multiples) + differences, numbers)


def test_numbers_without_a_grid_have_a_step_of_one():
    assert find_grid(np.random.default_rng(3).integers(0, 10**7, 3000), 7) == Grid()
    assert find_grid(np.zeros(0, np.int64), 7) == Grid()
    assert find_grid(np.full(9, 4), 7) == Grid()


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([0, 1, 0, 0], "out of range"),
        ([1, 0, 0, 0], "out of range"),
        ([1, 1, 0, 9], "9 exceptions of 5 numbers"),
        ([1, 1, 0, 1, 5, 2], "past the last of 5"),
        ([1, 1, 0], "1 bytes, but 0 are left"),
    ],
)
def test_a_forged_grid_is_refused(numbers, message):
    with pytest.raises(CorruptArchiveError, match=message):
        decode_grid(Cursor(b"".join(map(encode_varint, numbers)) + b""), 5)


def test_times_outside_the_table_are_refused():
    with pytest.raises(CorruptArchiveError, match="times in column 4 of 2"):
        decode_table(Cursor(bytes([4])), 3, 2)
