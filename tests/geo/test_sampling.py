import numpy as np
import pytest

from gpszip.geo.sampling import sampling_interval
from gpszip.model import Track


def moving(step, count, speed=10.0, name="a", start=0.0):
    times = start + step * np.arange(count)
    return Track(name, times, np.column_stack([speed * times, np.zeros(count)]))


def no_gaps(*tracks):
    return [np.zeros(len(track) - 1, bool) for track in tracks]


def test_a_parked_receiver_says_nothing():
    there, parked = moving(1.0, 100), Track("b", 60.0 * np.arange(500), np.zeros((500, 2)))
    assert sampling_interval([there, parked], no_gaps(there, parked)) == 1.0


def test_of_a_mixed_fleet_the_rarer_samples_matter():
    often, seldom = moving(1.0, 3000), moving(30.0, 100, name="b")
    assert sampling_interval([often, seldom], no_gaps(often, seldom)) == 30.0


def test_gaps_are_no_steps():
    track = Track("a", [0.0, 1.0, 2.0, 500.0], [[0.0], [1.0], [2.0], [9000.0]])
    assert sampling_interval([track], [np.array([False, False, True])]) == 1.0


@pytest.mark.parametrize(
    "track", [Track("a", [0.0], [[1.0, 2.0]]), Track("a", [0.0, 1.0], [[1.0], [1.0]])]
)
def test_who_never_moved_has_no_step(track):
    assert sampling_interval([track], no_gaps(track)) is None
