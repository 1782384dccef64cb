"""How unusual trips are: planted detours, and plain twins."""

import heapq
import math
from dataclasses import replace

import numpy as np
import pytest

from gpszip.history.calendar import Calendar
from gpszip.history.local_time import find_zone
from gpszip.history.prediction.exits import list_exits
from gpszip.history.prediction.sequence_model import Passes, train
from gpszip.history.traversals import History, Traversals
from gpszip.history.unusual.absences import find_absences
from gpszip.history.unusual.log_trips import list_trips
from gpszip.history.unusual.pass_index import index_passes
from gpszip.history.unusual.route_surprise import surprising_parts, turn_bits
from gpszip.history.unusual.unusual import Usual, find_unusual
from gpszip.history.unusual.usual import learn_paces, learn_stops, pace_groups
from gpszip.model import Track
from gpszip.testing import shuttles
from oracle.histories import exits_of, true_history

#: Hours as in UTC.
UTC = Calendar(find_zone("UTC"), "UTC", "default")

#: Midnight of the first day of the buses, and their days that are known.
FIRST_DAY, KNOWN = 1_704_067_200.0, 2


@pytest.fixture(scope="module")
def buses() -> History:
    return true_history(shuttles(5, lines=5, days=KNOWN + 1, blocks=8, period=600.0, seed=3))


@pytest.fixture(scope="module")
def known(buses: History) -> History:
    rows = buses.traversals
    return History(buses.network, rows.take(rows.enter < FIRST_DAY + KNOWN * 86_400))


@pytest.fixture(scope="module")
def usual(known: History) -> Usual:
    return Usual(known)


def other_way(network, exits, route, first, after):
    """Shortest way around a part of a route by other roads, 1.2 to 4 times as long, or None."""
    length = network.lengths.tolist()
    banned = {edge for edge, _ in route[first:after]}
    goal = set(exits[route[after - 1]])
    queue, done = [(0.0, 0, route[first - 1], [])], set()
    while queue:
        metres, _, last, way = heapq.heappop(queue)
        if way and set(exits[last]) == goal:
            direct = sum(length[edge] for edge, _ in route[first:after])
            return way if 1.2 <= metres / direct <= 4.0 else None
        if last in done:
            continue
        done.add(last)
        for each in exits[last]:
            if each[0] not in banned and each[0] != last[0]:
                heapq.heappush(queue, (metres + length[each[0]], len(done), each, [*way, each]))
    return None


def as_log(network, routes, start, speed=8.0):
    """Tracks and traversals of routes driven at one speed, each a track."""
    tracks, rows = [], []
    for number, route in enumerate(routes):
        time = start + 4000.0 * number
        times, positions = [time], []
        for i, (edge, forward) in enumerate(route):
            line = network.road(edge) if forward else network.road(edge)[::-1]
            length = float(network.lengths[edge])
            begin, end = (0.0, length) if forward else (length, 0.0)
            leave = time + length / speed
            rows.append((number, edge, forward, time, leave, begin, end, 0.0, i == 0))
            positions += line[:1].tolist() if i else line[[0]].tolist()
            time = leave
            times.append(time)
        positions.append(line[-1].tolist())
        tracks.append(Track(f"trip-{number}", times, positions))
    columns = map(np.array, zip(*rows, strict=True))
    track, edge, forward, enter, leave, begin, end, standing, starts = columns
    ids = tuple(each.id for each in tracks)
    return tracks, Traversals(
        ids, track.astype(np.int32), edge, forward, enter, leave, begin, end, standing, starts
    )


def area_under_curve(normal, odd):
    """Share of pairs in which the odd one has the higher score; equal scores count half."""
    return np.mean([(a < b) + 0.5 * (a == b) for a in normal for b in odd])


