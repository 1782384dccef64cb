"""Stays, trips, gaps and sources of agents while their fixes come."""

import asyncio
import json
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip import Fix, Monitor
from gpszip.errors import OptionError
from gpszip.live.events import standing
from gpszip.live.monitor.window import Window
from gpszip.testing import person, shuttles
from random_tests import examples

#: Seconds since 1970 of all logs here.
START = 1.7e9


def fixes_of(track, start=START):
    return [
        Fix(track.id, "test", start + time, start + time, tuple(place), geographic=False)
        for time, place in zip(track.times.tolist(), track.positions.tolist(), strict=True)
    ]


def run(fixes, **options):
    """All events of fixes."""
    monitor = Monitor(**options)
    events = [event for fix in fixes for event in monitor.push(fix)]
    return events + monitor.close()


def facts(events):
    """What a reader of events knows in the end."""
    return [(event.kind, event.agent, event.time, event.id) for event in standing(events)]


def times_of(events, kind):
    return [event.time for event in events if event.kind == kind]


@pytest.fixture(scope="module")
def walker():
    return person(4, seed=1).tracks[0]


@pytest.fixture(scope="module")
def walker_events(walker):
    return run(fixes_of(walker))


def trips_of(tracks):
    """What gpszip trips says of tracks, at the times of the fixes."""
    return gpszip.trips(
        [gpszip.Track(track.id, track.times + START, track.positions) for track in tracks]
    )


def assert_agrees(events, tracks):
    """The events say what the log says afterwards, but for ends of what goes on."""
    found, trips = standing(events), trips_of(tracks)
    for track in tracks:
        own = [event for event in found if event.agent == track.id]
        stays = [stay for stay in trips.stays if stay.track == track.id]
        moves = [move for move in trips.trips if move.track == track.id]
        expected = {
            "stay.start": [stay.start for stay in stays],
            "stay.end": [stay.end for stay in stays],
            "trip.start": [move.start for move in moves],
            "trip.end": [move.end for move in moves],
        }
        last = START + track.times[-1]
        for kind, times in expected.items():
            told = times_of(own, kind)
            if kind.endswith(".end") and len(told) < len(times):
                # The last one goes on.
                assert times[-1] == pytest.approx(last, abs=600)
            assert told == pytest.approx(times[: len(told)], abs=1.5), (track.id, kind)
            assert len(told) >= len(times) - kind.endswith(".end"), (track.id, kind)


def test_events_agree_with_the_trips_of_a_person(walker, walker_events):
    assert len(times_of(standing(walker_events), "trip.end")) > 5
    assert_agrees(walker_events, [walker])


def test_events_agree_with_the_trips_of_a_fleet():
    tracks = shuttles(1, days=1, seed=4, period=30.0).tracks
    fixes = sorted(
        (fix for track in tracks for fix in fixes_of(track, START - tracks[0].times[0])),
        key=lambda fix: fix.time,
    )
    moved = [
        gpszip.Track(track.id, track.times - tracks[0].times[0], track.positions)
        for track in tracks
    ]
    events = run(fixes)
    assert_agrees(events, moved)

    # Rounds lead there and back all day: what was told of one is not told again for each.
    assert sum(event.revises is not None for event in events) <= 4


@examples(3)
@given(seed=st.integers(0, 1000), delay=st.sampled_from([5.0, 60.0]))
def test_order_within_the_buffer_and_chunks_do_not_matter(walker, seed, delay):
    fixes = fixes_of(walker)[:100]
    whole = run(fixes, delay=delay)

    # Each fix comes late by at most the delay; others are looked at now and then.
    rng = random.Random(seed)
    late = [
        Fix(fix.agent, "test", fix.time, fix.time + rng.uniform(0, delay), fix.position, False)
        for fix in fixes
    ]
    late.sort(key=lambda fix: fix.received)
    monitor, events = Monitor(delay=delay), []
    for fix in late:
        events += monitor.push(fix)
        if rng.random() < 0.1:
            events += monitor.tick(fix.received)
    events += monitor.close()
    assert facts(events) == facts(whole)


