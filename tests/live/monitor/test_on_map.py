"""Agents on the map of an archive."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import gpszip
from gpszip import Fix, Monitor
from gpszip.cli.schemas import EVENT
from gpszip.history.changes.closures import find_closures
from gpszip.history.traversals import match_traversals
from gpszip.live.events import standing
from gpszip.live.monitor.on_map.closures import ClosureWatch
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.new_edges import NewEdges
from gpszip.live.monitor.on_map.passes import Pass
from gpszip.live.monitor.on_map.watch import MapWatch
from gpszip.live.monitor.stays import STAY_KINDS
from gpszip.model import Plane
from gpszip.model.projection import map_coordinates
from gpszip.pipeline.match import network_for
from gpszip.testing import close_road, shuttles


def part(track, begin, end):
    rows = (track.times >= begin) & (track.times < end)
    return gpszip.Track(track.id, track.times[rows], track.positions[rows])


def fixes_of(tracks):
    fixes = [
        Fix(track.id, "test", time, time, tuple(place), geographic=False)
        for track in tracks
        for time, place in zip(track.times.tolist(), track.positions.tolist(), strict=True)
    ]
    return sorted(fixes, key=lambda fix: fix.time)


@pytest.fixture(scope="module")
def fleet():
    """The archive of a morning of shuttle buses, and their log of the two hours after it."""
    log = shuttles(2, lines=2, days=1, seed=2, blocks=4, period=20.0)
    noon = log.tracks[0].times[0] + 5 * 3600
    archive = gpszip.compress([part(t, 0, noon) for t in log.tracks], rmse=6.0, effort=1)
    return archive, [part(track, noon, noon + 7200) for track in log.tracks]


@pytest.fixture(scope="module")
def closed():
    """A road in the middle of the fleet's lines, and the log of the two hours if it is closed."""
    log = shuttles(2, lines=2, days=1, seed=2, blocks=4, period=20.0)
    noon = log.tracks[0].times[0] + 5 * 3600
    road = int(np.argmax(log.road_map.forward + log.road_map.backward))
    around = close_road(log, road, since=noon + 600)
    middle = log.road_map.nodes[log.road_map.edges[road]].mean(axis=0)
    return middle, [part(track, noon, noon + 7200) for track in around.tracks]


@pytest.fixture(scope="module")
def known_map(fleet):
    return KnownMap(fleet[0])


def monitor_on(known_map, **options):
    """A monitor on a map that was read before."""
    monitor = Monitor(**options)
    monitor._map, monitor._watch = known_map, MapWatch(known_map)
    return monitor


@pytest.fixture(scope="module")
def events(fleet, known_map):
    monitor = monitor_on(known_map)
    found = [event for fix in fixes_of(fleet[1]) for event in monitor.push(fix)]
    return found + monitor.close()


def test_edges_agree_with_those_of_the_whole_log(fleet, events):
    archive, tracks = fleet
    network = network_for(tracks, archive)
    names = tuple(track.id for track in tracks)
    rows = match_traversals(tracks, network, names, list(range(len(tracks))))
    expected = {
        (names[track], edge, forward, round(enter / 60))
        for track, edge, forward, enter in zip(
            rows.track.tolist(),
            rows.edge.tolist(),
            rows.forward.tolist(),
            rows.enter.tolist(),
            strict=True,
        )
    }
    near = {(*each[:3], each[3] + shift) for each in expected for shift in (-1, 0, 1)}
    told = [event for event in events if event.kind == "edge.enter"]
    assert len(told) == pytest.approx(len(expected), rel=0.05)
    right = [
        (event.agent, event.edge, event.forward, round(event.time / 60)) in near for event in told
    ]
    assert np.mean(right) > 0.95


def test_who_enters_an_edge_leaves_it_before_the_next(events):
    for agent in {event.agent for event in events}:
        on_edges = [
            event
            for event in events
            if event.agent == agent and event.kind in {"edge.enter", "edge.leave"}
        ]
        for entered, left in zip(on_edges[::2], on_edges[1::2], strict=False):
            assert (entered.kind, left.kind) == ("edge.enter", "edge.leave")
            assert (entered.edge, entered.forward) == (left.edge, left.forward)
            assert entered.time <= left.time


def test_predictions_come_true_more_often_than_not(known_map, events):
    heads = known_map.exits.heads
    told = [event for event in events if event.kind == "predicted"]
    assert told
    entered = [event for event in events if event.kind == "edge.enter"]
    reached = [
        any(
            heads[2 * event.edge + (not event.forward)] == each.details["node"]
            and each.time <= event.time <= each.details["high"] + 300
            for event in entered
            if event.agent == each.agent
        )
        for each in told
    ]
    assert np.mean(reached) > 0.5
    for each in told:
        details = each.details
        assert each.time <= details["low"] <= details["arrival"] <= details["high"]