def test_detours_are_more_unusual_than_normal_trips(usual, buses, known):
    # Trips of the last day of 14 roads and more, every other one with a detour.
    rng = np.random.default_rng(1)
    network, rows = buses.network, buses.traversals
    exits = exits_of(network)
    begin = int(np.flatnonzero(rows.enter >= FIRST_DAY + KNOWN * 86_400)[0])
    routes, is_odd = [], []
    for first in range(begin, len(rows) - 40, 28):
        count = int(rng.integers(14, 28))
        if rows.starts[first + 1 : first + count].any() or rows.enter[first] < rows.enter[begin]:
            continue
        part = slice(first, first + count)
        route = list(zip(rows.edge[part].tolist(), rows.forward[part].tolist(), strict=True))
        odd = len(routes) % 2 == 1
        if odd:
            turn, size = int(rng.integers(1, count - 6)), int(rng.integers(3, 6))
            way = other_way(network, exits, route, turn, turn + size)
            if way is None:
                continue
            route[turn : turn + size] = way
        routes.append(route)
        is_odd.append(odd)

    tracks, traversals = as_log(network, routes, FIRST_DAY + 3 * 86_400)
    found = find_unusual(usual, tracks, traversals)
    scores, is_odd = np.array([trip.score for trip in found.trips]), np.array(is_odd)
    assert [trip.track for trip in found.trips] == [track.id for track in tracks]
    assert min(is_odd.sum(), (~is_odd).sum()) > 30
    # Some normal trips go to other crossings, which no other trip does.
    assert area_under_curve(scores[~is_odd], scores[is_odd]) > 0.95
    assert {trip.track for trip in found.ranked[:5]} <= {
        track.id for track, odd in zip(tracks, is_odd, strict=True) if odd
    }


def test_the_unusual_part_is_the_detour(usual, buses, known):
    # A trip that was made before, once with a detour.
    network, rows = known.network, known.traversals
    exits = exits_of(network)
    route = list(zip(rows.edge[200:230].tolist(), rows.forward[200:230].tolist(), strict=True))
    way = next(
        (first, found)
        for first in range(8, 20)
        if (found := other_way(network, exits, route, first, first + 3))
    )
    first, edges = way
    odd = [*route[:first], *edges, *route[first + 3 :]]
    tracks, traversals = as_log(network, [route, odd], FIRST_DAY + 3 * 86_400)
    normal, strange = find_unusual(usual, tracks, traversals).trips
    assert strange.score > normal.score + 10
    part = strange.anomalies[0]
    assert set(part.edges) & set(edges)
    entered = traversals.enter[len(route) + first]
    assert part.start - 120 <= entered <= part.end + 120
    line = np.concatenate([network.road(edge) for edge, _ in part.edges])
    assert np.linalg.norm(line - part.position, axis=1).min() < 200


def test_support_is_that_of_a_loop():
    rng = np.random.default_rng(4)
    directed = rng.integers(0, 6, 300)
    starts = rng.random(300) < 0.1
    starts[0] = True
    index = index_passes(directed, starts, 6)
    number = np.cumsum(starts)
    for _ in range(60):
        route = rng.integers(0, 6, 6).tolist()
        # The nearest pass over the first edge before each pass over the last one, if no other
        # pass over the last one lies between.
        ways = []
        for end in np.flatnonzero(directed == route[-1]).tolist():
            begins = [
                i
                for i in range(max(0, end - 5 - 12), end)
                if directed[i] == route[0]
                and number[i] == number[end]
                and route[-1] not in directed[i + 1 : end]
            ]
            if begins:
                ways.append(directed[begins[-1] : end + 1].tolist())
        assert index.count_paths(route, 0, 5) == (len(ways), ways.count(route))
    assert [index.passes(edge) for edge in range(6)] == np.bincount(directed, minlength=6).tolist()


