from collections import Counter

import numpy as np
import pytest

import gpszip
from gpszip.codec.waypoints import find_waypoints
from gpszip.errors import OptionError
from gpszip.graph.road_graph import build_road_graph
from gpszip.graph.route import build_route
from gpszip.testing import (
    complete_graph,
    fleet,
    patrol,
    patrol_with_truth,
    person,
    quadrotor,
    ring,
    shuttles,
    taxis,
)
from gpszip.testing.roads import build_roads, drive
from oracle.drives import drive as plain_drive
from oracle.drives import position, traversals

GENERATORS = {
    "patrol": lambda seed: patrol_with_truth(3000, seed=seed),
    "quadrotor": lambda seed: quadrotor(1500, seed=seed),
    "quadrotor in 3-D": lambda seed: quadrotor(1500, seed=seed, dimension=3),
    "person": lambda seed: person(21, seed=seed),
    "taxis": lambda seed: taxis(2, points=700, seed=seed),
    "fleet": lambda seed: fleet(4, lines=2, points=400, seed=seed),
    "shuttles": lambda seed: shuttles(2, lines=2, days=1, blocks=4, period=60.0, seed=seed),
    "ring": lambda seed: ring(7, laps=5, samples=3, seed=seed, noise=1.0),
    "complete graph": lambda seed: complete_graph(7, steps=50, samples=3, seed=seed, noise=1.0),
}

#: Generators whose agents follow straight roads exactly.
ON_ROADS = ("person", "taxis", "fleet", "shuttles", "ring", "complete graph")


@pytest.fixture(params=GENERATORS)
def generator(request):
    return GENERATORS[request.param]


def test_seeds_select_logs(generator):
    first, again, other = generator(5), generator(5), generator(6)
    for one, two in zip(first.tracks, again.tracks, strict=True):
        assert np.array_equal(one.times, two.times)
        assert np.array_equal(one.positions, two.positions)
    assert not np.array_equal(first.tracks[0].positions[:50], other.tracks[0].positions[:50])


def test_tracks_positions_and_walks_go_together(generator):
    log = generator(2)
    assert len(log) == sum(len(track) for track in log.tracks)
    for track, truth, walk in zip(log.tracks, log.positions, log.walks, strict=True):
        assert track.positions.shape == truth.shape
        assert walk.id == track.id
        assert walk.time_ranges.tolist() == [[track.times[0], track.times[-1]]]
        assert walk.times[0] <= track.times[0]
        assert walk.times[-2] < track.times[-1] <= walk.times[-1]
        assert (np.diff(walk.times) > 0).all()


def test_walks_follow_roads_and_are_counted(generator):
    log = generator(3)
    counts = sum((Counter(traversals(walk)) for walk in log.walks), Counter())
    road_map = log.road_map
    assert (road_map.edges[:, 0] < road_map.edges[:, 1]).all()
    for (u, v), forward, backward in zip(
        road_map.edges.tolist(), road_map.forward, road_map.backward, strict=True
    ):
        assert counts.pop((u, v), 0) == forward
        assert counts.pop((v, u), 0) == backward
    assert not counts


@pytest.mark.parametrize("name", ON_ROADS)
def test_true_positions_are_those_of_the_walk(name):
    log = GENERATORS[name](4)
    for track, truth, walk in zip(log.tracks, log.positions, log.walks, strict=True):
        for row in range(0, len(track), 17):
            expected = position(walk, log.road_map.nodes, track.times[row])
            assert truth[row] == pytest.approx(expected, abs=1e-6)


def test_errors_are_those_of_the_samples():
    log = taxis(2, points=300, noise=6.0)
    for track, truth, errors in zip(log.tracks, log.positions, log.errors, strict=True):
        assert errors[9] == pytest.approx(np.hypot(*(track.positions[9] - truth[9])))
        assert np.sqrt((errors**2).mean() / 2) == pytest.approx(6.0, rel=0.15)


