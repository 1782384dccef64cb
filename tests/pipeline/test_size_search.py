import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.pipeline.size_search import Try, smallest_error


def falling(power=1.1, floor=20, scale=300.0, step=1, gain=0.95):
    """Sizes that fall with the error, in steps, and are smaller at more effort; with the tries that were made."""
    asked = []

    def attempt(rmse, effort):
        asked.append((rmse, effort))
        size = floor + int(scale * (gain if effort > 2 else 1.0) / rmse**power) // step * step
        return Try(size, rmse, effort)

    return attempt, asked


@given(
    st.floats(0.8, 1.6),
    st.integers(200, 10_000),
    st.floats(0.01, 100.0),
    st.sampled_from([1, 2, 5, 9]),
)
@settings(max_examples=60, deadline=None)
def test_smooth_sizes_are_met_within_three_percent_by_few_tries(power, size, first, effort):
    attempt, asked = falling(power)
    found, _ = smallest_error(attempt, size, first=first, coarsest=1e4, effort=effort)
    assert 0.97 * size <= found.size <= size
    assert len(asked) <= 7
    assert sum(tried == effort for _, tried in asked) <= (3 if effort > 2 else 7)


@given(st.integers(21, 400), st.sampled_from([10, 60, 150]))
@settings(max_examples=40, deadline=None)
def test_sizes_that_jump_are_never_above(size, step):
    attempt, _ = falling(step=step)
    found, _ = smallest_error(attempt, size, first=1.0, coarsest=1e3, effort=5)
    assert found.size <= size


def test_what_even_the_coarsest_exceeds_is_told():
    attempt, asked = falling(floor=20)
    found, smallest = smallest_error(attempt, 15, first=1.0, coarsest=1e6, effort=5)
    assert found is None
    assert smallest == 20
    assert max(rmse for rmse, _ in asked) == pytest.approx(1e6)


def test_more_than_enough_ends_at_the_finest():
    attempt, asked = falling()
    found, _ = smallest_error(attempt, 10**9, first=1.0, coarsest=1e3, effort=5)
    assert found.error == pytest.approx(1e-3)
    assert len(asked) <= 6


def test_targets_of_which_nothing_comes_are_left_behind():
    attempt, _ = falling()
    found, _ = smallest_error(
        lambda r, e: None if r < 0.5 else attempt(r, e), 300, first=0.1, coarsest=1e3, effort=5
    )
    assert found.error >= 0.5
    assert 200 <= found.size <= 300
    assert smallest_error(lambda _r, _e: None, 300, first=0.1, coarsest=1e3, effort=5) == (None, 0)
    assert math.isfinite(found.error)
