"""Routes over learned maps: against plain searches, by hours, in open directions, and errors."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.history.routes import Position, find_position, find_routes
from gpszip.history.travel_time import learn_travel_times
from gpszip.history.traversals import History
from gpszip.model import Network
from history_rows import drives


def grid(side: int = 4) -> Network:
    """Streets of 100 m between the crossings of a grid."""
    nodes = 100.0 * np.stack(np.meshgrid(range(side), range(side)), axis=-1).reshape(-1, 2)
    pairs = [
        (a, b)
        for a, b in itertools.combinations(range(side**2), 2)
        if np.linalg.norm(nodes[a] - nodes[b]) == 100
    ]
    starts, ends = np.array(pairs, np.int32).T
    points = nodes[np.array(pairs).reshape(-1)]
    yes = np.ones(len(pairs), bool)
    offsets = 2 * np.arange(len(pairs) + 1)
    return Network(nodes, starts, ends, offsets, points, yes, yes, np.full(len(pairs), np.nan))


def random_history(seed: int) -> History:
    """Every edge travelled some times in some directions, at speeds of its own by the hour."""
    rng, network = np.random.default_rng(seed), grid()
    rows = []
    for edge in range(len(network)):
        for forward in (True, False):
            for _ in range(rng.integers(0, 4)):
                enter = float(rng.integers(0, 24) * 3600 + rng.integers(0, 900))
                rows.append((len(rows), edge, forward, enter, enter + rng.uniform(5, 40)))
    return History(network, drives(rows))


def all_paths(history: History, start: Position, goal: Position, cost) -> float:
    """Least cost of all paths without a repeated directed edge, by trying them."""
    network, rows = history.network, history.traversals
    is_open = np.bincount(rows.directed, minlength=2 * len(network)) > 0
    tails = np.stack([network.starts, network.ends], axis=1).reshape(-1)
    heads = np.stack([network.ends, network.starts], axis=1).reshape(-1)
    goals = {2 * goal.edge: goal.offset, 2 * goal.edge + 1: 100 - goal.offset}
    best = np.inf
    stack = []
    for directed, begin in (
        (2 * start.edge, start.offset),
        (2 * start.edge + 1, 100 - start.offset),
    ):
        if is_open[directed]:
            if directed in goals and goals[directed] >= begin:
                best = min(best, cost(directed, goals[directed] - begin))
            stack.append((cost(directed, 100 - begin), directed, frozenset([directed])))
    while stack:
        total, directed, seen = stack.pop()
        if total >= best:
            continue
        ways = [
            w for w in np.flatnonzero((tails == heads[directed]) & is_open) if w != directed ^ 1
        ]
        for way in ways or [w for w in [directed ^ 1] if is_open[w]]:
            if way in goals:
                best = min(best, total + cost(way, goals[way]))
            if way not in seen:
                stack.append((total + cost(way, 100.0), way, seen | {way}))
    return best


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("by", ["time", "length", "traversals"])
def test_routes_cost_the_least_of_all_paths(seed: int, by: str) -> None:
    history, rng = random_history(seed), np.random.default_rng(seed)
    network, rows = history.network, history.traversals
    times = learn_travel_times(history)
    counts = np.bincount(rows.directed, minlength=2 * len(network))
    rates = {
        "time": times.rates.mean(axis=1),
        "length": np.ones(len(counts)),
        "traversals": 1 / np.maximum(counts, 1),
    }[by]
    for _ in range(4):
        start, goal = (
            Position(int(rng.integers(len(network))), float(rng.uniform(1, 99)), 0.0)
            for _ in range(2)
        )
        least = all_paths(history, start, goal, lambda way, metres: rates[way] * metres)
        try:
            route = find_routes(history, [start, goal], by=by, times=times)[0]
        except OptionError:
            assert least == np.inf
            continue
        directed = 2 * route.edges + ~route.forward
        assert (counts[directed] > 0).all()
        assert route.traversals == counts[directed].min()
        assert (rates[directed] * route.lengths).sum() == pytest.approx(least)
        assert np.linalg.norm(np.diff(route.line, axis=0), axis=1).sum() == pytest.approx(
            route.length
        )


def ring_by_hours() -> History:
    """Two ways between the same nodes: the upper one is slow in the morning, the lower at night."""
    nodes = np.array([[0.0, 0.0], [1000.0, 0.0], [-200.0, 0.0], [1200.0, 0.0]])
    upper = np.array([[0.0, 0.0], [500.0, 300.0], [1000.0, 0.0]])
    lower = upper * [1, -1]
    points = np.concatenate([upper, lower, nodes[[2, 0]], nodes[[1, 3]]])
    starts, ends = np.array([0, 0, 2, 1], np.int32), np.array([1, 1, 0, 3], np.int32)
    yes = np.ones(4, bool)
    network = Network(
        nodes, starts, ends, np.array([0, 3, 6, 8, 10]), points, yes, yes, np.full(4, np.nan)
    )
    rows, length = [], network.lengths
    for day in range(30):
        for hour, speeds in ((8, (4, 12)), (22, (12, 4))):
            for edge in range(4):
                enter = 86_400.0 * day + 3600 * hour + 100 * edge
                speed = speeds[edge] if edge < 2 else 10
                rows.append((len(rows), edge, True, enter, enter + length[edge] / speed))
    told = drives(rows)
    end = np.where(told.forward, length[told.edge], 0.0)
    return History(network, type(told)(**{**vars(told), "end": end}))


def test_the_hour_decides_for_the_fastest() -> None:
    history = ring_by_hours()
    times = learn_travel_times(history)
    stops = [Position(2, 50.0, 0.0), Position(3, 100.0, 0.0)]
    morning = find_routes(history, stops, times=times, depart=8.1 * 3600)[0]
    evening = find_routes(history, stops, times=times, depart=22.1 * 3600)[0]
    assert morning.edges.tolist() == [2, 1, 3]
    assert evening.edges.tolist() == [2, 0, 3]
    # 10 m/s to and from the ring and 12 m/s on it, drawn a little to the mean of the day.
    seconds = 25 + morning.lengths[1] / 12
    assert seconds < morning.arrival.seconds < 1.2 * seconds


def test_alternatives_differ() -> None:
    history = ring_by_hours()
    times = learn_travel_times(history)
    stops = [Position(2, 50.0, 0.0), Position(3, 100.0, 0.0)]
    first, second = find_routes(history, stops, by="length", times=times, alternatives=3)
    assert {first.edges[1], second.edges[1]} == {0, 1}


def test_stops_on_the_way() -> None:
    history = random_history(1)
    stops = [Position(0, 10.0, 0.0), Position(5, 50.0, 0.0), Position(9, 20.0, 0.0)]
    both = find_routes(history, stops, by="length")[0]
    legs = [find_routes(history, list(pair), by="length")[0] for pair in itertools.pairwise(stops)]
    assert both.length == pytest.approx(sum(leg.length for leg in legs))
    assert both.arrival is None


def test_nobody_went_there() -> None:
    history = ring_by_hours()
    with pytest.raises(OptionError, match="no route leads"):
        find_routes(history, [Position(3, 10.0, 0.0), Position(2, 10.0, 0.0)], by="length")
    with pytest.raises(OptionError, match="nothing to plan by"):
        find_routes(history, [Position(2, 0.0, 0.0)] * 2, by="beauty")
    with pytest.raises(OptionError, match="no route is fastest"):
        find_routes(history, [Position(2, 0.0, 0.0)] * 2)


def test_no_route_takes_a_jump() -> None:
    history = random_history(0)
    stops, rows = [Position(0, 50.0, 0.0), Position(11, 50.0, 0.0)], history.traversals
    assert find_routes(history, stops, by="length")[0].edges.tolist() == [0, 2, 5, 11]
    leave = np.where(rows.edge == 5, rows.enter + 0.1, rows.leave)
    jumpy = History(history.network, replace(rows, leave=leave, max_speed=60.0))
    assert find_routes(jumpy, stops, by="length")[0].edges.tolist() == [0, 3, 9, 11]


def test_positions() -> None:
    network = grid()
    rng = np.random.default_rng(1)
    for place in rng.uniform(-10, 310, (20, 2)):
        found = find_position(network, place)
        # By many points on each road.
        share = np.linspace(0, 1, 401)[:, None]
        each = [(1 - share) * network.road(e)[0] + share * network.road(e)[1] for e in range(24)]
        distance = np.linalg.norm(np.stack(each) - place, axis=2)
        assert found.distance == pytest.approx(distance.min(), abs=0.3)
    # On an edge that only jumps took, nobody is.
    is_open = np.arange(24) != found.edge
    assert find_position(network, place, open_edges=is_open).edge != found.edge
    with pytest.raises(OptionError, match="stop 2 is 700 m from the map"):
        find_position(network, [1000.0, 0.0], "stop 2")


def test_routes_of_an_archive(vans, van_archive: gpszip.Archive) -> None:
    # From the start of a van to where it is ten minutes later.
    walk, track = vans.walks[0], vans.tracks[0]
    start, goal = track.positions[2], track.positions[122]
    route = gpszip.route(van_archive, start, goal, by="length")[0]
    truth = np.linalg.norm(np.diff(vans.positions[0][2:123], axis=0), axis=1).sum()
    assert np.linalg.norm(goal - start) - 60 < route.length < truth + 60
    assert np.linalg.norm(route.line[0] - start) < 30
    assert np.linalg.norm(route.line[-1] - goal) < 30
    fast = gpszip.route(van_archive, start, goal, depart="00:20")[0]
    assert fast.arrival.low < fast.arrival.seconds < fast.arrival.high
    assert 3 < fast.length / fast.arrival.seconds < 12
    assert len(walk.nodes) > 2
    for wrong in ("8h", "25:00", "08:61"):
        with pytest.raises(OptionError, match=r"no departure|no time of day"):
            gpszip.route(van_archive, start, goal, depart=wrong)
    with pytest.raises(OptionError, match="two places"):
        gpszip.route(van_archive, start)
