"""The estimate of an archive, against the archives that logs become."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.model import Options, Track
from gpszip.model.log import MemoryLog
from gpszip.pipeline.append import append
from gpszip.pipeline.compress import compress
from gpszip.pipeline.estimate import estimate, extrapolate
from gpszip.testing import patrol


def log_of(*tracks):
    return MemoryLog(tracks)


def shuttle(id, n, *, start=0.0):
    """A track that goes back and forth on a line of 100 m."""
    times = start + np.arange(n, dtype=float)
    along = np.abs((2.0 * np.arange(n) + 100) % 200 - 100)
    return Track(id, times, np.stack([along, np.zeros(n)], axis=1))


@pytest.fixture(scope="module")
def rounds():
    return patrol(24_000, seed=3)


def test_a_small_log_is_known_exactly():
    track = shuttle("a", 300)
    options = Options(rmse=0.5, effort=1)
    found = estimate(log_of(track), options)
    archive, report = compress(track, options)
    assert found.is_exact
    assert found.bytes == archive.size
    assert found.gap == report.gap
    assert found.bound == report.bound


def test_the_estimate_of_a_larger_log_is_near_its_archive(rounds):
    options = Options(rmse=0.24, effort=1)
    found = estimate(log_of(rounds), options)
    archive, _ = compress(rounds, options)
    assert found.points == len(rounds)
    assert 0 < found.sampled < len(rounds) / 2
    assert archive.size / 2 < found.bytes < archive.size * 2
    assert found.cpu_seconds > 0


def test_kept_times_count_with_all_their_bytes(rounds):
    bare = estimate(log_of(rounds), Options(rmse=0.24, effort=1))
    kept = estimate(log_of(rounds), Options(rmse=0.24, effort=1, keep_times=True))
    archive, _ = compress(rounds, Options(rmse=0.24, effort=1, keep_times=True))
    columns = sum(len(section.body) for section in archive.contents.extras)
    assert kept.bytes - bare.bytes == pytest.approx(columns, abs=0.05 * columns)


def test_a_size_is_its_own_estimate(rounds):
    found = estimate(log_of(rounds), Options(size=400))
    assert (found.bytes, found.sampled, found.cpu_seconds) == (400, 0, None)
    assert estimate(log_of(rounds), Options(k=4, m=2)).bytes is None


def test_numbers_too_far_from_zero_are_refused_as_for_an_archive():
    far = Track("a", np.arange(9.0), np.outer(np.arange(9.0), [1e300, 0.0]))
    for options in (Options(), Options(rmse=1.0)):
        with pytest.raises(InputError, match="sample 1: a position of 1e\\+300 is too far"):
            estimate(log_of(far), options)


def test_a_known_map_is_not_counted():
    first, second = shuttle("a", 400), shuttle("b", 400, start=1e4)
    options = Options(rmse=0.5, effort=1)
    known, _ = compress(first, options)
    found = estimate(log_of(second), options, map=known)
    assert found.bytes == compress(second, options, map=known)[0].size


def test_an_archive_to_append_to_is_counted():
    first, second = shuttle("a", 400), shuttle("a", 400, start=1e4)
    options = Options(rmse=0.5, effort=1)
    archive, _ = compress(first, options)
    found = estimate(log_of(second), Options(effort=1), extended=archive)
    longer, _ = append(archive, second, Options(effort=1))
    assert found.bytes == longer.size > archive.size


def test_what_is_appended_has_the_bound_and_the_columns_of_the_archive():
    rng = np.random.default_rng(5)
    positions = rng.normal(0, 1, (200, 2)).cumsum(axis=0)
    first = Track("a", np.arange(200.0), positions, attributes={"n": np.arange(200)})
    second = Track("a", np.arange(300.0, 500.0), positions, attributes={"n": np.arange(200)})
    archive, _ = compress(first, Options(max_error=2.0, effort=1, keep=("n",)))
    found = estimate(log_of(second), Options(effort=1), extended=archive)
    longer, report = append(archive, second, Options(effort=1))
    assert (found.bound, found.bytes) == (report.bound, longer.size)


def test_tracks_of_one_name_in_the_archive_and_in_parts_of_the_log_do_not_clash():
    log = patrol(21_000, seed=1)
    archive, _ = compress(
        Track(log.id, log.times - 1e6, log.positions), Options(rmse=1.0, effort=1)
    )
    found = estimate(log_of(log), Options(effort=1), extended=archive)
    assert not found.is_exact
    assert found.bytes > archive.size


@given(
    st.floats(0, 1e6),
    st.floats(0, 1e3),
    st.integers(1, 10**6),
    st.integers(1, 10**6),
    st.integers(0, 10**9),
)
def test_a_map_and_a_share_for_each_point_are_continued_exactly(fixed, share, first, more, further):
    counts = [first, first + more]
    whole = counts[-1] + further
    found = extrapolate(counts, [fixed + share * count for count in counts], whole)
    # The share is known as well as the difference of two values is.
    tolerance = 1e-12 * (fixed + share * counts[-1]) / more * further
    assert found == pytest.approx(fixed + share * whole, rel=1e-9, abs=tolerance)


@given(st.lists(st.floats(1e-3, 1e6), min_size=2, max_size=2), st.integers(200, 10**9))
def test_growth_is_between_none_and_that_of_the_log(values, whole):
    found = extrapolate([100, 200], values, whole)
    assert values[-1] * (1 - 1e-9) <= found <= values[-1] * whole / 200 * (1 + 1e-9)