def test_each_event_has_the_form_of_the_schema(events):
    for event in events[:: max(1, len(events) // 60)]:
        Draft202012Validator(EVENT).validate(json.loads(event.to_json()))
    assert len({event.id for event in events}) == len(events)


def straight_map():
    """A road that many travel to the right, with a way around."""
    laps = []
    for number in range(12):
        begin = 2000.0 * number
        square = np.array([[0, 0], [800, 0], [800, 300], [0, 300], [0, 0]], float)
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(square, axis=0), axis=1))])
        times = np.arange(0, along[-1] / 10, 5.0)
        places = [np.interp(times * 10, along, axis) for axis in square.T]
        laps.append((begin + times, np.stack(places, axis=1)))
    times = 1.7e9 + np.concatenate([each for each, _ in laps])
    return gpszip.Track("old", times, np.concatenate([each for _, each in laps]))


@pytest.fixture(scope="module")
def road():
    return KnownMap(gpszip.compress(straight_map(), rmse=2.0, effort=1))


def drive(road, places, period=5.0):
    monitor = monitor_on(road, silent_after=7200.0)
    found = []
    for number, place in enumerate(places):
        time = 1.75e9 + period * number
        found += monitor.push(Fix("van", "test", time, time, place, geographic=False))
    return found + monitor.close()


def test_the_wrong_way_is_told_once_for_each_edge(road):
    found = drive(road, [(800.0 - 50 * n, 1.0) for n in range(16)])
    wrong = [(event.edge, event.forward) for event in found if event.kind == "wrong_way"]
    assert wrong
    assert len(set(wrong)) == len(wrong)
    right = drive(road, [(50.0 * n, 1.0) for n in range(16)])
    assert not [event for event in right if event.kind == "wrong_way"]


def test_leaving_the_map_is_told_once_and_coming_back_too(road):
    away = [(400.0, -60.0 * n) for n in range(1, 10)]
    places = [*[(50.0 * n, 0.0) for n in range(9)], *away, *away[::-1]]
    places += [(400.0 + 50 * n, 0.0) for n in range(8)]
    kinds = [event.kind for event in drive(road, places) if event.kind.startswith("off_map")]
    assert kinds == ["off_map.start", "off_map.end"]


def test_a_jump_to_another_country_ends_travel_where_it_was_seen_last():
    # Away from the map, and on in another country before three positions say so.
    plane = Plane(((480_000_000, 115_000_000),))
    track = replace(straight_map(), plane=plane)
    monitor = monitor_on(KnownMap(gpszip.compress(track, rmse=2.0, effort=1)))
    places = [*[(50.0 * n, 0.0) for n in range(9)], *[(400.0, -60.0 * n) for n in range(1, 4)]]
    degrees = map_coordinates(np.array(places), plane).tolist() + [[51.0, 11.5]] * 5
    found = []
    for number, place in enumerate(degrees):
        time = 1.75e9 + 5.0 * number
        found += monitor.push(Fix("van", "test", time, time, tuple(place)))
    (away,) = (event for event in found + monitor.close() if event.kind == "off_map.start")
    assert away.position == tuple(degrees[9])


def test_a_stop_where_nobody_stops_is_told_once(road):
    places = [*[(50.0 * n, 0.0) for n in range(8)], *[(400.0, 0.0)] * 100]
    (stop,) = (event for event in drive(road, places) if event.kind == "unusual.stop")
    assert stop.details["since"] == 1.75e9 + 40


def test_a_stop_where_trips_end_is_none_on_the_way(road):
    places = [*[(0.0, 300 - 50.0 * n) for n in range(6)], *[(0.0, 50.0)] * 100]
    found = drive(road, places)
    assert "stay.start" in [event.kind for event in found]
    assert not [event for event in found if event.kind == "unusual.stop"]


