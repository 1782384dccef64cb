import numpy as np
import pytest

from gpszip.mapping.kernels.assign_max_error import build_directions
from gpszip.mapping.kernels.extreme_samples import mark_extreme_samples
from oracle.extreme_samples import find_extreme_samples


def mark(times, positions, ends, directions, few):
    marks = np.zeros(len(times), bool)
    mark_extreme_samples(times, positions, ends, directions, few, marks)
    return marks


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("seed", range(5))
def test_the_samples_farthest_out_are_marked(seed, dimension):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.1, 1.0, 300))
    positions = np.cumsum(rng.normal(0, 1, (300, dimension)), axis=0)
    # Some slots have many samples, some few and some none.
    ends = np.sort(np.append(rng.integers(0, 300, 14), [0, 0, 300]))
    directions, _ = build_directions(dimension, 4)
    marks = mark(times, positions, ends, directions, 8)
    np.testing.assert_array_equal(
        marks, find_extreme_samples(times, positions, ends, directions, 8)
    )
    assert 0 < marks.sum() < 300


def test_samples_at_one_time_are_no_division_by_zero():
    positions = np.zeros((20, 2))
    positions[7] = 3.0, -1.0
    marks = mark(np.zeros(20), positions, np.array([0, 20]), np.eye(2), 8)
    np.testing.assert_array_equal(np.flatnonzero(marks), [0, 7, 19])
