import numpy as np
import pytest

from gpszip.geo.gaps import estimate_gap, find_gaps, find_long_intervals
from gpszip.model import Plane, Track


def track(times, name="a"):
    times = np.asarray(times, dtype=float)
    return Track(name, times, np.zeros((len(times), 2)))


def from_steps(steps, start=0.0):
    return track(start + np.concatenate([[0], np.cumsum(steps)]))


def test_a_single_sample_and_regular_sampling_have_no_gap():
    assert estimate_gap([track([5.0])]) == np.inf
    assert estimate_gap([]) == np.inf
    assert estimate_gap([track(np.arange(1000) * 60.0)]) == np.inf


def test_a_short_dropout_of_a_robot_is_no_gap_but_a_lunch_break_is():
    rng = np.random.default_rng(1)
    steps = 1 / 13 + rng.uniform(-0.002, 0.002, 5000)
    steps[100] = 3.0
    assert estimate_gap([from_steps(steps)]) == np.inf
    steps[2000] = 1800.0
    log = from_steps(steps)
    gap = estimate_gap([log])
    assert gap == 10.0
    assert np.flatnonzero(find_long_intervals(log.times, gap)).tolist() == [2000]


def test_a_taxi_that_reports_about_each_minute_has_gaps_at_its_pauses_only():
    rng = np.random.default_rng(2)
    steps = rng.choice(
        [15, 54, 60, 61, 68, 170], 4000, p=[0.06, 0.2, 0.5, 0.14, 0.08, 0.02]
    ).astype(float)
    steps[[500, 900]] = [4000, 30000]
    log = from_steps(steps)
    assert np.flatnonzero(find_long_intervals(log.times, estimate_gap([log]))).tolist() == [
        500,
        900,
    ]


def test_a_phone_that_logs_in_short_bursts_has_gaps_between_them():
    steps = np.tile([2.0, 2.0, 3.0, 2.0, 5000.0], 200)
    log = from_steps(steps)
    gap = estimate_gap([log])
    assert 10 <= gap <= 600
    assert find_long_intervals(log.times, gap).sum() == 200


def test_a_slow_vehicle_in_a_mixed_fleet_has_no_gaps():
    fast = from_steps(np.ones(20000))
    slow = from_steps(np.full(100, 60.0))
    assert estimate_gap([fast, slow]) == np.inf


@pytest.mark.parametrize("shift", [0.0, 1e9, -1e9, 1.7e9 + 0.123])
def test_gaps_do_not_depend_on_the_origin_of_times(shift):
    rng = np.random.default_rng(4)
    steps = np.round(
        rng.choice([1.0, 1.0, 1.0, 30.0, 30.001, 90.0], 3000, p=[0.6, 0.2, 0.16, 0.02, 0.01, 0.01]),
        3,
    )
    plain, shifted = from_steps(steps), from_steps(steps, shift)
    assert estimate_gap([plain]) == estimate_gap([shifted]) == 30.0
    assert (
        find_long_intervals(plain.times, 30.0) == find_long_intervals(shifted.times, 30.0)
    ).all()
    assert find_long_intervals(shifted.times, 30.0).sum() == (steps > 30).sum()


def test_an_infinite_gap_is_never_exceeded():
    assert not find_long_intervals([0.0, 1.0, 1e12], np.inf).any()
    assert find_long_intervals([1.0], 5.0).shape == (0,)


def test_a_change_of_plane_is_a_gap_however_short():
    plane = Plane(((476_200_000, -1_223_500_000), (400_000_000, -740_000_000)))
    track = Track(
        "a",
        [0.0, 1.0, 2.0, 90.0],
        [[0.0, 0.0], [9.0, 0.0], [Plane.SPREAD, 0.0], [Plane.SPREAD + 5.0, 0.0]],
        plane=plane,
    )
    assert find_gaps(track, 30.0).tolist() == [False, True, True]


def test_shapes_have_no_long_intervals():
    """The "times" of a shape are metres."""
    positions = [[0.0, 0.0], [9000.0, 0.0]]
    assert not find_gaps(Track("plan", [0.0, 9000.0], positions, timed=False), 30.0).any()
    assert find_gaps(Track("ride", [0.0, 9000.0], positions), 30.0).all()
