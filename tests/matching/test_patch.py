import math

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.matching.patch import patch
from gpszip.model import Plane, Track
from matching.streets import grid, network, sample_line


def town(columns=8, street_speeds=None, forward=None):
    """Square blocks of 100 m, with speeds in m/s of the streets to the east by their number."""
    nodes, pairs = grid(columns - 1, 100.0)
    speeds = None
    if street_speeds is not None:
        speeds = np.full(len(pairs), 10.0)
        for road, (a, b) in enumerate(pairs):
            is_eastward = b - a == columns
            if is_eastward and a % columns in street_speeds:
                speeds[road] = street_speeds[a % columns]
    return network(nodes, pairs, forward, speeds=speeds)


def drive(corners, speed=10.0, noise=2.0, seed=1, period=1.0):
    """Times, true positions and noisy positions."""
    times, positions = sample_line(corners, speed, period)
    errors = np.random.default_rng(seed).normal(0, noise, positions.shape)
    return times, positions, positions + errors


def track_with_gap(times, positions, low, high, name="car"):
    kept = (times <= low) | (times >= high)
    return Track(name, times[kept], positions[kept])


CORNERS = [(0, 0), (500, 0), (500, 300), (200, 300), (200, 700), (700, 700)]


def test_a_gap_round_a_corner_is_filled_along_the_roads():
    times, positions, noisy = drive(CORNERS)
    patching = patch(track_with_gap(times, noisy, 30.0, 75.0), town(), gap=20.0)
    assert (patching.filled, len(patching.patches), patching.added) == (1, 1, 44)
    (filled,) = patching.patches
    np.testing.assert_allclose(filled.times, np.arange(31.0, 75.0))
    assert np.linalg.norm(filled.positions - positions[31:75], axis=1).mean() < 12
    assert filled.length == pytest.approx(450, abs=15)
    distance_to_street = np.abs((filled.positions + 50) % 100 - 50).min(axis=1)
    assert distance_to_street.max() < 0.01
    assert (filled.confidence > 0).all()
    assert (filled.confidence <= 1).all()


def test_patched_tracks_hold_the_log_and_the_samples_added():
    times, _, noisy = drive(CORNERS)
    log = track_with_gap(times, noisy, 30.0, 75.0)
    (track,) = patch(log, town(), gap=20.0).to_tracks()
    assert set(track.attributes["source"]) == {"log", "patched"}
    is_log = track.attributes["source"] == "log"
    np.testing.assert_array_equal(track.times[is_log], log.times)
    np.testing.assert_array_equal(track.positions[is_log], log.positions)
    assert (track.attributes["confidence"][is_log] == 1).all()
    np.testing.assert_allclose(np.diff(track.times), 1.0)


def test_speeds_at_both_ends_of_a_gap_count():
    """Slow before, fast after: at half of the time, the agent is not at half of the path."""
    times = np.arange(0, 180.0)
    along = np.cumsum(np.where(times < 90, 3.0, 9.0)) - 3.0
    positions = np.stack((np.minimum(along, 1100.0), np.zeros(len(along))), axis=1)
    log = track_with_gap(times, positions, 60.0, 120.0)
    (filled,) = patch(log, town(14), gap=20.0).patches
    middle = np.interp(90.0, filled.times, filled.positions[:, 0])
    linear = (positions[60, 0] + positions[120, 0]) / 2
    assert abs(middle - positions[90, 0]) < 0.7 * abs(linear - positions[90, 0])


def test_quick_roads_are_taken():
    times, _, noisy = drive([(0, 0), (0, 100), (700, 100), (700, 0)], speed=10.0)
    log = track_with_gap(times, noisy, 5.0, 84.0)
    (equal,) = patch(log, town(street_speeds={0: 10.0, 1: 10.0, 2: 3.0}), gap=20.0).patches
    (quick,) = patch(log, town(street_speeds={0: 2.5, 1: 10.0, 2: 10.0}), gap=20.0).patches
    assert np.median(quick.positions[:, 1]) == pytest.approx(100, abs=1)
    assert equal.length == pytest.approx(800, abs=20)


def test_one_way_roads_are_respected():
    """The street at y = 0 leads west only; the drive goes east."""
    nodes, pairs = grid(7, 100.0)
    is_first_street = (nodes[np.array(pairs)][:, :, 1] == 0).all(axis=1)
    times, _, noisy = drive([(100, 0), (100, 100), (600, 100), (600, 0)])
    log = track_with_gap(times, noisy, 6.0, 65.0)
    (filled,) = patch(log, town(forward=~is_first_street), gap=20.0).patches
    assert np.median(filled.positions[:, 1]) == pytest.approx(100, abs=1)


def test_without_gaps_nothing_is_added():
    times, _, noisy = drive(CORNERS)
    patching = patch(Track("car", times, noisy), town())
    assert (patching.gap, patching.patches, patching.added) == (math.inf, (), 0)


