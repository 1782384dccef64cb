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
def test_progress_never_goes_back_and_arrives(seconds, mean, before, after, memory):
    times, progress = interpolate_progress(seconds, mean * seconds, before, after, memory)
    assert times[0] == progress[0] == 0
    assert times[-1] == pytest.approx(seconds)
    assert progress[-1] == pytest.approx(mean * seconds)
    assert (np.diff(progress) >= 0).all()


def test_progress_begins_and_ends_at_the_paces_known():
    times, progress = interpolate_progress(120.0, 1200.0, 4.0, 14.0, 30.0)
    pace = np.diff(progress) / np.diff(times)
    assert pace[0] == pytest.approx(4.0, abs=0.5)
    assert pace[-1] == pytest.approx(14.0, abs=0.5)
    assert pace[len(pace) // 2] > 10


def test_whoever_stands_at_both_ends_and_does_not_go_stays():
    assert (interpolate_progress(60.0, 0.0, 0.0, 0.0, 20.0)[1] == 0).all()


def test_progress_is_what_the_gaussian_process_expects():
    seconds, memory, before, after, whole = 60.0, 25.0, 12.0, 6.0, 600.0
    times, progress = interpolate_progress(seconds, whole, before, after, memory)
    likeness = np.exp(-np.abs(times[:, None] - times) / memory)
    weights = np.full(len(times), times[1])
    weights[[0, -1]] /= 2
    seen = np.stack([np.eye(len(times))[0], np.eye(len(times))[-1], weights])
    mean = whole / seconds
    pace = mean + likeness @ seen.T @ np.linalg.solve(
        seen @ likeness @ seen.T, [before - mean, after - mean, 0.0]
    )
    expected = np.append(0.0, np.cumsum((pace[1:] + pace[:-1]) / 2 * times[1]))
    np.testing.assert_allclose(progress, expected, atol=0.05)


def test_bends_slow_down_who_is_fast():
    line = np.array([[0, 0], [300, 0], [300, 300]], float)
    at = np.linspace(0, 600, 301)
    fast = bend_speed(line, at, acceleration=1.5, top_speed=20.0)
    assert fast[150] < 7
    assert fast[0] == fast[-1] == 20
    assert (np.abs(np.diff(fast**2)) <= 2 * 1.5 * 2.0 + 1e-9).all()
    assert bend_speed(line, at, acceleration=1.5, top_speed=1.4).min() == pytest.approx(1.4)
    assert bend_speed(line[:2], at[:150], acceleration=1.5, top_speed=20.0).min() == pytest.approx(
        20.0
    )


def test_habits_leave_gaps_and_stops_out():
    times = np.r_[np.arange(100), np.arange(1000, 1100)]
    along = np.r_[np.arange(50) * 8.0, np.full(50, 400.0), 5000 + np.arange(100) * 8.0]
    found = measure_motion([Track("a", times, np.stack((along, 0 * along), axis=1))], 30.0)
    assert found.mean_speed == pytest.approx(8.0, rel=0.1)
    assert found.top_speed == pytest.approx(8.0, rel=0.1)


def test_habits_of_nothing():
    assert measure_motion([Track("a", [0], [[0.0, 0.0]])], 30.0).mean_speed > 0
    assert measure_motion([Track("a", [0, 1], [[0.0, 0.0], [0.0, 0.0]])], 30.0).mean_speed > 0


def test_memory_follows_how_alike_speeds_are():
    rng = np.random.default_rng(4)

    def wandering(memory):
        speed, fade = [10.0], np.exp(-1 / memory)
        for kick in rng.normal(size=4000):
            speed.append(10 + fade * (speed[-1] - 10) + np.sqrt(1 - fade**2) * 2 * kick)
        along = np.cumsum(np.maximum(speed, 0))
        return measure_motion(
            [Track("a", np.arange(len(along)), np.stack((along, 0 * along), axis=1))], 30.0
        )

    short, long = wandering(5.0).correlation_time(60.0), wandering(60.0).correlation_time(60.0)
    assert short < 20 < long
    assert MotionStatistics(1.0, 2.0, 1.0, ()).correlation_time(90.0) == 30.0
