"""Jumps on a metric plane."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.live import Fix, Marks, Notices
from gpszip.live.jumps import Jumps
from gpszip.live.screening import Screen


def fix(time, x, agent="r", **more):
    return Fix(agent, "ros", time, time, (x, 0.0), geographic=False, **more)


def check(fixes, screen=None):
    """Whether each fix is a break."""
    screen = screen or Screen(Notices(str))
    return [Marks.BREAK in screen.check(each).quality for each in fixes]


@given(
    st.lists(st.floats(-9.9, 9.9), min_size=1, max_size=30),
    st.sampled_from([0.02, 0.1, 1.0, 5.0, 60.0]),
    st.floats(0, 300),
)
def test_whoever_accelerates_with_less_than_1_g_never_jumps(accelerations, seconds, speed):
    # Between two fixes, speeds change by 40 m/s at most, whatever the interval.
    x = 0.0
    fixes = [fix(0.0, 0.0)]
    for number, acceleration in enumerate(accelerations, 1):
        gain = max(min(acceleration * seconds, 39.9), -39.9)
        x += (speed + gain / 2) * seconds
        speed += gain
        fixes.append(fix(number * seconds, x, speed=abs(speed)))
    assert not any(check(fixes))


@given(st.floats(1.6, 1e6), st.floats(0, 60))
def test_corrections_of_a_map_are_breaks_and_speed_is_not_learned_from_them(metres, speed):
    fixes = [fix(t / 10, speed * t / 10 + (metres if t >= 5 else 0)) for t in range(10)]
    assert check(fixes) == [t == 5 for t in range(10)]
    # Backwards, what was travelled counts against it.
    fixes = [fix(t / 10, speed * t / 10 - (metres + speed / 5 if t >= 5 else 0)) for t in range(10)]
    assert check(fixes) == [t == 5 for t in range(10)]


@pytest.mark.parametrize("silence", [8.0, 15.0, 60.0, 3600.0])
def test_a_fast_drive_after_a_silence_is_no_jump(silence):
    # A car stands at a light; at the next fix, it has driven at 30 m/s all the time.
    still = [fix(float(t), 0.1 * (t % 2)) for t in range(5)]
    assert not any(check([*still, fix(4.0 + silence, 30.0 * silence)]))


def test_degrees_do_not_jump_and_agents_are_told_apart():
    degrees = [Fix("r", "gpsd", 1.7e9 + t, 1.7e9 + t, (48.0 + t, 11.0)) for t in range(3)]
    assert not any(check(degrees))
    assert not any(check([fix(1.0, 0.0), fix(1.1, 900.0, "s"), fix(1.2, 0.1)]))


def test_a_fix_that_comes_again_is_the_same_break():
    # A disk that was full for a while.
    screen = Screen(Notices(str))
    fixes = [fix(t / 10, x) for t, x in enumerate([0.0, 0.1, 50.0, 50.1, 0.0])]
    expected = [False, False, True, False, True]
    assert check(fixes, screen) == expected
    assert check(fixes, screen) == expected
    # A source may know of a break, however small.
    assert check([fix(0.5, 0.0, quality="break")], screen) == [True]


def test_the_first_move_says_how_fast_an_agent_is():
    assert check([fix(0.0, 0.0), fix(1.0, 250.0), fix(2.0, 500.0), fix(3.0, 900.0)]) == [
        *[False] * 3,
        True,
    ]


def test_what_was_stored_before_counts():
    screen = Screen(Notices(str))
    for t in range(3):
        screen.remember(fix(t / 10, 2.0 * t))
    # At 20 m/s, 44 m in 2 s are a way; 60 m would be, too, as the speed may have grown.
    assert check([fix(2.2, 44.0)], screen) == [False]
    assert check([fix(2.3, 0.0)], screen) == [True]


def test_memory_is_bounded(monkeypatch):
    from gpszip.live import jumps as module

    monkeypatch.setattr(module, "_MAX_AGENTS", 3)
    jumps = Jumps(Notices(str))
    for number in range(9):
        jumps.check(fix(1.0, 0.0, f"r{number}"))
    assert list(jumps._states) == ["r6", "r7", "r8"]
