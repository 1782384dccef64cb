"""The search for the smallest error whose archive takes at most a given size."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.pipeline.size_search import Try, smallest_error
from random_tests import examples


def falling_sizes(power=1.1, floor=20, scale=300.0, step=1, gain=0.95):
    """Return a function whose sizes fall with the error, and the list of its calls.

    Sizes are multiples of a step, and smaller at efforts above 2.
    """
    calls = []

    def attempt(rmse, effort):
        calls.append((rmse, effort))
        size = floor + int(scale * (gain if effort > 2 else 1.0) / rmse**power) // step * step
        return Try(size, rmse, effort)

    return attempt, calls


@given(
    st.floats(0.8, 1.6),
    st.integers(200, 10_000),
    st.floats(0.01, 100.0),
    st.sampled_from([1, 2, 5, 9]),
)
@examples(60)
def test_smooth_sizes_are_met_within_three_percent_by_few_tries(power, size, first, effort):
    attempt, calls = falling_sizes(power)
    best, _ = smallest_error(attempt, size, first=first, coarsest=1e4, effort=effort)
    assert 0.97 * size <= best.size <= size
    assert len(calls) <= 7
    assert sum(called_effort == effort for _, called_effort in calls) <= (3 if effort > 2 else 7)


@given(st.integers(21, 400), st.sampled_from([10, 60, 150]))
@examples(40)
def test_archives_fit_although_sizes_jump(size, step):
    attempt, _ = falling_sizes(step=step)
    best, _ = smallest_error(attempt, size, first=1.0, coarsest=1e3, effort=5)
    assert best.size <= size


def test_the_smallest_size_is_returned_where_nothing_fits():
    attempt, calls = falling_sizes(floor=20)
    best, smallest = smallest_error(attempt, 15, first=1.0, coarsest=1e6, effort=5)
    assert best is None
    assert smallest == 20
    assert max(rmse for rmse, _ in calls) == pytest.approx(1e6)


def test_a_huge_size_gives_the_finest_error():
    attempt, calls = falling_sizes()
    best, _ = smallest_error(attempt, 10**9, first=1.0, coarsest=1e3, effort=5)
    assert best.error == pytest.approx(1e-3)
    assert len(calls) <= 6


def test_targets_without_a_result_are_skipped():
    attempt, _ = falling_sizes()
    best, _ = smallest_error(
        lambda rmse, effort: None if rmse < 0.5 else attempt(rmse, effort),
        300,
        first=0.1,
        coarsest=1e3,
        effort=5,
    )
    assert best.error >= 0.5
    assert 200 <= best.size <= 300
    assert math.isfinite(best.error)


def test_a_search_without_any_result_finds_nothing():
    nothing = smallest_error(lambda *_: None, 300, first=0.1, coarsest=1e3, effort=5)
    assert nothing == (None, 0)
