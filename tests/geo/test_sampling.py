import numpy as np
import pytest

from gpszip.geo.sampling import sampling_interval
from gpszip.model import Track


def moving(step, count, speed=10.0, name="a", start=0.0):
    times = start + step * np.arange(count)
    return Track(name, times, np.column_stack([speed * times, np.zeros(count)]))


def no_gaps(*tracks):
    return [np.zeros(len(track) - 1, bool) for track in tracks]


def test_a_parked_receiver_does_not_count():
    driving = moving(1.0, 100)
    parked = Track("b", 60.0 * np.arange(500), np.zeros((500, 2)))
    assert sampling_interval([driving, parked], no_gaps(driving, parked)) == 1.0


def test_in_a_mixed_fleet_the_rarer_samples_determine_the_interval():
    often, seldom = moving(1.0, 3000), moving(30.0, 100, name="b")
    assert sampling_interval([often, seldom], no_gaps(often, seldom)) == 30.0


def test_gaps_do_not_count():
    track = Track("a", [0.0, 1.0, 2.0, 500.0], [[0.0], [1.0], [2.0], [9000.0]])
    assert sampling_interval([track], [np.array([False, False, True])]) == 1.0


@pytest.mark.parametrize(
    "track", [Track("a", [0.0], [[1.0, 2.0]]), Track("a", [0.0, 1.0], [[1.0], [1.0]])]
)
def test_a_log_without_movement_has_no_interval(track):
    assert sampling_interval([track], no_gaps(track)) is None
