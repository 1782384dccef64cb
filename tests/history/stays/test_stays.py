"""Windows in which a track is still, against sums over many positions."""

import numpy as np
import pytest

from gpszip.history.stays import stays
from gpszip.history.stays.fixes import Fixes
from gpszip.history.stays.stays import find_halts, still_ranges
from oracle import windows


def a_track(seed, n=60):
    rng = np.random.default_rng(seed)
    times = np.cumsum(np.exp(rng.uniform(0, 6, n)))
    moving = rng.random(n) < 0.5
    steps = rng.normal(0, 1, (n, 2)) * np.where(moving, 200, 4)[:, None]
    return Fixes(times, np.cumsum(steps, axis=0) + 1e6, np.exp(rng.uniform(1, 4, n)))


@pytest.mark.parametrize("seed", range(3))
def test_moments_of_windows(seed):
    fixes = a_track(seed)
    begins = np.sort(np.random.default_rng(seed).uniform(fixes.times[0], fixes.times[-1] - 300, 20))
    found = stays._window_moments(fixes, begins, 300.0)
    for row, begin in enumerate(begins):
        expected = windows.window_moments(fixes.times, fixes.positions, fixes.noise, begin, 300.0)
        np.testing.assert_allclose(found[0][row], expected[0], atol=0.1)
        np.testing.assert_allclose(found[1][row], expected[1], rtol=1e-3, atol=0.1)
        np.testing.assert_allclose(found[2][row], expected[2], rtol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_ranges_in_which_a_track_is_still(seed):
    fixes = a_track(seed)
    expected = windows.still_ranges(fixes.times, fixes.positions, fixes.noise, 300.0, 100.0)
    np.testing.assert_allclose(still_ranges(fixes, 300.0, 100.0), expected, atol=1e-6)


def test_blocks_do_not_show(monkeypatch):
    fixes = a_track(9, n=500)
    whole = still_ranges(fixes, 300.0, 100.0)
    monkeypatch.setattr(stays, "_BLOCK", 32)
    np.testing.assert_allclose(still_ranges(fixes, 300.0, 100.0), whole)


def test_a_walk_next_door_divides_a_halt():
    # 200 m at a walk: no window of five minutes is without a halt
    times = np.arange(0.0, 3001, 10)
    x = np.interp(times, [0, 1000, 1150, 2000, 2150, 3000], [0, 0, 200, 200, 0, 0])
    fixes = Fixes(times, np.stack([x, 0 * x], axis=1), np.full(len(times), 10.0))
    halts = find_halts(fixes, 300.0, 100.0)
    assert [round(halt.centre[0]) for halt in halts] == [0, 200, 0]
    assert [times[halt.first] for halt in halts] == pytest.approx([0, 1150, 2150], abs=60)
