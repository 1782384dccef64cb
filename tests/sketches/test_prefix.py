from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from gpszip.errors import OptionError
from gpszip.kernels.sums import track_sums
from gpszip.model import Track
from gpszip.sketches.prefix import interval_moments


def decimal_track(seed, n, *, dt=1.0, extent=500.0, d=2, weights=None):
    rng = np.random.default_rng(seed)
    times = np.cumsum(np.round(rng.uniform(0.5, 1.5, n) * dt, 3))
    return Track("t", times, np.round(rng.uniform(-extent, extent, (n, d)), 3), weights=weights)


def exact_moments(sums, a, b):
    """The moments in fractions, rounded once at the end."""
    t = [Fraction(x - sums.t[a]) for x in sums.t[a:b]]
    r = [
        [Fraction(x) - Fraction(y) for x, y in zip(p, sums.p[a], strict=True)] for p in sums.p[a:b]
    ]
    w = [Fraction(x) for x in sums.w[a:b]]
    u = [x / t[-1] if t[-1] else Fraction(0) for x in t]
    axes = range(sums.p.shape[1])
    total = [
        sum(w),
        sum(map(lambda x, y: x * y, w, u)),
        sum(x * y * y for x, y in zip(w, u, strict=True)),
    ]
    total.append(sum(x * sum(c * c for c in p) for x, p in zip(w, r, strict=True)))
    total += [sum(x * p[c] for x, p in zip(w, r, strict=True)) for c in axes]
    total += [sum(x * y * p[c] for x, y, p in zip(w, u, r, strict=True)) for c in axes]
    return np.array([float(value) for value in total])


def assert_moments(sums, boundaries, rtol):
    rows = interval_moments(sums, np.array(boundaries))
    for row, a, b in zip(rows, boundaries[:-1], boundaries[1:], strict=True):
        expected = exact_moments(sums, a, b)
        np.testing.assert_allclose(
            row, expected, rtol=rtol, atol=rtol * np.abs(expected).max() * 1e-3
        )


@pytest.mark.parametrize("d", [1, 2, 3])
def test_moments_are_exact(d):
    sums = track_sums(decimal_track(d, 400, d=d))
    assert_moments(sums, [0, 1, 3, 50, 51, 200, 400], 1e-14)


def test_moments_stay_exact_when_the_prefix_sums_wrap_around():
    track = decimal_track(1, 3000, dt=40.0, extent=4e8)
    sums = track_sums(track)
    raw = sum(int(x) ** 2 for x in sums.p.ravel())
    assert raw > 2**63
    assert_moments(sums, [0, 5, 9, 2000, 2100, 3000], 1e-12)


def test_intervals_too_long_for_integers_are_summed_from_blocks():
    track = decimal_track(2, 2000, dt=1e5)
    sums = track_sums(track)
    assert len(track) * float(sums.t[-1]) ** 2 > 2**63
    assert_moments(sums, [0, 2000], 1e-12)
    assert_moments(sums, [3, 1999], 1e-12)
    assert_moments(sums, [255, 256, 257, 511, 513, 1025], 1e-12)


def test_weighted_moments():
    weights = np.random.default_rng(3).uniform(0.1, 9.0, 1200)
    assert_moments(
        track_sums(decimal_track(3, 1200, weights=weights)), [0, 2, 257, 1100, 1101, 1200], 1e-12
    )


def test_the_origin_of_times_and_positions_changes_no_bit():
    near = decimal_track(4, 1000)
    far = Track("t", near.times + 1e9, near.positions + 1e7)
    cuts = np.arange(0, 1001, 50)
    assert (
        interval_moments(track_sums(near), cuts).tobytes()
        == interval_moments(track_sums(far), cuts).tobytes()
    )


@pytest.mark.parametrize(
    ("interval", "tick"),
    [(60.0, 1e-3), (1.0, 1e-3), (0.1, 1e-4), (0.02, 1e-5), (0.001, 1e-6)],
    ids=["minute", "1Hz", "10Hz", "50Hz", "1kHz"],
)
def test_the_time_tick_fits_the_rate(interval, tick):
    assert track_sums(
        Track("t", np.arange(5) * interval, np.zeros((5, 1)))
    ).time_tick == pytest.approx(tick)


@pytest.mark.parametrize(("extent", "tick"), [(1e6, 1e-3), (1e4, 1e-4), (1.0, 1e-8), (0.0, 1e-3)])
def test_the_position_tick_fits_the_extent(extent, tick):
    assert track_sums(Track("t", [0.0, 1.0], [[0.0], [extent]])).position_tick == pytest.approx(
        tick
    )


def test_ticks_are_coarser_for_large_extents():
    sums = track_sums(Track("t", [0.0, 1e-6, 1e13], [[0.0], [1e14], [2e14]]))
    assert sums.t[-1] < 2**52
    assert sums.p.max() < 2**52
    assert sums.time_tick > 1e-3
    assert sums.position_tick > 1e-3


@pytest.mark.parametrize("boundaries", [[0, 5, 5], [0, 11], [-1, 3], []])
def test_boundaries_outside_the_track_are_refused(boundaries):
    with pytest.raises(OptionError, match="boundaries must increase"):
        interval_moments(track_sums(decimal_track(0, 10)), np.array(boundaries, dtype=np.int64))
