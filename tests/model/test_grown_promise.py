import pytest

from gpszip.model.promise import Promise, grown_promise, promise_of


@pytest.mark.parametrize("before", [1e-8, 0.000996, 0.24, 5.0, 99.4, 99.6, 1234.0, 9.9e7])
@pytest.mark.parametrize("factor", [1.001, 1.5, 2.0, 7.0, 14.0])
def test_a_promise_that_has_grown_holds_and_tells_what_it_was(before, factor):
    promise = grown_promise(before, before * factor, maximum=True)
    assert promise.maximum
    assert before * factor <= promise.metres * (1 + 1e-12) <= 1.12 * before * factor
    assert promise.before == pytest.approx(before, rel=0.051)


def test_what_has_not_grown_is_said_plainly():
    assert grown_promise(5.0, 5.0, maximum=False) == promise_of(5.0, maximum=False) == Promise(500, -2, False)
    assert grown_promise(0.0, 3.0, maximum=False) == promise_of(3.0, maximum=False)


def test_what_has_grown_beyond_all_steps_counts_as_more_from_the_start():
    promise = grown_promise(1.0, 100.0, maximum=False)
    assert promise.metres >= 100.0
    assert 6.0 < promise.before < 8.0
