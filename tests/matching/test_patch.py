import math

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError
from gpszip.matching.patch import patch
from gpszip.model import Network, Plane, Track


def grid(size=8, block=100.0, speeds=None):
    """Streets of a town, all straight; speeds of the streets from west to east by their number."""
    nodes = np.array([(x * block, y * block) for x in range(size) for y in range(size)])
    across = [(x * size + y, (x + 1) * size + y) for x in range(size - 1) for y in range(size)]
    up = [(x * size + y, x * size + y + 1) for x in range(size) for y in range(size - 1)]
    roads = np.array(across + up, np.int32)
    given = np.full(len(roads), np.nan)
    if speeds is not None:
        given[:] = 10.0
        for street, speed in speeds.items():
            given[[i for i, (a, _) in enumerate(across) if a % size == street]] = speed
    both = np.ones(len(roads), bool)
    return Network(
        nodes,
        roads[:, 0].copy(),
        roads[:, 1].copy(),
        np.arange(0, 2 * len(roads) + 1, 2),
        nodes[roads.ravel()],
        both,
        both,
        given,
    )


def drive(corners, speed=10.0, noise=2.0, seed=1, period=1.0):
    corners = np.array(corners, float)
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))]
    times = np.arange(0, along[-1] / speed, period)
    places = np.stack([np.interp(speed * times, along, axis) for axis in corners.T], axis=1)
    return times, places, places + np.random.default_rng(seed).normal(0, noise, places.shape)


def torn(times, positions, low, high, name="car", **options):
    kept = (times <= low) | (times >= high)
    return Track(name, times[kept], positions[kept], **options)


ROUND = [(0, 0), (500, 0), (500, 300), (200, 300), (200, 700), (700, 700)]


def test_a_gap_round_a_corner_is_filled_along_the_roads():
    times, places, seen = drive(ROUND)
    found = patch(torn(times, seen, 30.0, 75.0), grid(), gap=20.0)
    assert (found.filled, len(found.patches), found.added) == (1, 1, 44)
    one = found.patches[0]
    np.testing.assert_allclose(one.times, np.arange(31.0, 75.0))
    off = np.linalg.norm(one.positions - places[31:75], axis=1)
    assert off.mean() < 12
    assert one.length == pytest.approx(450, abs=15)
    on_road = np.minimum(np.abs((one.positions + 50) % 100 - 50).min(axis=1), 50)
    assert on_road.max() < 0.01
    assert (one.confidence > 0).all()
    assert (one.confidence <= 1).all()


def test_patched_tracks_hold_the_log_and_what_was_added():
    times, _, seen = drive(ROUND)
    log = torn(times, seen, 30.0, 75.0)
    track = patch(log, grid(), gap=20.0).to_tracks()[0]
    own = track.attributes["source"] == "log"
    np.testing.assert_array_equal(track.times[own], log.times)
    np.testing.assert_array_equal(track.positions[own], log.positions)
    assert set(track.attributes["source"]) == {"log", "patched"}
    assert (track.attributes["confidence"][own] == 1).all()
    np.testing.assert_allclose(np.diff(track.times), 1.0)


def test_speeds_at_the_ends_count():
    """Slow before, fast after: half of the time is not half of the way."""
    times = np.arange(0, 180.0)
    speed = np.where(times < 90, 3.0, 9.0)
    along = np.cumsum(speed) - speed[0]
    places = np.stack((np.minimum(along, 1100.0), np.zeros(len(along))), axis=1)
    found = patch(torn(times, places, 60.0, 120.0), grid(14), gap=20.0).patches[0]
    middle = np.interp(90.0, found.times, found.positions[:, 0])
    straight = (places[60, 0] + places[120, 0]) / 2
    assert abs(middle - places[90, 0]) < 0.7 * abs(straight - places[90, 0])


def test_quick_roads_are_taken():
    times, _, seen = drive([(0, 0), (0, 100), (700, 100), (700, 0)], speed=10.0)
    log = torn(times, seen, 5.0, 84.0)
    slow = patch(log, grid(speeds={0: 10.0, 1: 10.0, 2: 3.0}), gap=20.0).patches[0]
    quick = patch(log, grid(speeds={0: 2.5, 1: 10.0, 2: 10.0}), gap=20.0).patches[0]
    assert np.median(quick.positions[:, 1]) == pytest.approx(100, abs=1)
    assert slow.length == pytest.approx(800, abs=20)


def test_one_way_roads_are_respected():
    network = grid()
    forward, backward = network.forward.copy(), network.backward.copy()
    street = [
        i
        for i in range(len(network))
        if network.points[2 * i, 1] == network.points[2 * i + 1, 1] == 0
    ]
    forward[street] = False
    closed = Network(
        network.nodes,
        network.starts,
        network.ends,
        network.offsets,
        network.points,
        forward,
        backward,
        network.speeds,
    )
    times, _, seen = drive([(100, 0), (100, 100), (600, 100), (600, 0)])
    found = patch(torn(times, seen, 6.0, 65.0), closed, gap=20.0).patches[0]
    assert np.median(found.positions[:, 1]) == pytest.approx(100, abs=1)


