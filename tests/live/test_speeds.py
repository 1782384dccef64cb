import numpy as np
import pytest

from gpszip.live import Fix, Notices
from gpszip.live.speeds import SpeedUnits

#: m/s of a knot, a kilometre an hour and a mile an hour, and of two mistakes.
UNITS = {"knots": 0.514444, "km/h": 1 / 3.6, "mph": 0.44704}
MISTAKES = {"m/s read as knots": 1 / 0.514444, "m/s read as km/h": 3.6}


def drive(unit, count=80, agent="van", speed=12.0, seed=1):
    """A drive in circles with noise of 1 m, and speeds in some unit."""
    rng = np.random.default_rng(seed)
    angle = speed * np.arange(count) / 300
    north, east = (300 * axis + rng.normal(0, 1, count) for axis in (np.sin(angle), np.cos(angle)))
    reported = rng.normal(speed, 0.4, count) / unit
    for t in range(count):
        position = (48 + north[t] / 111_200, 11 + east[t] / 74_400)
        yield Fix(agent, "test", 1.7e9 + t, 1.7e9 + t, position, speed=float(reported[t]))


@pytest.mark.parametrize("name", [*UNITS, *MISTAKES])
def test_speeds_in_other_units_are_converted_once_that_shows(name):
    lines = []
    units = SpeedUnits(Notices(lines.append))
    unit = (UNITS | MISTAKES)[name]
    fixes = list(drive(unit))
    converted = [units.convert(fix) for fix in fixes]
    assert converted[:20] == fixes[:20]
    for before, after in list(zip(fixes, converted, strict=True))[40:]:
        assert after.speed == pytest.approx(before.speed * unit, rel=1e-5)
        assert after.quality == "speed"
    assert lines == [f"van: speeds converted to m/s ({name})"]


def test_speeds_in_metres_a_second_stay():
    units = SpeedUnits(Notices(pytest.fail))
    assert all(units.convert(fix) is fix for fix in drive(1.0))


def test_what_is_no_unit_stays():
    # Parked, with a speed that drifts; far too fast; or without any.
    units = SpeedUnits(Notices(pytest.fail))
    assert all(units.convert(fix) is fix for fix in drive(0.5144, speed=1.0))
    assert all(units.convert(fix) is fix for fix in drive(1 / 1.4, agent="odd"))
    assert all(units.convert(fix) is fix for fix in reversed(list(drive(0.5144, agent="back"))))
    still = [Fix("none", "test", t, t, (48.0 + t / 1e3, 11.0)) for t in range(99)]
    assert [units.convert(fix) for fix in still] == still


def test_agents_have_units_of_their_own():
    units = SpeedUnits(Notices([].append))
    pairs = zip(drive(UNITS["knots"]), drive(1.0, agent="bus"), strict=True)
    last = [(units.convert(van), units.convert(bus)) for van, bus in pairs][-1]
    assert [fix.quality for fix in last] == ["speed", ""]


def test_a_unit_that_is_right_again_is_told():
    units = SpeedUnits(Notices([].append))
    for fix in drive(UNITS["km/h"]):
        units.convert(fix)
    later = [
        Fix(f.agent, f.source, f.time + 1e5, 0.0, f.position, speed=f.speed) for f in drive(1.0)
    ]
    assert [units.convert(fix) for fix in later][-1].quality == ""