@examples(2)
@given(cut=st.integers(0, 99))
def test_a_monitor_goes_on_where_another_one_was_saved(walker, cut):
    fixes = fixes_of(walker)[:100]
    first, second = Monitor(), Monitor()
    events = [event for fix in fixes[:cut] for event in first.push(fix)]
    second.restore(json.loads(json.dumps(list(first.states()))))
    events += [event for fix in fixes[cut:] for event in second.push(fix)]
    assert [event.to_json() for event in events + second.close()] == [
        event.to_json() for event in run(fixes)
    ]


def test_what_comes_hours_later_revises_what_was_told(walker):
    # A phone that keeps two hours of its fixes, and sends them after newer ones.
    fixes = fixes_of(walker)[:250]
    begin = fixes[100].time
    kept = [fix for fix in fixes if begin <= fix.time < begin + 7200]
    others = [fix for fix in fixes if not begin <= fix.time < begin + 7200]
    assert kept
    number = next(n for n, fix in enumerate(others) if fix.time > begin + 9000)
    now = others[number].received
    late = [Fix(fix.agent, "test", fix.time, now, fix.position, False) for fix in reversed(kept)]
    events = run([*others[: number + 1], *late, *others[number + 1 :]])
    # That they came late is told, too.
    events = [event for event in events if not event.kind.startswith("source")]
    assert [fact[:3] for fact in facts(events)] == [fact[:3] for fact in facts(run(fixes))]
    assert any(event.revises for event in events)


def still(times, agent="ann", place=(48.0, 11.5), **more):
    return [Fix(agent, "test", START + t, START + t, place, **more) for t in times]


def test_nobody_is_silent_by_a_night_in_which_nobody_listened():
    first, second = Monitor(silent_after=600.0), Monitor(silent_after=600.0)
    for fix in still(range(0, 400, 10)):
        first.push(fix)
    second.restore(json.loads(json.dumps(list(first.states()))))

    # It may have been heard of: only what is missed from now on counts.
    morning = START + 40_000
    second.resume(morning)
    assert [second.tick(morning + seconds) for seconds in (0, 500)] == [[], []]
    (event,) = second.tick(morning + 700)
    assert (event.kind, event.time) == ("silent", START + 390)


def test_an_agent_is_silent_once_and_back_once():
    monitor = Monitor(silent_after=600.0)
    events = [event for fix in still(range(0, 400, 10)) for event in monitor.push(fix)]
    for now in range(400, 4000, 100):
        events += monitor.tick(START + now)
    events += [event for fix in still(range(4000, 4400, 10)) for event in monitor.push(fix)]
    told = [
        (event.kind, event.time - START) for event in events if event.kind in {"silent", "back"}
    ]
    assert told == [("silent", 390.0), ("back", 4000.0)]


def test_fixes_that_were_kept_show_that_an_agent_was_not_silent():
    monitor = Monitor(silent_after=600.0)
    events = [event for fix in still(range(0, 400, 10)) for event in monitor.push(fix)]
    events += monitor.tick(START + 4000)
    (silent,) = (event for event in events if event.kind == "silent")
    kept = [
        Fix("ann", "test", fix.time, START + 4100, fix.position)
        for fix in still(range(400, 4100, 10))
    ]
    events += [event for fix in kept for event in monitor.push(fix)]
    (gone,) = (event for event in events if event.withdrawn)
    assert gone.revises == silent.id
    assert not [event for event in standing(events) if event.kind in {"silent", "back"}]


def test_what_is_wrong_with_a_source_is_told_when_it_begins_and_ends():
    # A receiver that repeats its position while it states a speed.
    moving = [
        Fix("van", "gps", START + t, START + t, (48 + t * 1e-4, 11.5), speed=11.0)
        for t in range(100)
    ]
    stuck = still(range(100, 200), "van", moving[-1].position, speed=11.0)
    again = [
        Fix("van", "gps", START + t, START + t, (48 + t * 1e-4, 11.5), speed=11.0)
        for t in range(200, 230)
    ]
    # Then its clock jumps, and it sends what it had kept.
    old = [Fix("van", "gps", START + t, START + t + 7200, (48.02, 11.5)) for t in range(230, 260)]
    fixes = [*moving, *stuck, *again, *old]
    monitor = Monitor()
    events = [event for fix in fixes for event in monitor.push(fix)]
    events += monitor.push(Fix("van", "gps", START + 1e6, START + 7500, (48.02, 11.5)))
    events += monitor.close()
    told = [
        (event.kind, event.details["wrong"]) for event in events if event.kind.startswith("source")
    ]
    assert sorted(told) == [
        ("source.clock", True),
        ("source.repeat", False),
        ("source.repeat", True),
        ("source.stale", True),
    ]
    assert monitor.counts["times more than a day in the future left out"] == 1


