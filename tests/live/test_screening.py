from collections import Counter

import pytest

from gpszip.live import Fix, Notices
from gpszip.live.screening import Screen

NOW = 1.8e9
WEEKS = 1024 * 7 * 86_400.0


@pytest.fixture
def screen():
    return Screen(Notices([].append))


def fix(position=(48.0, 11.0), time=NOW, **more):
    return Fix("bus", "test", time, NOW, position, **more)


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (fix((float("nan"), 1.0)), "no numbers"),
        (fix((1.0, 1e300)), "no numbers"),
        (fix(time=float("inf")), "no numbers"),
        (fix((90.1, 1.0)), "outside of the earth"),
        (fix((1.0, -180.5)), "outside of the earth"),
        (fix((0.0, 0.0)), "0,0"),
        (fix(time=NOW + 86_401), "future"),
        (fix(time=-5.0), "before 1970"),
    ],
)
def test_what_cannot_be_true_is_left_out_and_counted(wrong, reason):
    lines = []
    notices = Notices(lines.append)
    assert Screen(notices).check(wrong) is None
    assert [reason in line for line in lines] == [True]
    assert sum(notices.counts.values()) == 1


def test_a_day_ahead_is_a_zone_and_not_the_future(screen):
    assert screen.check(fix(time=NOW + 86_399)) is not None


def test_null_island_is_a_place_for_those_who_come_from_near(screen):
    null = fix((0.0, 0.0))
    assert screen.check(null) is None
    assert screen.check(fix((0.3, 0.3))) is not None
    assert screen.check(null) == null
    # Whoever went away from there is not near any more.
    screen.check(fix((48.0, 11.0)))
    assert screen.check(null) is None


@pytest.mark.parametrize("count", [1, 2])
def test_weeks_that_rolled_over_are_repaired(screen, count):
    repaired = screen.check(fix(time=NOW - 60 - count * WEEKS))
    assert (repaired.time, repaired.quality) == (NOW - 60, "rollover")


@pytest.mark.parametrize(
    "age", [0.0, 50 * 86_400.0, 100 * 86_400.0, WEEKS - 9e5, WEEKS + 91 * 86_400]
)
def test_other_ages_are_none_of_a_rollover(screen, age):
    checked = screen.check(fix(time=NOW - age))
    assert checked.time == NOW - age
    assert checked.quality == ("stale" if age > 3600 else "")


def test_a_robot_has_its_own_zero(screen):
    assert screen.check(fix((0.0, 0.0, 1.0), time=7.0, geographic=False)).quality == ""
    assert screen.check(fix((0.0, 0.0), time=-7.0, geographic=False)) is not None


def test_metres_and_degrees_do_not_mix(screen):
    assert screen.check(fix()) is not None
    assert screen.check(fix((1.0, 2.0), geographic=False)) is None


def test_lines_are_told_at_powers_of_ten():
    lines = []
    notices = Notices(lines.append)
    for _ in range(1000):
        notices.note("lost", "bus")
    notices.note("lost", "tram\x1b", "\x07" + "x" * 999)
    assert lines[:4] == ["bus: lost", *(f"bus: lost ({n} by now)" for n in ("10", "100", "1,000"))]
    assert lines[4] == f"tram\\x1b: lost (\\x07{'x' * 159}...)"
    assert notices.counts == Counter({"lost": 1001})
