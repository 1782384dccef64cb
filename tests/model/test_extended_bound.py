import pytest

from gpszip.model.error_bound import ErrorBound, extended_bound, rounded_bound


@pytest.mark.parametrize("before", [1e-8, 0.000996, 0.24, 5.0, 99.4, 99.6, 1234.0, 9.9e7])
@pytest.mark.parametrize("factor", [1.001, 1.5, 2.0, 7.0, 14.0])
def test_a_promise_that_has_grown_holds_and_tells_what_it_was(before, factor):
    error_bound = extended_bound(before, before * factor, maximum=True)
    assert error_bound.maximum
    assert before * factor <= error_bound.metres * (1 + 1e-12) <= 1.12 * before * factor
    assert error_bound.before == pytest.approx(before, rel=0.051)


def test_what_has_not_grown_is_said_plainly():
    assert (
        extended_bound(5.0, 5.0, maximum=False)
        == rounded_bound(5.0, maximum=False)
        == ErrorBound(500, -2, False)
    )
    assert extended_bound(0.0, 3.0, maximum=False) == rounded_bound(3.0, maximum=False)


def test_what_has_grown_beyond_all_steps_counts_as_more_from_the_start():
    error_bound = extended_bound(1.0, 100.0, maximum=False)
    assert error_bound.metres >= 100.0
    assert 6.0 < error_bound.before < 8.0
