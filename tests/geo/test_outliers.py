import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.geo.outliers import find_outliers


def drive(n=300, seed=0):
    """A car that turns, slows and stops, with noise."""
    rng = np.random.default_rng(seed)
    speed = 12 * (1 + np.sin(np.arange(n) / 15))
    heading = np.cumsum(rng.normal(0, 0.1, n))
    path = np.cumsum(speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    return np.arange(n, dtype=float), path + rng.normal(0, 2, (n, 2))


@pytest.mark.parametrize("seed", range(20))
def test_a_plausible_drive_has_no_outliers(seed):
    assert not find_outliers(*drive(seed=seed)).any()


@pytest.mark.parametrize("run", [1, 2, 3, 4])
def test_short_runs_of_outliers_are_found_exactly(run):
    times, positions = drive()
    positions[100 : 100 + run] += [5000, -3000]
    positions[200 : 200 + run] += [0, 40000]
    outliers = np.flatnonzero(find_outliers(times, positions))
    assert outliers.tolist() == [*range(100, 100 + run), *range(200, 200 + run)]


def test_a_jump_without_a_return_stays():
    times, positions = drive()
    positions[150:] += [800_000, 0]
    assert not find_outliers(times, positions).any()


def test_an_outlier_in_three_samples_is_found():
    assert find_outliers([0, 1, 2], [[0, 0], [9999, 0], [2, 0]]).tolist() == [False, True, False]


@pytest.mark.parametrize("n", [1, 2])
def test_fewer_than_three_samples_have_no_outliers(n):
    assert not find_outliers(np.arange(n), np.arange(n)[:, None] * 1e9).any()


def test_a_stationary_track_has_no_outliers():
    assert not find_outliers(np.arange(50), np.zeros((50, 2))).any()


@given(st.integers(0, 10**6), st.floats(-1e9, 1e9), st.floats(-1e7, 1e7))
def test_outliers_do_not_depend_on_the_origin(seed, time_shift, position_shift):
    times, positions = drive(60, seed)
    positions[30] += [20_000, 0]
    shifted = find_outliers(times + time_shift, positions + position_shift)
    assert (find_outliers(times, positions) == shifted).all()