def test_parts_are_the_best_and_do_not_overlap(known):
    network, rows = known.network, known.traversals
    exits = list_exits(network)
    few = rows.take(np.arange(len(rows)) < 1500)
    none = np.full(len(few), -1)
    model = train(exits, Passes(few.directed, few.starts, none, none))
    index = index_passes(few.directed, few.starts, 2 * len(network))
    route = rows.directed[3000:3030].tolist()
    bits = turn_bits(model, route, [None] * len(route))
    for i in (1, 7, 20):
        p = model.predict(route[:i])[model.options[route[i - 1]].index(route[i])]
        assert bits[i] == pytest.approx(-math.log2(p))
    parts = surprising_parts(index, route, bits)

    def cost(first, last):
        turns = sum(bits[first + 1 : last + 1])
        support = index.count_paths(route, first, last)
        ways = math.log2((support.all + 1) / (support.same + 0.5)) if support.all else 0.0
        return turns + (ways if turns >= 0.5 else 0.0)

    best = max(cost(i, j) for i in range(28) for j in range(i + 2, min(30, i + 14)))
    assert parts[0].bits == pytest.approx(best)
    assert all(part.bits >= 8 for part in parts[1:])
    spans = sorted((part.first, part.last) for part in parts)
    assert all(one[1] <= other[0] for one, other in zip(spans[:-1], spans[1:], strict=True))


def test_wrong_direction_slow_travel_stops_and_new_roads_have_their_reasons(usual, buses, known):
    network, rows = known.network, known.traversals
    passed = np.bincount(rows.directed, minlength=2 * len(network))
    exits = exits_of(network)

    # An edge that many passed one way and nobody the other way.
    wrong = next(e for e in range(len(passed)) if not passed[e] and passed[e ^ 1] > 20)
    back = (wrong >> 1, not wrong & 1)
    before = next(each for each in exits if back in exits[each] and each[0] != back[0])
    way = list(zip(rows.edge[100:120].tolist(), rows.forward[100:120].tolist(), strict=True))
    tracks, traversals = as_log(
        network, [[before, back, exits[back][0]], way, way, way], FIRST_DAY + 10 * 3600
    )

    # The third trip stands for 4 min in the middle of an edge, and the last one crawls.
    leave, enter, standing = traversals.leave.copy(), traversals.enter.copy(), traversals.standing
    stop = 3 + 20 + 10
    standing = standing.copy()
    standing[stop] = 240.0
    leave[stop : 3 + 40] += 240.0
    enter[stop + 1 : 3 + 40] += 240.0
    crawl = slice(3 + 40, None)
    enter[crawl] = enter[crawl][0] + 6 * (enter[crawl] - enter[crawl][0])
    leave[crawl] = enter[crawl][0] + 6 * (leave[crawl] - traversals.enter[crawl][0])
    columns = {**vars(traversals), "enter": enter, "leave": leave, "standing": standing}
    traversals = Traversals(**columns)
    tracks = [
        Track(
            track.id,
            np.append(enter[traversals.track == i], leave[traversals.track == i][-1]),
            track.positions,
        )
        for i, track in enumerate(tracks)
    ]
    # And one more leaves the map.
    line = np.stack((np.arange(20) * 90.0, np.zeros(20)), axis=1)
    away = Track("away", np.arange(20) * 10.0 + 1.9e9, line)
    found = find_unusual(
        usual, [*tracks, away], Traversals(**{**columns, "ids": (*traversals.ids, "away")})
    )
    first, normal, stopped, slow, off = found.trips
    assert first.anomalies[0].kind == "wrong direction"
    assert first.reason.startswith(f"wrong direction on edge {back[0]}, which {passed[wrong ^ 1]} ")
    assert "stop" in {part.kind for part in stopped.anomalies} - {
        part.kind for part in normal.anomalies
    }
    assert "slow" in {part.kind for part in slow.anomalies} - {
        part.kind for part in normal.anomalies
    }
    assert (off.reason, off.anomalies[0].kind) == ("off the map for 1,710 m", "off the map")
    assert off.score == pytest.approx(14 + 17.1)


