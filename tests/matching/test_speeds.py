import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.matching.speeds import (
    MotionStatistics,
    bend_speed,
    interpolate_progress,
    measure_motion,
)
from gpszip.model import Track


@given(st.floats(20, 600), st.floats(1, 20), st.floats(0, 30), st.floats(0, 30), st.floats(5, 200))
def test_progress_never_goes_back_and_arrives(seconds, mean, before, after, correlation_time):
    times, progress = interpolate_progress(seconds, mean * seconds, before, after, correlation_time)
    assert times[0] == progress[0] == 0
    assert times[-1] == pytest.approx(seconds)
    assert progress[-1] == pytest.approx(mean * seconds)
    assert (np.diff(progress) >= 0).all()


def test_progress_begins_and_ends_at_the_known_speeds():
    times, progress = interpolate_progress(120.0, 1200.0, 4.0, 14.0, 30.0)
    speed = np.diff(progress) / np.diff(times)
    assert speed[0] == pytest.approx(4.0, abs=0.5)
    assert speed[-1] == pytest.approx(14.0, abs=0.5)
    assert speed[len(speed) // 2] > 10


def test_an_agent_that_does_not_move_makes_no_progress():
    assert (interpolate_progress(60.0, 0.0, 0.0, 0.0, 20.0)[1] == 0).all()


def test_progress_is_the_expectation_of_the_gaussian_process():
    seconds, correlation_time, before, after, distance = 60.0, 25.0, 12.0, 6.0, 600.0
    times, progress = interpolate_progress(seconds, distance, before, after, correlation_time)

    # condition the discretised process on both ends and the integral
    covariance = np.exp(-np.abs(times[:, None] - times) / correlation_time)
    weights = np.full(len(times), times[1])
    weights[[0, -1]] /= 2
    known = np.stack([np.eye(len(times))[0], np.eye(len(times))[-1], weights])
    mean = distance / seconds
    speed = mean + covariance @ known.T @ np.linalg.solve(
        known @ covariance @ known.T, [before - mean, after - mean, 0.0]
    )
    expected = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * times[1]))
    np.testing.assert_allclose(progress, expected, atol=0.05)


def test_bends_slow_down_fast_agents_only():
    line = np.array([[0, 0], [300, 0], [300, 300]], float)
    along = np.linspace(0, 600, 301)
    fast = bend_speed(line, along, acceleration=1.5, top_speed=20.0)
    assert fast[150] < 7
    assert fast[0] == fast[-1] == 20
    assert (np.abs(np.diff(fast**2)) <= 2 * 1.5 * 2.0 + 1e-9).all()
    slow = bend_speed(line, along, acceleration=1.5, top_speed=1.4)
    assert slow.min() == pytest.approx(1.4)
    straight = bend_speed(line[:2], along[:150], acceleration=1.5, top_speed=20.0)
    assert straight.min() == pytest.approx(20.0)


def test_motion_leaves_out_gaps_and_stops():
    times = np.r_[np.arange(100), np.arange(1000, 1100)]
    along = np.r_[np.arange(50) * 8.0, np.full(50, 400.0), 5000 + np.arange(100) * 8.0]
    motion = measure_motion([Track("a", times, np.stack((along, 0 * along), axis=1))], 30.0)
    assert motion.mean_speed == pytest.approx(8.0, rel=0.1)
    assert motion.top_speed == pytest.approx(8.0, rel=0.1)


@pytest.mark.parametrize("samples", [1, 2])
def test_motion_of_a_track_that_stands_has_a_default_speed(samples):
    track = Track("a", np.arange(samples), np.zeros((samples, 2)))
    assert measure_motion([track], 30.0).mean_speed > 0


def test_correlation_time_follows_the_autocorrelation_of_speeds():
    rng = np.random.default_rng(4)

    def motion_with(correlation_time):
        speed, decay = [10.0], np.exp(-1 / correlation_time)
        for kick in rng.normal(size=4000):
            speed.append(10 + decay * (speed[-1] - 10) + np.sqrt(1 - decay**2) * 2 * kick)
        along = np.cumsum(np.maximum(speed, 0))
        positions = np.stack((along, 0 * along), axis=1)
        return measure_motion([Track("a", np.arange(len(along)), positions)], 30.0)

    short, long = (motion_with(time).correlation_time(60.0) for time in (5.0, 60.0))
    assert short < 20 < long
    assert MotionStatistics(1.0, 2.0, 1.0, ()).correlation_time(90.0) == 30.0
