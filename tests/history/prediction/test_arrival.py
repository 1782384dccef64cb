"""When buses arrive: errors and bands on the day after, and ways against plain twins."""

import itertools

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.history.prediction.exits import list_exits
from gpszip.history.prediction.paths import PathSearch, connect_roads, fastest_path
from gpszip.history.prediction.predictor import Predictor
from gpszip.history.traversals import History
from gpszip.model import Track
from gpszip.testing import shuttles
from oracle.histories import exits_of, routes_of, true_history

FIRST_DAY, KNOWN = 1_704_067_200.0, 2


@pytest.fixture(scope="module")
def buses() -> History:
    return true_history(shuttles(4, lines=4, days=KNOWN + 1, blocks=6, period=600.0, seed=3))


@pytest.fixture(scope="module")
def predictor(buses: History) -> Predictor:
    rows = buses.traversals
    return Predictor(History(buses.network, rows.take(rows.enter < FIRST_DAY + KNOWN * 86_400)))


@pytest.fixture(scope="module")
def drives(buses: History) -> list:
    """Moments of the last day: agent, route so far with its times, what follows, its seconds."""
    cases = []
    for agent, edges, times in routes_of(buses.traversals):
        if times[0] >= FIRST_DAY + KNOWN * 86_400:
            cases += [
                (agent, edges[i - 20 : i], times[i - 20 : i + 1], edges[i : i + 15], times[i + 15])
                for i in range(20, len(edges) - 16, 12)
            ]
    return cases


def test_arrivals_are_near_the_truth_and_in_their_band(predictor, drives):
    errors, inside = {False: [], True: []}, []
    for agent, so_far, times, rest, end in drives:
        took = end - times[-1]
        for knows_pace in (False, True):
            told = predictor.arrival(
                so_far, rest, times[-1], agent, times=times[:-1] if knows_pace else None
            )
            errors[knows_pace].append(abs(told.seconds - took) / took)
        inside.append(told.low <= took <= told.high)
        assert told.low < told.seconds < told.high
        assert told.route == tuple(rest)
    # Paces of duties vary by 8 %, dwell at stops by 12 s.
    assert len(drives) > 200
    assert np.mean(errors[True]) < 0.075
    assert np.mean(errors[True]) < 0.9 * np.mean(errors[False])
    assert 0.7 < np.mean(inside) < 0.93


def test_the_way_to_a_node_ends_there(predictor, drives):
    network, exits = predictor.network, exits_of(predictor.network)
    for agent, so_far, times, rest, _ in drives[::20]:
        edge, forward = rest[4]
        goal = int(network.ends[edge] if forward else network.starts[edge])
        told = predictor.arrival(so_far, goal, times[-1], agent)
        for one, other in itertools.pairwise([so_far[-1], *told.route]):
            assert other in exits[one]
        if told.route:
            last, forward = told.route[-1]
            assert goal == (network.ends[last] if forward else network.starts[last])
        assert told.metres == pytest.approx(sum(network.lengths[each] for each, _ in told.route))


def test_the_path_to_a_goal_is_the_same_after_a_search_for_others(predictor, drives):
    _, so_far, *_ = drives[0]
    route = [2 * edge + (not forward) for edge, forward in so_far]
    shared = PathSearch(predictor.model, predictor.exits, route)
    paths = []
    for goal in range(0, len(predictor.network.nodes), 5):
        alone = PathSearch(predictor.model, predictor.exits, route)
        paths.append(shared.path_to(goal))
        assert paths[-1] == alone.path_to(goal)
    assert len([path for path in paths if path]) > 3


def test_an_agent_that_is_there_has_arrived(predictor):
    edge, forward = 0, True
    goal = int(predictor.network.ends[edge])
    told = predictor.arrival([(edge, forward)], goal)
    assert (told.seconds, told.low, told.high, told.metres, told.route) == (0, 0, 0, 0, ())


def test_impossible_goals_are_errors(predictor):
    nodes = len(predictor.network.nodes)
    with pytest.raises(OptionError, match=f"no node {nodes}; the archive has nodes 0 to"):
        predictor.arrival([(0, True)], nodes)
    exits = exits_of(predictor.network)
    for far in [each for each in exits if each not in exits[0, True]][:5]:
        with pytest.raises(OptionError, match="does not begin where the other one ends"):
            predictor.arrival([(0, True)], [far])
    with pytest.raises(OptionError, match="1 edges and 2 times"):
        predictor.arrival([(0, True)], [exits[0, True][0]], 9.0, times=[1.0, 2.0])


def test_fastest_paths_are_the_best_of_all(predictor):
    # All ways of up to six edges from an edge.
    exits = list_exits(predictor.network)
    seconds = np.random.default_rng(1).uniform(5, 50, len(exits))
    best = {int(exits.heads[0]): 0.0}
    ways = [(0, 0.0)]
    for _ in range(6):
        ways = [
            (each, cost + seconds[each])
            for last, cost in ways
            for each in exits.options[last].tolist()
            if each >= 0
        ]
        for last, cost in ways:
            node = int(exits.heads[last])
            best[node] = min(best.get(node, np.inf), cost)
    for goal, cost in best.items():
        way = fastest_path(exits, seconds, 0, goal)
        assert len(way) > 6 or sum(seconds[way]) == pytest.approx(cost)
        assert sum(seconds[way]) <= cost + 1e-9
    assert fastest_path(exits, seconds, 0, len(predictor.network.nodes)) is None


def test_roads_between_samples_are_filled_in(predictor, buses):
    rows = buses.traversals
    exits = list_exits(predictor.network)
    options = [set(row.tolist()) for row in exits.options]
    for first in range(0, 3000, 150):
        if rows.starts[first + 1 : first + 30].any():
            continue
        seen = rows.directed[first : first + 30 : 3].tolist()
        route = connect_roads(seen, exits, predictor.network.lengths)
        assert all(other in options[one] for one, other in itertools.pairwise(route))
        assert route[-1] == seen[-1]


def test_live_matcher_predicts_what_the_archive_knows():
    # Rounds of a figure eight: at its middle, the next loop depends on the last one.
    corners = np.array(
        [[0, 0], [80, 60], [160, 0], [80, -60], [0, 0], [-80, 60], [-160, 0], [-80, -60], [0, 0]]
    )

    line = np.concatenate([corners if i == 0 else corners[1:] for i in range(12)]).astype(float)
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    times = np.arange(0, along[-1], 5.0)
    eight = np.stack([np.interp(times, along, axis) for axis in line.T], axis=1)
    archive = gpszip.compress([Track("a", times / 10, eight)], max_error=2.0, effort=1)
    predictor = Predictor(archive)
    matcher = gpszip.Matcher(archive, predictor=predictor, agent="a")
    right = total = 0
    last = None
    for time, position in zip(times[:400] / 10, eight[:400], strict=True):
        here = matcher.push(time, position)
        assert sum(road.probability for road in here.next) == pytest.approx(1)
        if last is not None and (here.edge, here.forward) != last[:2] and time > 60:
            total += 1
            right += (here.edge, here.forward) == last[2][:2]
        last = (here.edge, here.forward, here.next[0])
    assert total >= 5
    assert right >= 0.8 * total


def test_a_predictor_of_another_map_is_refused(predictor):
    ring = gpszip.testing.ring(5)
    scales = gpszip.match(ring.tracks, ring.network).scales
    with pytest.raises(OptionError, match="give the archive of the predictor"):
        gpszip.Matcher(ring.network, scales, predictor=predictor)