def test_paces_are_those_of_the_roads(usual, buses, known):
    network, rows = known.network, known.traversals
    hours = (rows.enter // 3600 % 24).astype(np.int64)
    paces = learn_paces(network, rows, hours)
    first, last, observed, expected = pace_groups(network, rows, hours, paces)
    # Paces of duties and laps vary by .08 and .12 in logarithms.
    off = np.log(observed / expected)
    assert abs(np.median(off)) < 0.03
    assert off.std() < 0.2
    assert (expected >= 30).all()
    assert (first <= last).all()
    for one in range(0, len(first), 50):
        part = slice(first[one], last[one] + 1)
        moving = (rows.leave - rows.enter - rows.standing)[part]
        assert observed[one] == pytest.approx(moving.sum())
    # Of a hundred parts one has more than 2 log2(10) bits on either side.
    bits = np.array([paces.bits(ratio) for ratio in observed / expected])
    assert 0.5 < (bits > 2 * math.log2(10)).mean() / 0.02 < 1.5


def test_jumps_of_the_receiver_have_no_pace(known):
    network, rows = known.network, known.traversals
    hours = np.full(len(rows), -1)
    paces = learn_paces(network, rows, hours)
    moving = rows.leave - rows.enter - rows.standing
    usable = (rows.metres > 20) & (moving > 0)
    jump = int(np.flatnonzero(usable)[100])
    # At 1,000 m/s it would be the fastest part by far; it is left out, as if it had no time.
    leave, standing = rows.leave.copy(), rows.standing.copy()
    leave[jump], standing[jump] = rows.enter[jump] + rows.metres[jump] / 1000, 0.0
    odd = replace(rows, leave=leave, standing=standing, max_speed=60.0)
    no_time = replace(odd, leave=np.where(np.arange(len(rows)) == jump, rows.enter, leave))
    for got, wanted in zip(
        pace_groups(network, odd, hours, paces),
        pace_groups(network, no_time, hours, paces),
        strict=True,
    ):
        np.testing.assert_array_equal(got, wanted)
    learnt = learn_paces(network, odd, hours)
    np.testing.assert_array_equal(learnt.edge, learn_paces(network, no_time, hours).edge)
    without_limit = learn_paces(network, replace(odd, max_speed=np.inf), hours)
    edge = rows.directed[jump]
    assert without_limit.edge[edge] < learnt.edge[edge]


def test_stops_are_rare_where_nobody_stops(known):
    network, rows = known.network, known.traversals
    stops = learn_stops(network, rows)
    stood = np.bincount(rows.directed, rows.standing > 5, 2 * len(network))
    passed = np.bincount(rows.directed, minlength=2 * len(network))
    stop = int(np.argmax(stood * (stood > 0.7 * passed)))
    none = int(np.argmax(passed * (stood == 0)))
    assert stops.bits(stop, 6.0) < 1
    assert stops.bits(none, 6.0) > 3
    longer = rows.standing[rows.directed == stop]
    share = ((rows.standing >= 30).sum() + 0.5) / (len(rows) + 1)
    p = ((longer >= 30).sum() + share) / (len(longer) + 1)
    assert stops.bits(stop, 30.0) == pytest.approx(-math.log2(p))


def test_trips_of_a_log_end_with_gaps_and_stops(known):
    network, rows = known.network, known.traversals
    route = list(zip(rows.edge[:30].tolist(), rows.forward[:30].tolist(), strict=True))
    (track,), traversals = as_log(network, [route], FIRST_DAY)
    times = np.asarray(track.times).copy()
    shift = np.where(np.arange(31) > 10, 1000.0, 0.0)  # no samples for 1,000 s in edge 10
    log = Track("a", times + shift, track.positions)
    moved = Traversals(
        **{
            **vars(traversals),
            "enter": traversals.enter + shift[:-1],
            "leave": traversals.leave + shift[1:],
            "starts": np.isin(np.arange(30), (0, 11)),
            "standing": np.where(np.arange(30) == 20, 400.0, 0.0),
        }
    )
    trips = list(list_trips([log], moved))
    assert [trip.rows.tolist() for trip in trips] == [
        list(range(11)),
        list(range(11, 21)),
        list(range(21, 30)),
    ]
    assert [trip.start for trip in trips][:2] == [times[0], times[11] + 1000]
    assert not any(trip.off_map for trip in trips)


@pytest.mark.parametrize(("reach", "least"), [(math.inf, 100), (1.0, 10), (1e-4, 3)])
def test_short_travel_off_the_map_does_not_count(known, reach, least):
    # Of three logs off the map, only the one that is long enough counts, on maps of any width.
    nothing = known.traversals.take(np.zeros(0, np.int64))
    tracks = [
        Track(f"{metres} m", np.arange(11.0), np.linspace([0.0, 0], [metres, 0], 11))
        for metres in (0.01, 0.9 * least, 1.1 * least)
    ]
    listed = list_trips(
        tracks, replace(nothing, ids=tuple(each.id for each in tracks)), None, reach
    )
    assert [len(trip.off_map) for trip in listed] == [0, 0, 1]


def test_absences_are_hours_in_which_an_agent_always_travels():
    # Travel from 8 to 9 h on ten days; then a day from 6 h with travel at 7 h only.
    enter = FIRST_DAY + np.arange(10) * 86_400 + 8 * 3600 + 600
    row = np.zeros(10)

    def traversals(ids, enter):
        n = len(enter)
        zero = np.zeros(n)
        return Traversals(
            ids,
            zero.astype(np.int32),
            zero.astype(np.int64),
            zero == 0,
            enter,
            enter + 600,
            zero,
            zero + 1,
            zero,
            zero == 0,
        )

    later = FIRST_DAY + 12 * 86_400
    log = Track(
        "a", [later + 6 * 3600, later + 7 * 3600, later + 12 * 3600], [[0, 0], [1, 0], [2, 0]]
    )
    now = traversals(("a",), np.array([later + 7 * 3600.0]))
    (absence,) = find_absences(traversals(("a",), enter + row), [log], now, UTC)
    assert (absence.start, absence.end) == (later + 8 * 3600, later + 9 * 3600)
    assert absence.bits == pytest.approx(math.log2(12))
    assert absence.reason == "no travel from 8 to 9 h UTC, as on most days"
    # The same hour in India, half an hour off those of UTC.
    india = Calendar(find_zone("Asia/Kolkata"), "Asia/Kolkata", "option")
    (local,) = find_absences(traversals(("a",), enter + row), [log], now, india)
    assert (local.start, local.end) == (later + 7.5 * 3600, later + 8.5 * 3600)
    assert local.reason == "no travel from 13 to 14 h Asia/Kolkata, as on most days"
    # On 31 March, clocks in Berlin leave out the hour from 2 h on: nobody is absent then.
    berlin = Calendar(find_zone("Europe/Berlin"), "Europe/Berlin", "option")
    sunday = FIRST_DAY + 90 * 86_400
    spring = Track("a", [sunday - 7200, sunday, sunday + 12 * 3600], [[0, 0], [1, 0], [2, 0]])
    both = np.sort(np.concatenate([enter, enter - 7 * 3600]))
    known = traversals(("a",), both)
    assert set(berlin.part("hour", known.enter)) == {2, 9}
    none = traversals(("a",), np.array([sunday - 7200.0]))
    (summer,) = find_absences(known, [spring], none, berlin)
    assert (summer.start, summer.end) == (sunday + 7 * 3600, sunday + 8 * 3600)
    assert summer.reason == "no travel from 9 to 10 h Europe/Berlin, as on most days"
    # Who travelled then is not absent, and of others nothing is known.
    there = traversals(("a",), np.array([later + 8 * 3600.0]))
    assert not find_absences(traversals(("a",), enter), [log], there, UTC)
    assert not find_absences(traversals(("b",), enter), [log], now, UTC)