@pytest.mark.parametrize("away", [0.0, 70.0])
def test_errors_of_a_receiver_in_place_tell_nothing_again_and_again(road, away):
    # The map takes errors for as large as they are, so that the agent seems to move on it, or to
    # leave it and come back.
    rough = KnownMap(
        gpszip.compress(straight_map(), rmse=2.0, effort=1),
        replace(road.scales, error=8.0, beta=24.0),
    )
    errors = np.random.default_rng(1).normal(0, 15, (2000, 2))
    drift = [tuple(each) for each in np.array([400.0, -away]) + errors]
    found = drive(rough, [*[(50.0 * n, 0.0) for n in range(9)], *drift], period=10.0)
    told = Counter(event.kind for event in standing(found))
    assert told["stay.start"] == 1
    kinds = ("off_map.start", "off_map.end", "unusual.stop", "unusual.turn", "wrong_way")
    assert all(told[kind] <= 1 for kind in kinds), told

    # Nor does it travel edges; what was told before it was sure to stay is withdrawn.
    (stay,) = (event.time for event in found if event.kind == "stay.start")
    edges = [event for event in standing(found) if event.kind.startswith("edge")]
    assert edges
    assert all(event.time <= stay + 10.0 for event in edges)
    assert sum(event.withdrawn for event in found) < 40


def test_whoever_stays_off_the_map_comes_back_once(road):
    out = [(400.0, -40.0 * n) for n in range(1, 8)]
    way = [*[(50.0 * n, 0.0) for n in range(9)], *out, *[(400.0, -280.0)] * 60, *out[::-1]]
    found = standing(drive(road, [*way, *[(400.0 + 40 * n, 0.0) for n in range(10)]], period=10.0))
    assert "stay.start" in [event.kind for event in found]
    kinds = [event.kind for event in found if event.kind.startswith("off_map")]
    assert kinds == ["off_map.start", "off_map.end"]


def test_whoever_stays_is_not_late_and_goes_nowhere(road):
    # A phone that lies at its goal is silent until long after it has arrived.
    square = np.array([[0, 0], [800, 0], [800, 300], [0, 300], [0, 20]], float)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(square, axis=0), axis=1))])
    way = [np.interp(np.arange(0, along[-1], 50.0), along, axis) for axis in square.T]
    times = [5.0 * n for n in range(len(way[0]))]
    places = list(zip(*way, strict=True)) + [(0.0, 5.0 * (n % 2)) for n in range(20)]
    times += [times[-1] + 1800.0 * n for n in range(1, 21)]
    monitor, found = monitor_on(road, silent_after=7200.0), []
    for time, place in zip(times, places, strict=True):
        found += monitor.push(Fix("van", "test", 1.75e9 + time, 1.75e9 + time, place, False))
    arrived = 1.75e9 + times[len(way[0])]
    assert any(event.kind == "predicted" for event in found)
    assert not [event for event in found if event.kind == "late"]
    assert all(event.time < arrived for event in found if event.kind == "predicted")


def test_a_slow_drive_is_told_once(fleet, known_map, events):
    # All of it takes four times as long.
    track = fleet[1][0]
    times = track.times[0] + 4 * (track.times - track.times[0])
    slow = gpszip.Track(track.id, times[:200], track.positions[:200])
    monitor = monitor_on(known_map)
    found = [event for fix in fixes_of([slow]) for event in monitor.push(fix)]
    paces = [event.details["pace"] for event in found if event.kind == "unusual.speed"]
    assert paces == ["slow"] * len(paces)
    assert 1 <= len(paces) <= 5
    assert sum(event.kind == "unusual.speed" for event in events) <= 2


def test_a_monitor_on_a_map_goes_on_where_another_one_was_saved(fleet, known_map):
    fixes = fixes_of(fleet[1])[:240]
    whole, first, second = (monitor_on(known_map) for _ in range(3))
    expected = [event for fix in fixes for event in whole.push(fix)]
    found = [event for fix in fixes[:120] for event in first.push(fix)]
    second.restore(json.loads(json.dumps(list(first.states()))))
    found += [event for fix in fixes[120:] for event in second.push(fix)]
    assert len({event.id for event in found}) == len(found)
    assert {event.id for event in found} == {event.id for event in expected}


def test_what_was_saved_on_another_map_is_left(fleet, known_map, road):
    fixes = fixes_of(fleet[1])[:60]
    first, second = monitor_on(known_map), monitor_on(road)
    found = [event for fix in fixes for event in first.push(fix)]
    assert any(event.kind == "edge.enter" for event in found)
    second.restore(json.loads(json.dumps(list(first.states()))))
    head, *agents = second.states()
    assert head["watch"]["closures"]["passes"] == {}
    current = [agent["on_map"]["reader"]["passes"]["current"] for agent in agents]
    assert current == [None] * len(agents)


