import pytest

from gpszip.model.error_bound import ErrorBound, extended_bound, rounded_bound, rounded_bounds


@pytest.mark.parametrize("before", [1e-8, 0.000996, 0.24, 5.0, 99.4, 99.6, 1234.0, 9.9e7])
@pytest.mark.parametrize("factor", [1.001, 1.5, 2.0, 7.0, 14.0])
def test_an_extended_bound_holds_and_keeps_what_it_was(before, factor):
    error_bound = extended_bound(before, before * factor, maximum=True)
    assert error_bound.maximum
    assert before * factor <= error_bound.metres * (1 + 1e-12) <= 1.12 * before * factor
    assert error_bound.before == pytest.approx(before, rel=0.051)


def test_a_bound_that_is_no_larger_is_a_plain_one():
    assert (
        extended_bound(5.0, 5.0, maximum=False)
        == rounded_bound(5.0, maximum=False)
        == ErrorBound(500, -2, False)
    )
    assert extended_bound(0.0, 3.0, maximum=False) == rounded_bound(3.0, maximum=False)


def test_a_bound_that_outgrows_all_steps_counts_as_larger_from_the_start():
    error_bound = extended_bound(1.0, 100.0, maximum=False)
    assert error_bound.metres >= 100.0
    assert 6.0 < error_bound.before < 8.0


def test_bounds_in_words():
    assert repr(rounded_bounds(3.0, 12.0)) == "ErrorBound(RMSE <= 3 m, maximum <= 12 m)"
    assert repr(rounded_bound(0.4, maximum=True)) == "ErrorBound(maximum <= 0.4 m)"
    extended = extended_bound(5.0, 9.9, maximum=False)
    assert repr(extended) == "ErrorBound(RMSE <= 10 m, 5 m before merges)"
