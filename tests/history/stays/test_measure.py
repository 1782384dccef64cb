"""The length of trips."""

import numpy as np
import pytest

from gpszip.history.stays.fixes import Fixes
from gpszip.history.stays.measure import measure_travel


def travel(x, times):
    line = np.stack([x, 0 * x], axis=1)
    fixes = Fixes(times, line, np.full(len(x), 5.0))
    return measure_travel(fixes, times[0], times[-1], line[0], line[-1])


def test_a_jump_has_no_metres():
    times = np.arange(0.0, 601, 10)
    there = travel(10.0 * times, times)
    jump = travel(10.0 * times + np.where(times > 300, 40_000.0, 0.0), times)
    assert there.length == pytest.approx(6000, rel=0.01)
    assert jump.length == pytest.approx(5900, rel=0.01)
    assert jump.line[-1, 0] == 46_000


def test_a_fast_way_between_slow_ones_is_no_jump():
    # A walk, ten minutes in a train without a fix, and a walk.
    times = np.concatenate([np.arange(0.0, 301, 10), np.arange(900.0, 1201, 10)])
    x = np.interp(times, [0, 300, 900, 1200], [0, 400, 15_400, 15_800])
    assert travel(x, times).length == pytest.approx(15_800, rel=0.01)
