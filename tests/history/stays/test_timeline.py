"""Stops and trips of one track, in scenes whose truth is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.history.stays.fixes import choose_fixes
from gpszip.history.stays.timeline import build_timeline
from gpszip.history.stays.values import Settings
from random_tests import examples

#: Metres of the errors of fixes in these scenes.
NOISE = 8.0


def scene(*legs, period=10.0, seed=1, silent=()):
    """Fixes of a way: legs of (seconds, x, y) reached at their end, from (0, 0) on.

    ``silent`` are pairs of seconds between which there is no fix.
    """
    knots = np.cumsum([0, *(leg[0] for leg in legs)])
    places = np.array([(0.0, 0.0), *((leg[1], leg[2]) for leg in legs)])
    times = np.arange(0.0, knots[-1] + 1e-9, period)
    for begin, end in silent:
        times = times[(times <= begin) | (times >= end)]
    way = np.stack([np.interp(times, knots, axis) for axis in places.T], axis=1)
    return times, way + np.random.default_rng(seed).normal(0, NOISE, way.shape)


def timeline(times, positions, accuracy=None, **settings):
    return build_timeline(choose_fixes(times, positions, accuracy), Settings(**settings))


def timeline_so_far(times, positions, end):
    """What is known once the fixes up to a time have come, while others follow."""
    is_known = times <= end
    fixes = choose_fixes(times[is_known], positions[is_known], None)
    return build_timeline(fixes, Settings(), goes_on=True)


def spans(items):
    return [(item.start, item.end) for item in items]


def is_near(found, expected, within=30.0):
    assert len(found) == len(expected), (found, expected)
    np.testing.assert_allclose(np.array(found), np.array(expected), atol=within)


HOME_AND_WORK = ((900, 0, 0), (600, 5000, 0), (1800, 5000, 0), (600, 0, 0), (900, 0, 0))


def test_there_and_back():
    line = timeline(*scene(*HOME_AND_WORK))
    is_near(spans(line.stops), [(0, 900), (1500, 3300), (3900, 4800)])
    is_near(spans(line.moves), [(900, 1500), (3300, 3900)])
    np.testing.assert_allclose(line.stops[1].halt.centre, [5000, 0], atol=5)
    assert [(move.origin, move.goal) for move in line.moves] == [(0, 1), (1, 2)]


def test_red_lights_and_jams_are_no_stays():
    light = ((900, 0, 0), (200, 2000, 0), (110, 2000, 0), (200, 4000, 0), (900, 4000, 0))
    is_near(spans(timeline(*scene(*light)).moves), [(900, 1410)])

    # ten minutes at 1 m/s
    jam = ((900, 0, 0), (200, 2000, 0), (600, 2600, 0), (200, 4600, 0), (900, 4600, 0))
    is_near(spans(timeline(*scene(*jam)).moves), [(900, 1900)])


def test_a_turn_is_none_before_the_track_stays_again():
    # Two minutes at the far end; then around it, now nearer to where it began, now farther away.
    away = ((300, 3000, 0), (120, 3000, 0))
    around = ((240, 600, 0), (240, 3000, 2000), (240, 600, 0), (600, 600, 0))
    times, positions = scene((900, 0, 0), *away, *around)
    told = [
        spans(timeline_so_far(times, positions, end).stops)[1:]
        for end in np.arange(1400.0, times[-1], 60.0)
    ]
    first = next(n for n, stops in enumerate(told) if stops)
    assert all(len(stops) == len(told[-1]) for stops in told[first:])
    # By where it is at that moment, it has turned already.
    so_far = times <= 1560
    assert len(timeline(times[so_far], positions[so_far]).stops) == 2


def test_a_pause_is_one_once_the_trip_after_it_has_ended():
    way = ((900, 0, 0), (300, 3000, 0), (500, 3000, 0), (300, 6000, 0), (900, 6000, 0))
    times, positions = scene(*way)
    on_the_way, there = (timeline_so_far(times, positions, end) for end in (1900, 2900))
    assert [stop.pause for stop in on_the_way.stops] == [False, False]
    assert [stop.pause for stop in there.stops] == [False, True, False]


def test_a_wait_on_the_way_is_a_pause():
    way = ((900, 0, 0), (300, 1500, 0), (500, 1500, 0), (600, 12000, 0), (900, 12000, 0))
    line = timeline(*scene(*way))
    is_near(spans(line.moves), [(900, 2300)])
    assert [stop.pause for stop in line.stops] == [False, True, False]
    assert len(timeline(*scene(*way), max_pause=400.0).moves) == 2


def test_a_short_stop_at_the_far_end_of_a_round_trip_is_its_goal():
    way = ((900, 0, 0), (400, 4000, 0), (180, 4000, 0), (400, 0, 0), (900, 0, 0))
    is_near(spans(timeline(*scene(*way)).moves), [(900, 1300), (1480, 1880)])

    # on the way, such a stop is none
    way = ((900, 0, 0), (400, 4000, 0), (180, 4000, 0), (400, 8000, 0), (900, 8000, 0))
    is_near(spans(timeline(*scene(*way)).moves), [(900, 1880)])


@pytest.mark.parametrize("accuracy", [20.0, 60.0, 100.0])
def test_a_phone_that_lies_still_makes_no_trip(accuracy):
    # a day of drift with steps of 10 m, at most 74 m off
    rng = np.random.default_rng(7)
    drift = np.cumsum(rng.normal(0, 7, (8640, 2)), axis=0)
    positions = 74 * np.sin(drift / 74) / np.sqrt(2)
    line = timeline(np.arange(8640) * 10.0, positions, np.full(8640, accuracy))
    assert not line.moves
    is_near(spans(line.stops), [(0, 86390)])


def test_poor_fixes_among_good_ones_count_for_nothing():
    times, positions = scene(*HOME_AND_WORK)
    rng = np.random.default_rng(3)
    poor = rng.random(len(times)) < 0.3
    positions[poor] += rng.normal(0, 1500, (poor.sum(), 2))
    line = timeline(times, positions, np.where(poor, 2000.0, 10.0))
    is_near(spans(line.moves), [(900, 1500), (3300, 3900)])


def test_a_wrong_place_for_minutes_and_back_is_none():
    times, positions = scene((7200, 0, 0))
    wrong = (times > 3000) & (times < 3600)
    positions[wrong] += (1500.0, -900.0)
    line = timeline(times, positions)
    assert not line.moves
    is_near(spans(line.stops), [(0, 7200)])


def test_a_stale_first_fix_starts_no_trip():
    times, positions = scene(*HOME_AND_WORK)
    times, positions = np.append(-40_000.0, times), np.vstack([[-3000.0, 2000.0], positions])
    line = timeline(times, positions)
    is_near(spans(line.moves), [(900, 1500), (3300, 3900)])
    assert [doubt.time for doubt in line.doubtful] == [-40_000.0]


def test_a_silent_phone_stays_where_it_is_heard_again():
    line = timeline(*scene(*HOME_AND_WORK, silent=[(1600, 3200)]))
    is_near(spans(line.stops), [(0, 900), (1500, 3300), (3900, 4800)])


def test_a_phone_that_wakes_on_the_way_had_left_before():
    # silent from two minutes after it stops until it is 400 m away
    times, positions = scene(*HOME_AND_WORK, silent=[(1620, 3350)])
    line = timeline(times, positions)
    is_near(spans(line.moves), [(900, 1500), (3300, 3900)], within=60)


def test_a_gap_is_travel_if_it_is_filled_by_it():
    # a tunnel
    is_near(spans(timeline(*scene(*HOME_AND_WORK, silent=[(1000, 1400)])).moves)[:1], [(900, 1500)])

    # a change of place within ten hours
    line = timeline(*scene((900, 0, 0), (36_000, 5000, 0), (900, 5000, 0), silent=[(890, 36_910)]))
    assert not line.moves
    assert line.unseen == 1
    assert len(line.stops) == 2


def test_a_track_may_begin_and_end_on_the_way():
    line = timeline(*scene((300, 3000, 0), (1200, 3000, 0), (300, 6000, 0)))
    is_near(spans(line.moves), [(0, 300), (1500, 1800)])
    assert [(move.origin, move.goal) for move in line.moves] == [(None, 0), (0, None)]


def test_a_receiver_that_repeats_its_last_position_does_not_stay():
    times, positions = scene((900, 0, 0), (900, 9000, 0), (900, 9000, 0))
    frozen = (times > 1000) & (times < 1700)
    positions[frozen] = positions[times == 1000]
    is_near(spans(timeline(times, positions).moves), [(900, 1800)])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_fixes(count):
    line = timeline(np.arange(count) * 60.0, np.zeros((count, 2)))
    assert not line.moves


@st.composite
def tracks(draw):
    """Any track: steps of any length in any time, with errors that are stated or not."""
    n = draw(st.integers(2, 40))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    gaps = np.exp(rng.uniform(0, draw(st.sampled_from([4.0, 8.0, 13.0])), n))
    scale = np.exp(rng.uniform(0, draw(st.sampled_from([3.0, 6.0, 9.0])), (n, 1)))
    positions = np.cumsum(rng.normal(0, 1, (n, 2)) * scale, axis=0)
    if draw(st.booleans()):
        positions = positions[rng.integers(0, max(n // 4, 1), n)]
    accuracy = np.exp(rng.uniform(1, 8, n)) if draw(st.booleans()) else None

    # Numbers of few binary digits, so that nothing is rounded where a track is shifted.
    times, positions = (np.round(1024 * each) / 1024 for each in (np.cumsum(gaps), positions))
    return times, positions, accuracy


@given(tracks())
def test_stops_and_trips_of_any_track(track):
    times, positions, accuracy = track
    line = timeline(times, positions, accuracy)

    # Stops don't overlap, nor do trips, and all lie within the track.
    for items in (spans(line.stops), spans(line.moves)):
        ends = np.array(items).reshape(-1)
        assert (np.diff(ends) >= 0).all()
        assert ((ends >= times[0]) & (ends <= times[-1])).all()

    # Trips begin and end at the stops that they name, and only pauses lie within them.
    for move in line.moves:
        assert move.origin is None or line.stops[move.origin].end == move.start
        assert move.goal is None or line.stops[move.goal].start == move.end
        for stop in line.stops:
            inside = stop.start > move.start and stop.end < move.end
            assert inside == stop.pause or not inside
    for stop in line.stops:
        assert stop.start <= stop.first_seen <= stop.last_seen <= stop.end


@examples(50)
@given(tracks(), st.integers(-(10**6), 10**6), st.integers(-1000, 1000))
def test_where_and_when_do_not_matter(track, shift, periods):
    times, positions, accuracy = track
    before = timeline(times, positions, accuracy)
    after = timeline(times + 300.0 * periods, positions + shift, accuracy)
    assert len(before.moves) == len(after.moves)
    np.testing.assert_allclose(
        np.array(spans(after.stops)).reshape(-1, 2) - 300.0 * periods,
        np.array(spans(before.stops)).reshape(-1, 2),
        atol=1e-3,
    )


@pytest.mark.parametrize("ahead", [True, False], ids=["goes on", "turns"])
def test_whoever_drives_past_a_known_place_into_a_gap_does_not_stay_there(ahead):
    """Silent for 40 minutes from 3 km on: the goal lies ahead, or the way turns at the place."""
    goal = (9000, 0) if ahead else (0, 3000)
    times, way = scene(
        (900, 0, 0), (300, 3000, 0), (600, *goal), (3000, *goal), silent=[(1200, 3700)]
    )
    known = np.array([[0.0, 0.0], [3000.0, 0.0], goal])
    found = build_timeline(choose_fixes(times, way, None), Settings(), known)
    there = [stop for stop in found.stops if np.linalg.norm(stop.halt.centre - known[1]) < 200]
    assert len(there) == (0 if ahead else 1)
    assert np.linalg.norm(found.stops[-1].halt.centre - goal) < 50
