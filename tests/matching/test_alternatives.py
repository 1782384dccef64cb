import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.matching.alternatives import PathFinder, RoadPath, RoadPosition, TravelCosts
from matching.streets import network
from oracle.ways import cheapest
from random_tests import examples


def network_of(nodes, pairs, one_way=()):
    """A network whose roads with these numbers are one-way."""
    return network(nodes, pairs, backward=[road not in one_way for road in range(len(pairs))])


SQUARE = network_of(
    [(0, 0), (100, 0), (100, 100), (0, 100), (200, 0)], [(0, 1), (1, 2), (2, 3), (3, 0), (1, 4)]
)


def costs_of(roads, turn=2.0, u_turn=20.0):
    """Costs at 10 m/s."""
    return TravelCosts(np.repeat(roads.lengths, 2) / 10.0, turn, u_turn)


def find(roads, start, end, slack=60.0):
    return PathFinder(roads).find_paths([start], [end], costs_of(roads), slack=slack, max_paths=20)


def test_both_paths_round_a_square_are_found():
    paths = find(SQUARE, RoadPosition(0, 50.0), RoadPosition(4, 50.0))
    assert paths[0].roads.tolist() == [0, 2, 4]
    assert paths[0].cost == pytest.approx(20 + 2)
    assert [7, 5] in [path.roads.tolist()[1:] for path in paths]
    costs = [path.cost for path in paths]
    assert costs == sorted(costs)

    line, owner = PathFinder(SQUARE).line(paths[0])
    np.testing.assert_allclose(
        line, [[50, 0], [100, 0], [100, 0], [100, 100], [100, 100], [50, 100]]
    )
    assert owner.tolist() == [0, 0, 1, 1, 2, 2]


def test_paths_on_one_road():
    forward = find(SQUARE, RoadPosition(0, 20.0), RoadPosition(0, 70.0))
    assert forward[0].cost == pytest.approx(5.0)
    turned = find(SQUARE, RoadPosition(0, 70.0), RoadPosition(1, 20.0))
    assert turned[0].cost == pytest.approx(5.0 + 20.0)
    one_way = network_of([(0, 0), (100, 0)], [(0, 1)], one_way=(0,))
    assert find(one_way, RoadPosition(0, 70.0), RoadPosition(0, 20.0)) == []


def test_one_way_roads_are_gone_round():
    ring = network_of(
        [(0, 0), (100, 0), (100, 100), (0, 100)],
        [(0, 1), (1, 2), (2, 3), (3, 0)],
        one_way=(0, 1, 2, 3),
    )
    paths = find(ring, RoadPosition(2, 50.0), RoadPosition(0, 50.0))
    assert [path.roads.tolist() for path in paths] == [[2, 4, 6, 0]]


def test_no_path_between_components():
    two = network_of([(0, 0), (100, 0), (500, 0), (600, 0)], [(0, 1), (2, 3)])
    assert find(two, RoadPosition(0, 50.0), RoadPosition(2, 50.0)) == []


def test_an_unlikely_start_is_used_where_it_pays():
    two = network_of([(0, 0), (100, 0), (500, 0), (600, 0)], [(0, 1), (2, 3)])
    paths = PathFinder(two).find_paths(
        [RoadPosition(0, 50.0), RoadPosition(2, 10.0, 30.0)],
        [RoadPosition(2, 60.0)],
        costs_of(two),
        slack=10.0,
        max_paths=5,
    )
    assert [(path.roads.tolist(), path.begin, path.penalty) for path in paths] == [
        ([2], 10.0, 30.0)
    ]
    assert paths[0].cost == pytest.approx(5.0)


def test_the_line_of_a_backward_path_is_backward():
    line, _ = PathFinder(SQUARE).line(RoadPath(np.array([3, 1], np.int32), 80.0, 30.0, 0.0))
    np.testing.assert_allclose(line, [[100, 80], [100, 0], [100, 0], [30, 0]])


@st.composite
def small_networks(draw):
    coordinates = st.integers(0, 3)
    nodes = draw(st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=5, unique=True))
    pairs = [(a, b) for a in range(len(nodes)) for b in range(a + 1, len(nodes))]
    roads = draw(st.lists(st.sampled_from(pairs), min_size=2, max_size=6, unique=True))
    one_way = draw(st.sets(st.integers(0, len(roads) - 1)))
    return network_of(np.array(nodes) * 100.0, roads, one_way)


@examples(60)
@given(small_networks(), st.data())
def test_the_cheapest_path_equals_the_oracle(roads, data):
    # two positions on different roads, in open directions
    is_open = np.stack((roads.forward, roads.backward), axis=1).ravel()
    open_roads = np.flatnonzero(is_open).tolist()
    start, end = [
        (road, share * float(roads.lengths[road >> 1]))
        for road, share in (
            (data.draw(st.sampled_from(open_roads)), data.draw(st.sampled_from([0.25, 0.5, 0.75])))
            for _ in range(2)
        )
    ]
    if start[0] >> 1 == end[0] >> 1:
        return

    costs = costs_of(roads)
    least = cheapest(roads, costs.roads, start, end, costs.turn_cost, costs.u_turn_cost)
    paths = find(roads, RoadPosition(*start), RoadPosition(*end), slack=1000.0)
    if not np.isfinite(least):
        assert paths == []
        return
    assert paths[0].cost == pytest.approx(least)

    # every path is connected and open
    tails = np.stack((roads.starts, roads.ends), axis=1).ravel()
    heads = np.stack((roads.ends, roads.starts), axis=1).ravel()
    for path in paths:
        assert (heads[path.roads[:-1]] == tails[path.roads[1:]]).all()
        assert is_open[path.roads].all()


def test_an_agent_that_must_turn_round_may_go_on_and_come_back():
    """Away from the destination, with a roundabout at the end of the road."""
    nodes = [(0, 0), (100, 0), (200, 0), (250, 50), (250, -50)]
    roundabout = network_of(nodes, [(0, 1), (1, 2), (2, 4), (4, 3), (3, 2)], one_way=(2, 3, 4))
    paths = find(roundabout, RoadPosition(0, 60.0), RoadPosition(1, 20.0))
    assert paths[0].roads.tolist() == [1]
    assert paths[0].cost == pytest.approx(4 + 20)
    assert [0, 2, 4, 6, 8, 3, 1] in [path.roads.tolist() for path in paths]


@pytest.mark.parametrize(
    ("roads", "begin", "end", "seconds"),
    [([0, 2, 4], 50.0, 50.0, 20.0), ([3, 1], 80.0, 30.0, 15.0), ([1], 80.0, 30.0, 5.0)],
)
def test_travel_time_is_without_turns(roads, begin, end, seconds):
    path = RoadPath(np.array(roads, np.int32), begin, end, 0.0)
    assert PathFinder(SQUARE).travel_time(path, costs_of(SQUARE)) == pytest.approx(seconds)