def test_the_network_has_the_roads_of_the_map():
    log = fleet(2, points=300, noise=1.0)
    assert len(log.network) == len(log.road_map.edges)
    (match,) = gpszip.match(log.tracks[0], log.network).matches
    travelled = {frozenset(pair) for pair in traversals(log.walks[0])}
    matched = [frozenset(log.road_map.edges[edge].tolist()) for edge in match.edge]
    # A sample at a crossing may lie on any of its roads.
    assert np.mean([pair in travelled for pair in matched]) > 0.95
    assert np.array_equal(log.network.road(3), log.road_map.nodes[log.road_map.edges[3]])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("wait", [0.0, 20.0])
def test_drives_take_shortest_paths_one_after_the_other(seed, wait):
    rng = np.random.default_rng(seed)
    roads = build_roads(4, 100.0, rng)
    stops = np.array([3, 20, 7, 8, 3, 24, 0], np.int32)
    departures = np.sort(rng.uniform(0, 300, len(stops) - 1))
    departures[2] = departures[1]
    speeds = rng.uniform(3, 9, len(stops) - 1)
    for until in (50.0, 200.0, 5000.0):
        walk = drive("a", roads, stops, departures, speeds, wait=wait, until=until)
        nodes, times = plain_drive(
            roads.nodes, roads.edges, stops.tolist(), departures, speeds, wait, until
        )
        assert walk.nodes.tolist() == nodes
        assert walk.times == pytest.approx(np.array(times))


@pytest.mark.parametrize("blocks", [1, 2, 12])
def test_towns_connect_all_crossings(blocks):
    roads = build_roads(blocks, 50.0, np.random.default_rng(blocks))
    assert len(roads.nodes) == (blocks + 1) ** 2
    reached, queue = {0}, [0]
    while queue:
        node = queue.pop()
        for u, v in roads.edges.tolist():
            for here, there in ((u, v), (v, u)):
                if here == node and there not in reached:
                    reached.add(there)
                    queue.append(there)
    assert len(reached) == len(roads.nodes)


def test_patrol_with_truth_is_the_patrol():
    log, track = patrol_with_truth(2000, seed=9, id="r"), patrol(2000, seed=9, id="r")
    assert np.array_equal(log.tracks[0].positions, track.positions)
    assert log.tracks[0].id == track.id == "r"


def test_patrol_passes_its_crossings():
    log = patrol_with_truth(40_000, sway=0.0, noise=0.0)
    walk, nodes = log.walks[0], log.road_map.nodes
    row = np.searchsorted(log.tracks[0].times, walk.times[:-1])
    off = np.linalg.norm(log.positions[0][row] - nodes[walk.nodes[:-1]], axis=1)
    assert off.max() < 0.5  # corners are rounded over about 40 cm


def test_wind_moves_the_quadrotor_and_not_its_log():
    calm, windy = quadrotor(4000, wind=0.0, noise=0.0), quadrotor(4000, wind=2.0, noise=0.0)
    assert calm.errors[0].max() == windy.errors[0].max() == 0
    assert (windy.positions[0] - calm.positions[0]).std() == pytest.approx(2.0, rel=0.3)


def test_a_person_has_a_home_and_work_days():
    log = person(70, seed=1)
    walk = log.walks[0]
    at_night = [position(walk, log.road_map.nodes, day * 86_400 + 4 * 3600) for day in range(70)]
    home = log.road_map.nodes[walk.nodes[0]]
    assert np.allclose(at_night, home)
    noon = [position(walk, log.road_map.nodes, day * 86_400 + 11 * 3600) for day in range(70)]
    away = np.linalg.norm(np.array(noon) - home, axis=1) > 1
    weekend = np.arange(70) % 7 >= 5
    assert away[~weekend].mean() > 0.8 > 0.4 > away[weekend].mean()


def test_a_phone_jumps_and_loses_samples():
    log = person(120, seed=2)
    errors = log.errors[0]
    assert 0.001 < (errors > 100).mean() < 0.006
    assert np.median(errors) < 15
    track, walk = log.tracks[0], log.walks[0]
    moving = np.flatnonzero(walk.nodes[1:] != walk.nodes[:-1])
    samples = np.diff(np.searchsorted(track.times, walk.times))[moving]
    expected = np.diff(walk.times)[moving] / 12.0
    assert 0.6 < samples.sum() / expected.sum() < 0.9