def test_a_closed_road_is_told_and_an_open_one_is_not(known_map, closed, events):
    middle, tracks = closed
    monitor = monitor_on(known_map)
    found = [event for fix in fixes_of(tracks) for event in monitor.push(fix)]
    found = standing(found + monitor.close())
    alarms = [event for event in found if event.kind == "closed"]
    assert alarms
    assert min(np.linalg.norm(np.array(event.position) - middle) for event in alarms) < 150
    for event in alarms:
        (suspected,) = (
            each
            for each in found
            if each.kind == "closed.suspected"
            and (each.edge, each.forward, each.details["since"])
            == (event.edge, event.forward, event.details["since"])
        )
        assert suspected.time <= event.time

    # The batch finds the same.
    rows, is_live = monitor._watch.closures._rows()
    batch = find_closures(known_map.network, rows, is_live, monitor._watch.closures._threshold)
    assert {(event.edge, event.forward, event.time) for event in alarms} == {
        (edge >> 1, not edge & 1, time)
        for edge, time in zip(batch.directed.tolist(), batch.detected.tolist(), strict=True)
    }
    assert not [event for event in standing(events) if event.kind == "closed"]


@pytest.mark.parametrize("is_timed", [True, False])
def test_passes_and_agents_that_are_forgotten_leave_nothing(known_map, monkeypatch, is_timed):
    monkeypatch.setattr("gpszip.live.monitor.on_map.closures._MAX_PASSES", 8)
    watch = ClosureWatch(known_map)
    if not is_timed:
        watch._threshold = np.inf

    # The clock of the first one is ahead by some hours.
    for number in range(20):
        time = 1.75e9 + (number or 40_000)
        agent = f"agent {number}"
        watch.take(agent, 0, [Pass(0, time, 0.0, True, 10.0, time + 0.5)], time + 0.5)
        watch.forget(agent)
        assert watch._count <= 8
    row = watch.to_row()
    assert list(row["passes"]) == list(row["first"])
    assert "agent 19" in row["passes"]


def test_a_path_off_the_map_is_a_new_edge_the_second_time(fleet, known_map):
    # From the eastern end of a line, 400 m out of town and back by the same path.
    positions = fleet[1][0].positions
    east = 40 + int(positions[40:-40, 0].argmax())
    out = positions[east] + np.outer(np.linspace(30, 400, 12), [1.0, 0.0])
    places = [*positions[east - 40 : east + 1], *out, *out[::-1], *positions[east : east + 40]]

    monitor, found = monitor_on(known_map), []
    for number, agent in enumerate(("ann", "bob", "cat")):
        for n, place in enumerate(places):
            time = 1.75e9 + 3000 * number + 20.0 * n
            found += monitor.push(Fix(agent, "test", time, time, tuple(place), geographic=False))
    found += monitor.close()
    for kind in ("off_map.start", "off_map.end"):
        assert sum(event.kind == kind for event in found) == 3
    (new,) = (event for event in found if event.kind == "new_edge")
    assert (new.agent, len(new.details["path"])) == ("", 16)
    assert new.details["length"] == pytest.approx(800, rel=0.2)
    assert new.time > 1.75e9 + 3000


def test_a_new_edge_is_withdrawn_if_it_was_not_travelled_again(known_map):
    path = np.stack([np.linspace(900, 1200, 20), np.zeros(20)], axis=1)
    edges = NewEdges(known_map)
    assert not edges.take("ann", 0, [(path, 100.0)], 100.0)
    (told,) = edges.take("bob", 0, [(path[::-1], 200.0)], 200.0)
    assert (told.kind, told.time) == ("new_edge", 200.0)

    # Later fixes show that it was not; and that somebody else did before.
    (withdrawn,) = edges.take("bob", 0, [], 300.0)
    assert (withdrawn.revises, withdrawn.withdrawn) == (told.id, True)
    (earlier,) = edges.take("cat", 0, [(path + 3.0, 50.0)], 400.0)
    assert (earlier.time, earlier.withdrawn) == (100.0, False)
    other = NewEdges(known_map)
    other.restore(json.loads(json.dumps(edges.to_row())))
    assert other.take("dan", 0, [(path, 500.0)], 500.0) == []

    # Whoever is forgotten and begins anew takes nothing back.
    other.forget("ann")
    assert other.take("ann", 0, [], 600.0) == []


