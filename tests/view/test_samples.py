import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.model import Track, Walk
from gpszip.view.samples import Samples, collect_samples, thin_samples

NODES = np.array([[0.0, 0.0], [10.0, 0.0]])


def lane(id="lane", offset=0.0):
    """A track along the x axis, ``offset`` metres beside it."""
    times = np.arange(11.0)
    return Track(id, times, np.column_stack([times, np.full(11, offset)]))


def walk(id="lane"):
    return Walk(id, np.array([0, 1], np.int32), np.array([0.0, 10.0]), np.array([False]))


def test_errors_are_those_of_the_walk_of_the_same_name():
    samples = collect_samples([lane("b", 3.0), lane("a", 1.0)], [walk("a"), walk("b")], NODES)
    assert samples.walks.tolist() == [1, 0]
    np.testing.assert_allclose(samples.errors, [3.0] * 11 + [1.0] * 11)
    assert samples.rmse == pytest.approx(np.sqrt(5.0))
    assert samples.max_error == pytest.approx(3.0)


def test_tracks_that_the_archive_does_not_have_have_no_errors():
    samples = collect_samples([lane("a"), lane("b")], [walk("lane")], NODES)
    assert samples.walks.tolist() == [-1, -1]
    assert np.isnan(samples.errors).all()
    assert (samples.rmse, samples.max_error) == (None, None)


@given(st.lists(st.integers(1, 30), min_size=1, max_size=6), st.integers(1, 60), st.randoms())
def test_thinned_samples_are_the_worst_of_each_run(counts, most, random):
    # Errors are all different, and some samples have none.
    n = sum(counts)
    errors = np.array(random.sample(range(1, n + 1), n), float)
    errors[errors % 7 == 0] = np.nan
    offsets = np.concatenate([[0], np.cumsum(counts)])
    every = np.arange(float(n))
    samples = Samples(
        ids=tuple(map(str, range(len(counts)))),
        timed=(True,) * len(counts),
        walks=np.zeros(len(counts), np.int64),
        offsets=offsets,
        positions=every[:, None],
        times=every,
        errors=errors,
        total=n,
    )
    thinned = thin_samples(samples, most)

    # Take the worst of each run by hand.
    length = -(-n // most)
    kept = []
    for first, last in zip(offsets[:-1], offsets[1:], strict=True):
        for begin in range(first, last, length):
            run = range(begin, min(begin + length, last))
            kept.append(max(run, key=lambda i: (-1 if np.isnan(errors[i]) else errors[i], -i)))
    assert thinned.times.tolist() == kept
    assert thinned.total == n
    assert thinned.max_error == samples.max_error
    assert len(thinned.times) <= most + len(counts)
    assert np.diff(thinned.offsets).min() >= 1