def test_taxis_have_samples_a_minute_and_breaks():
    log = taxis(1, points=3000)
    steps = np.diff(log.tracks[0].times)
    assert np.median(steps) == pytest.approx(60, rel=0.05)
    assert (steps > 13 * 3600).sum() == 2999 // 600
    stays = log.walks[0].nodes[1:] == log.walks[0].nodes[:-1]
    assert stays.sum() > 100


def test_vehicles_of_a_line_share_its_roads():
    log = fleet(6, lines=2, points=2000)
    roads = [set(map(frozenset, traversals(walk))) for walk in log.walks]
    assert roads[0] == roads[2] == roads[4]
    assert roads[0] != roads[1]
    assert roads[0] & roads[1]


def test_shuttles_stop_change_lines_and_are_slow_in_rush_hours():
    log = shuttles(3, lines=3, days=2, blocks=6, period=60.0, seed=2)
    for walk in log.walks:
        # Stops last tens of seconds, and the night nearly half a day.
        stays = walk.nodes[1:] == walk.nodes[:-1]
        seconds = np.diff(walk.times)
        assert np.quantile(seconds[stays], 0.9) < 120
        assert (seconds > 10 * 3600).sum() == 1
        # The same roads take longer at 8 h than at noon.
        metres = np.linalg.norm(np.diff(log.road_map.nodes[walk.nodes], axis=0), axis=1)
        hour = walk.times[:-1] // 3600 % 24
        pace = [
            (seconds[~stays & (hour == h)] / metres[~stays & (hour == h)]).mean() for h in (8, 12)
        ]
        assert 1.2 < pace[0] / pace[1] < 2.0
    # Vehicles have lines of their own, and lines in common.
    roads = [set(map(frozenset, traversals(walk))) for walk in log.walks]
    for one in roads:
        for other in roads:
            assert len(one & other) > 0.5 * len(one)


def waypoint_count(log):
    graph = build_road_graph(log.road_map.nodes, log.road_map.edges)
    return len(find_waypoints(graph, build_route(graph, log.walks[0].nodes)))


@pytest.mark.parametrize("nodes", [12, 60])
def test_few_waypoints_hold_a_ring(nodes):
    assert waypoint_count(ring(nodes, laps=10)) <= 31


def test_a_complete_graph_needs_every_node():
    log = complete_graph(30, steps=400)
    assert waypoint_count(log) == len(log.walks[0].nodes) == 401
    assert (log.walks[0].nodes[1:] != log.walks[0].nodes[:-1]).all()


@pytest.mark.parametrize(
    "call",
    [
        lambda: quadrotor(1),
        lambda: quadrotor(waypoints=2),
        lambda: quadrotor(dimension=4),
        lambda: person(0),
        lambda: person(1, blocks=2),
        lambda: taxis(0),
        lambda: taxis(points=1),
        lambda: fleet(lines=0),
        lambda: fleet(blocks=0),
        lambda: shuttles(days=0),
        lambda: ring(2),
        lambda: ring(laps=0),
        lambda: complete_graph(samples=0),
    ],
)
def test_sizes_below_the_least_are_refused(call):
    with pytest.raises(OptionError, match="give"):
        call()


@pytest.mark.parametrize("seed", range(3))
def test_smallest_logs_exist(seed):
    assert len(taxis(1, points=2, blocks=1, seed=seed)) == 2
    assert len(fleet(1, points=2, blocks=1, lines=1, seed=seed)) == 2
    assert len(shuttles(1, lines=1, days=1, blocks=1, period=9999.0, seed=seed)) == 6
    assert len(person(1, blocks=3, seed=seed)) >= 1
    assert len(quadrotor(2, waypoints=3, seed=seed)) == 2
    assert len(ring(3, laps=1)) == 4