def test_without_gaps_there_is_nothing_to_do():
    times, _, seen = drive(ROUND)
    found = patch(Track("car", times, seen), grid())
    assert (found.gap, found.patches, found.added) == (math.inf, (), 0)


def test_the_rhythm_is_the_logs_own():
    times, _, seen = drive(ROUND, speed=4.0, period=5.0)
    found = patch(torn(times, seen, 100.0, 250.0), grid(), gap=20.0).patches[0]
    np.testing.assert_allclose(found.times, np.arange(105.0, 250.0, 5.0))


def test_the_gap_is_estimated_from_the_log():
    times, _, seen = drive(ROUND)
    found = patch(torn(times, seen, 30.0, 75.0), grid())
    assert 10 <= found.gap < 45
    assert found.filled == 1


def test_hopeless_gaps_are_left_open_and_named():
    times, _, seen = drive([(0, 0), (700, 0)])
    positions = np.concatenate((seen[:35], seen[35:] + np.array([0, 60_000.0])))
    far = Track("car", np.r_[times[:35], times[35:] + 40], positions)
    reasons = [one.reason for one in patch(far, grid(), gap=20.0).open]
    assert len(reasons) == 1
    assert "m/s" in reasons[0]


def test_who_leaves_the_roads_is_not_followed():
    times, _, seen = drive([(0, 0), (700, 0)])
    away = np.linspace(0, 400, 30)[:, None] * [0.0, -1.0] + seen[-1]
    track = Track(
        "car",
        np.r_[times, times[-1] + np.arange(1, 31), times[-1] + 100 + np.arange(10)],
        np.concatenate((seen, away, np.repeat(away[-1:], 10, 0))),
    )
    found = patch(track, grid(), gap=20.0)
    assert found.filled == 0
    assert "off the roads" in found.open[0].reason


def test_no_way_leads_there():
    nodes = np.array([(0.0, 0.0), (500.0, 0.0), (700.0, 0.0), (1200.0, 0.0)])
    both = np.ones(2, bool)
    network = Network(
        nodes,
        np.array([0, 2], np.int32),
        np.array([1, 3], np.int32),
        np.array([0, 2, 4]),
        nodes,
        both,
        both,
        np.full(2, np.nan),
    )
    times, _, seen = drive([(0, 0), (1200, 0)])
    found = patch(torn(times, seen, 40.0, 80.0), network, gap=20.0)
    assert found.open[0].reason == "no path over the roads leads through it"


def test_hours_for_a_minutes_way_may_have_been_spent_anywhere():
    times, _, seen = drive([(0, 0), (700, 0)])
    late = np.where(times > 35, times + 7200, times)
    found = patch(Track("car", late, seen), grid(), gap=20.0)
    assert "anywhere" in found.open[0].reason


def test_a_short_stop_is_stayed_at():
    times, _, seen = drive([(0, 0), (700, 0)], noise=0.5)
    late = np.where(times > 35, times + 90, times)
    found = patch(Track("car", late, seen), grid(), gap=20.0).patches[0]
    assert found.length < 25
    assert np.ptp(found.positions[:, 0]) < 25


def test_heights_are_filled_straight():
    times, _, seen = drive(ROUND)
    lifted = np.column_stack((seen, times / 10))
    found = patch(torn(times, lifted, 30.0, 75.0), grid(), gap=20.0).patches[0]
    np.testing.assert_allclose(found.positions[:, 2], found.times / 10)


def test_each_track_has_its_own_speed():
    """A walker and a car: neither is filled at the other's pace."""
    times, _, seen = drive(ROUND)
    slow_times, slow_places, slow_seen = drive(ROUND[:4], speed=1.5, noise=1.0)
    tracks = [torn(times, seen, 30.0, 75.0), torn(slow_times, slow_seen, 300.0, 420.0, "walker")]
    found = patch(tracks, grid(), gap=20.0)
    assert found.filled == 2
    walker = found.patches[1]
    assert walker.track == 1
    assert np.linalg.norm(walker.positions - slow_places[301:420], axis=1).mean() < 15


def test_tracks_are_filled_alone_as_they_are_together():
    times, _, seen = drive(ROUND)
    tracks = [torn(times, seen, 30.0, 75.0), torn(times, seen[::-1], 40.0, 70.0, "back")]
    one, other = patch(tracks, grid(), gap=20.0), patch(tracks[::-1], grid(), gap=20.0)
    for a, b in zip(one.patches, other.patches[::-1], strict=True):
        np.testing.assert_array_equal(a.positions, b.positions)


def test_roads_and_tracks_on_different_planes():
    times, _, seen = drive(ROUND)
    with pytest.raises(OptionError, match="plane"):
        patch(Track("car", times, seen, plane=Plane(((0, 0),))), grid())
    with pytest.raises((InputError, OptionError), match="track"):
        patch([], grid())


@pytest.mark.parametrize("gap", [0.0, -1.0, math.nan])
def test_gaps_must_be_positive(gap):
    times, _, seen = drive(ROUND)
    with pytest.raises(OptionError, match="positive"):
        patch(Track("car", times, seen), grid(), gap=gap)