def test_a_phone_that_lies_still_sends_its_position_rightly():
    events = run(still(range(0, 3000, 30)))
    assert [event.kind for event in events] == ["stay.start"]


def test_a_second_receiver_of_an_agent_is_not_mixed_in():
    one = [Fix("boat", "a", START + t, START + t, (0.0, 0.1 * t), False) for t in range(400)]
    other = [
        Fix("boat", "b", START + t + 0.5, START + t + 0.5, (900.0, 0.1 * t), False)
        for t in range(400)
    ]
    both = sorted(one + other, key=lambda fix: fix.time)
    assert facts(run(both)) == facts(run(one))


def test_agents_and_fixes_are_bounded():
    monitor = Monitor(max_agents=50)
    for number in range(200):
        monitor.push(Fix(f"a{number}", "x", START + number, START + number, (48.0, 11.0)))
    assert len(list(monitor.states())) == 51
    assert monitor.counts["agents forgotten"] == 150


def test_a_window_is_thinned_where_fixes_are_near_in_time():
    window = Window(geographic=False)
    for time in range(1000):
        window.add(Fix("a", "x", float(time), 0.0, (time * 1.0, 0.0), False))
    window.thin([100.0])
    left = set(window.times.tolist())
    assert left >= {float(time) for time in (*range(40, 161), *range(500, 1000))}
    assert np.diff(window.times).max() == 2
    assert len(left) == 810


def test_an_agent_without_stays_for_days_is_followed_on(monkeypatch):
    # A ship that sends many more fixes than are kept.
    monkeypatch.setattr("gpszip.live.monitor.monitor._MAX_FIXES", 300)
    fixes = [Fix("ship", "x", START + t, START + t, (5.0 * t, 0.0), False) for t in range(3000)]
    (start,) = standing(run(fixes))
    assert start.kind == "trip.start"
    assert start.time - START < 30


def test_a_flight_ends_what_was_open_before_it():
    there = still(range(0, 3000, 30))
    far = [
        Fix("ann", "test", fix.time + 40_000, fix.time + 40_000, (-33.9, 151.2))
        for fix in still(range(0, 3000, 30))
    ]
    kinds = [event.kind for event in standing(run(there + far, silent_after=90_000.0))]
    assert kinds == ["stay.start", "stay.end", "stay.start"]


@pytest.mark.parametrize(
    "fix",
    [
        Fix("a", "x", float("nan"), START, (48.0, 11.0)),
        Fix("a", "x", START, START, (float("inf"), 11.0)),
        Fix("a", "x", START, START, (91.0, 11.0)),
        Fix("a", "x", START, START, (1.0,)),
    ],
)
def test_a_fix_that_is_no_position_is_counted(fix):
    monitor = Monitor()
    assert monitor.push(fix) == []
    assert monitor.late(fix) == []
    assert monitor.counts["fixes that are no positions left out"] == 2


@pytest.mark.parametrize(
    "options", [{"delay": -1.0}, {"radius": 0.0}, {"silent_after": float("inf")}, {"max_agents": 0}]
)
def test_numbers_that_make_no_sense_are_refused(options):
    with pytest.raises(OptionError, match=next(iter(options))):
        Monitor(**options)


def test_late_fixes_of_another_log_are_put_into_their_place():
    fixes = still(range(0, 2000, 10))
    monitor, events = Monitor(), []
    for fix in fixes[:10] + fixes[150:]:
        events += monitor.push(fix)
    for fix in fixes[10:150]:
        events += monitor.late(fix)
    assert monitor.counts["late fixes put into their place"] == 140
    assert facts(events + monitor.close()) == facts(run(fixes))


def test_events_come_asynchronously_too(walker):
    async def come(fixes):
        for fix in fixes:
            yield fix

    async def collect():
        return [event async for event in Monitor().follow(come(fixes))]

    fixes = fixes_of(walker)[:100]
    assert asyncio.run(collect()) == run(fixes)
