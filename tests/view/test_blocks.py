import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.view.blocks import LARGEST_INTEGER, pack_lines, pack_numbers
from view.unpacking import unpack, unpack_lines

STEPS = st.sampled_from([1e-3, 0.1, 1.0, 7.5])
NUMBERS = st.floats(-1e9, 1e9)


@given(st.lists(NUMBERS, max_size=40), STEPS)
def test_numbers_come_back_to_within_half_a_step(values, step):
    back = unpack(pack_numbers(values, step))
    np.testing.assert_allclose(back, values, rtol=0, atol=0.5 * step + 1e-6)


@given(st.lists(NUMBERS | st.just(float("nan")), max_size=40), STEPS)
def test_missing_numbers_stay_missing(values, step):
    back = unpack(pack_numbers(values, step, with_nan=True))
    np.testing.assert_array_equal(np.isnan(back), np.isnan(np.array(values, float)))
    np.testing.assert_allclose(back, values, rtol=0, atol=0.5 * step + 1e-6)


@pytest.mark.parametrize(
    ("values", "order"),
    [([5, 2, 9, 1, 7, 0, 8], 0), (np.cumsum([100, 1] * 10), 1), (np.arange(50) * 9, 2)],
)
def test_differences_are_taken_where_they_are_small(values, order):
    block = pack_numbers(values)
    assert block["order"] == order
    np.testing.assert_array_equal(unpack(block), values)


def test_regular_times_take_hardly_any_bytes():
    assert len(pack_numbers(1.7e9 + 0.1 * np.arange(100_000), 1e-3)["data"]) < 1000


def test_numbers_that_span_more_than_the_page_counts_are_refused():
    assert unpack(pack_numbers([0.0, LARGEST_INTEGER - 1.0])).tolist() == [0, LARGEST_INTEGER - 1]
    with pytest.raises(OverflowError, match="in steps of 1"):
        pack_numbers([0.0, float(LARGEST_INTEGER)])


def test_lines_come_back():
    points = np.array([[0.0, 1.0, 9.0], [2.0, 3.0, 9.0], [4.0, 5.0, 9.0]])
    lines = unpack_lines(pack_lines(points, np.array([0, 1, 1, 3]), 0.5))
    assert [line.tolist() for line in lines] == [[[0, 1]], [], [[2, 3], [4, 5]]]