def test_samples_are_added_at_the_interval_of_the_log():
    times, _, noisy = drive(CORNERS, speed=4.0, period=5.0)
    (filled,) = patch(track_with_gap(times, noisy, 100.0, 250.0), town(), gap=20.0).patches
    np.testing.assert_allclose(filled.times, np.arange(105.0, 250.0, 5.0))


def test_the_gap_is_estimated_from_the_log():
    times, _, noisy = drive(CORNERS)
    patching = patch(track_with_gap(times, noisy, 30.0, 75.0), town())
    assert 10 <= patching.gap < 45
    assert patching.filled == 1


def test_a_gap_that_is_too_fast_is_left_open():
    times, _, noisy = drive([(0, 0), (700, 0)])
    positions = np.concatenate((noisy[:35], noisy[35:] + np.array([0, 60_000.0])))
    jump = Track("car", np.r_[times[:35], times[35:] + 40], positions)
    (left_open,) = patch(jump, town(), gap=20.0).open
    assert "m/s" in left_open.reason


def test_a_gap_that_begins_off_the_roads_is_left_open():
    times, _, noisy = drive([(0, 0), (700, 0)])
    away = np.linspace(0, 400, 30)[:, None] * [0.0, -1.0] + noisy[-1]
    track = Track(
        "car",
        np.r_[times, times[-1] + np.arange(1, 31), times[-1] + 100 + np.arange(10)],
        np.concatenate((noisy, away, np.repeat(away[-1:], 10, 0))),
    )
    patching = patch(track, town(), gap=20.0)
    assert patching.filled == 0
    assert "off the roads" in patching.open[0].reason


def test_a_gap_between_components_is_left_open():
    nodes = [(0.0, 0.0), (500.0, 0.0), (700.0, 0.0), (1200.0, 0.0)]
    times, _, noisy = drive([(0, 0), (1200, 0)])
    log = track_with_gap(times, noisy, 40.0, 80.0)
    patching = patch(log, network(nodes, [(0, 1), (2, 3)]), gap=20.0)
    assert patching.open[0].reason == "no path over the roads leads through it"


def test_a_gap_of_hours_on_a_short_path_is_left_open():
    times, _, noisy = drive([(0, 0), (700, 0)])
    track = Track("car", np.where(times > 35, times + 7200, times), noisy)
    assert "anywhere" in patch(track, town(), gap=20.0).open[0].reason


def test_a_short_stop_is_filled_in_one_position():
    times, _, noisy = drive([(0, 0), (700, 0)], noise=0.5)
    track = Track("car", np.where(times > 35, times + 90, times), noisy)
    (filled,) = patch(track, town(), gap=20.0).patches
    assert filled.length < 25
    assert np.ptp(filled.positions[:, 0]) < 25


def test_heights_are_interpolated():
    times, _, noisy = drive(CORNERS)
    with_height = np.column_stack((noisy, times / 10))
    (filled,) = patch(track_with_gap(times, with_height, 30.0, 75.0), town(), gap=20.0).patches
    np.testing.assert_allclose(filled.positions[:, 2], filled.times / 10)


def test_each_track_has_its_own_speed():
    """A walker and a car: neither is filled at the other's pace."""
    times, _, noisy = drive(CORNERS)
    car = track_with_gap(times, noisy, 30.0, 75.0)
    times, positions, noisy = drive(CORNERS[:4], speed=1.5, noise=1.0)
    walker = track_with_gap(times, noisy, 300.0, 420.0, "walker")
    patching = patch([car, walker], town(), gap=20.0)
    assert patching.filled == 2
    filled = patching.patches[1]
    assert filled.track == 1
    assert np.linalg.norm(filled.positions - positions[301:420], axis=1).mean() < 15


def test_patches_do_not_depend_on_the_order_of_tracks():
    times, _, noisy = drive(CORNERS)
    tracks = [
        track_with_gap(times, noisy, 30.0, 75.0),
        track_with_gap(times, noisy[::-1], 40.0, 70.0, "back"),
    ]
    first, second = (patch(log, town(), gap=20.0).patches for log in (tracks, tracks[::-1]))
    for a, b in zip(first, second[::-1], strict=True):
        np.testing.assert_array_equal(a.positions, b.positions)


def test_planes_must_agree_and_tracks_are_required():
    times, _, noisy = drive(CORNERS)
    with pytest.raises(OptionError, match="plane"):
        patch(Track("car", times, noisy, plane=Plane(((0, 0),))), town())
    with pytest.raises((InputError, OptionError), match="track"):
        patch([], town())


@pytest.mark.parametrize("gap", [0.0, -1.0, math.nan])
def test_gaps_must_be_positive(gap):
    times, _, noisy = drive(CORNERS)
    with pytest.raises(OptionError, match="positive"):
        patch(Track("car", times, noisy), town(), gap=gap)