def test_a_late_fix_of_long_ago_keeps_no_later_one_from_the_map(in_order, known_map, monkeypatch):
    monkeypatch.setattr("gpszip.live.monitor.on_map.tracker._HORIZON", 600.0)
    old, recent, received = in_order[20], in_order[70:76], in_order[89].received

    def revised(late):
        monitor = monitor_on(known_map)
        for fix in in_order[:90]:
            if fix not in (old, *recent):
                monitor.push(fix)
        for fix in late:
            monitor.push(replace(fix, received=received))
        found = [event for event in monitor.tick(received + 5) if event.edge is not None]
        key = "late fixes too old to correct events on the map"
        return [(event.kind, event.edge, event.time) for event in found], monitor.counts[key]

    found, count = revised(recent)
    assert found
    assert count == 0
    assert revised([old, *recent]) == (found, 1)
    assert revised([old]) == ([], 1)


def guard(laps, begin):
    """Rounds of a guard: a block, and then a spur, which some laps leave out."""
    block = [(90, 0), (90, 60), (0, 60), (0, 0)]
    corners = [(0, 0)]
    for has_spur in laps:
        corners += [*block, (-80, 0), (0, 0)] if has_spur else block
    line = np.array(corners, float)
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    times = np.arange(0, along[-1] / 1.5, 4.0)
    places = np.stack([np.interp(1.5 * times, along, axis) for axis in line.T], axis=1)
    return gpszip.Track("guard", begin + times, places)


def test_a_patrol_completes_rounds_and_misses_edges():
    known_map = KnownMap(gpszip.compress(guard([True] * 12, 1.7e9), max_error=1.0, effort=1))
    assert known_map.rounds is not None
    monitor = monitor_on(known_map)
    track = guard([True, True, False, True, True], 1.75e9)
    found = [event for fix in fixes_of([track]) for event in monitor.push(fix)]
    found += monitor.close()
    rounds = [event for event in found if event.kind == "round.complete"]
    assert [event.details["round"] for event in rounds] == list(range(1, len(rounds) + 1))
    assert len(rounds) >= 3
    shares = [event.details["share"] for event in rounds]
    assert min(shares) < 0.75
    assert max(shares) > 0.9
    (missed,) = (event for event in found if event.kind == "missed")
    assert missed.position[0] < 0
    assert sum(event.kind == "visited" for event in found) >= len(rounds)


def facts(events):
    """What a reader of events knows in the end: of the map all, of stays and trips their times."""
    return sorted(
        (event.kind, event.agent, event.time, _of_map(event))
        for event in standing(events)
        # Sources are about arrival; closures are told again if they move by a second.
        if not event.kind.startswith(("source", "closed"))
    )


def _of_map(event):
    if event.kind in STAY_KINDS:
        return ""
    return json.dumps([event.edge, event.forward, event.offset, event.position, event.details])


@pytest.fixture(scope="module")
def in_order(fleet):
    """Fixes of 50 minutes, in which a bus also stays for ten minutes off the map."""
    fixes = fixes_of([part(fleet[1][0], 0, fleet[1][0].times[0] + 1800)])
    begin, place = fixes[-1].time, np.array(fixes[-1].position)
    errors = np.random.default_rng(3).normal(0, 6, (40, 2))
    away = [place + np.array([0, 25.0 * n]) for n in range(1, 12)]
    way = [*away, *(away[-1] + errors), *away[::-1]]
    more = [
        replace(fixes[-1], time=begin + 20.0 * n, position=tuple(each.tolist()))
        for n, each in enumerate(way, 1)
    ]
    return [replace(fix, received=fix.time) for fix in [*fixes, *more]]


@pytest.fixture(scope="module")
def in_order_facts(in_order, known_map):
    monitor = monitor_on(known_map)
    return facts([each for fix in in_order for each in monitor.push(fix)] + monitor.close())


@pytest.mark.parametrize("seed", range(4))
def test_in_whatever_order_fixes_come_the_same_events_stand(
    in_order, in_order_facts, known_map, seed
):
    # Some come late by up to half an hour, and all of a while come together, after it.
    rng = np.random.default_rng(seed)
    times = np.array([fix.time for fix in in_order])
    delays = np.where(rng.random(len(times)) < 0.05, rng.uniform(0, 1800, len(times)), 0.0)
    begin, end = np.sort(rng.choice(len(times), 2))
    delays[begin:end] = times[end] + 30 - times[begin:end]
    fixes = [
        replace(fix, received=fix.time + delay)
        for fix, delay in zip(in_order, delays.tolist(), strict=True)
    ]
    fixes.sort(key=lambda fix: fix.received)

    monitor = monitor_on(known_map)
    found = [event for fix in fixes for event in monitor.push(fix)] + monitor.close()
    assert facts(found) == in_order_facts
    assert len({event.id for event in found}) == len(found)
    assert any(event.revises for event in found)
