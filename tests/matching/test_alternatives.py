import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpszip.matching.alternatives import PathFinder, RoadPath, RoadPosition, TravelCosts
from gpszip.model import Network
from oracle.ways import cheapest


def network_of(nodes, roads, one_way=()):
    nodes = np.array(nodes, float)
    starts, ends = np.array(roads, np.int32).T
    points = nodes[np.array(roads).ravel()]
    backward = np.array([i not in one_way for i in range(len(roads))])
    return Network(
        nodes,
        starts,
        ends,
        np.arange(0, 2 * len(roads) + 1, 2),
        points,
        np.ones(len(roads), bool),
        backward,
        np.full(len(roads), np.nan),
    )


SQUARE = network_of(
    [(0, 0), (100, 0), (100, 100), (0, 100), (200, 0)], [(0, 1), (1, 2), (2, 3), (3, 0), (1, 4)]
)


def prices_of(network, turn=2.0, u_turn=20.0):
    return TravelCosts(np.repeat(network.lengths, 2) / 10.0, turn, u_turn)


def find(network, start, end, **options):
    finder = PathFinder(network)
    return finder, finder.find_paths(
        [start], [end], prices_of(network), **{"slack": 60.0, "max_paths": 20} | options
    )


def test_both_ways_round_a_square():
    finder, ways = find(SQUARE, RoadPosition(0, 50.0), RoadPosition(4, 50.0))
    assert ways[0].roads.tolist() == [0, 2, 4]
    assert ways[0].cost == pytest.approx(20 + 2)
    line, owner = finder.line(ways[0])
    np.testing.assert_allclose(
        line, [[50, 0], [100, 0], [100, 0], [100, 100], [100, 100], [50, 100]]
    )
    assert owner.tolist() == [0, 0, 1, 1, 2, 2]
    assert [7, 5] in [way.roads.tolist()[1:] for way in ways]
    assert all(one.cost <= other.cost for one, other in zip(ways, ways[1:], strict=False))


def test_one_road_forwards_and_backwards():
    assert [way.cost for way in find(SQUARE, RoadPosition(0, 20.0), RoadPosition(0, 70.0))[1]][
        :1
    ] == [pytest.approx(5.0)]
    assert find(SQUARE, RoadPosition(0, 70.0), RoadPosition(1, 20.0))[1][0].cost == pytest.approx(
        5.0 + 20.0
    )
    closed = network_of([(0, 0), (100, 0)], [(0, 1)], one_way=(0,))
    assert find(closed, RoadPosition(0, 70.0), RoadPosition(0, 20.0))[1] == []


def test_one_way_roads_are_gone_round():
    network = network_of(
        [(0, 0), (100, 0), (100, 100), (0, 100)],
        [(0, 1), (1, 2), (2, 3), (3, 0)],
        one_way=(0, 1, 2, 3),
    )
    ways = find(network, RoadPosition(2, 50.0), RoadPosition(0, 50.0))[1]
    assert [way.roads.tolist() for way in ways] == [[2, 4, 6, 0]]


def test_no_way_between_parts_that_do_not_touch():
    network = network_of([(0, 0), (100, 0), (500, 0), (600, 0)], [(0, 1), (2, 3)])
    assert find(network, RoadPosition(0, 50.0), RoadPosition(2, 50.0))[1] == []


def test_places_that_are_in_doubt_are_begun_from_where_it_pays():
    network = network_of([(0, 0), (100, 0), (500, 0), (600, 0)], [(0, 1), (2, 3)])
    finder = PathFinder(network)
    ways = finder.find_paths(
        [RoadPosition(0, 50.0), RoadPosition(2, 10.0, 30.0)],
        [RoadPosition(2, 60.0)],
        prices_of(network),
        slack=10.0,
        max_paths=5,
    )
    assert [(way.roads.tolist(), way.begin, way.penalty) for way in ways] == [([2], 10.0, 30.0)]
    assert ways[0].cost == pytest.approx(5.0)


def test_a_way_backwards_is_drawn_backwards():
    line, _ = PathFinder(SQUARE).line(RoadPath(np.array([3, 1], np.int32), 80.0, 30.0, 0.0))
    np.testing.assert_allclose(line, [[100, 80], [100, 0], [100, 0], [30, 0]])


@st.composite
def small_networks(draw):
    nodes = draw(
        st.lists(
            st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=3, max_size=5, unique=True
        )
    )
    pairs = [(a, b) for a in range(len(nodes)) for b in range(a + 1, len(nodes))]
    roads = draw(st.lists(st.sampled_from(pairs), min_size=2, max_size=6, unique=True))
    one_way = draw(st.sets(st.integers(0, len(roads) - 1)))
    return network_of(np.array(nodes) * 100.0, roads, one_way)


@settings(max_examples=60)
@given(small_networks(), st.data())
def test_the_cheapest_way_is_the_cheapest_of_all(network, data):
    roads = [
        2 * road + back
        for road in range(len(network))
        for back in (0, 1)
        if (network.backward if back else network.forward)[road]
    ]
    places = [
        (data.draw(st.sampled_from(roads)), data.draw(st.sampled_from([0.25, 0.5, 0.75])))
        for _ in range(2)
    ]
    start, end = [(road, share * float(network.lengths[road >> 1])) for road, share in places]
    if start[0] >> 1 == end[0] >> 1:
        return
    prices = prices_of(network)
    expected = cheapest(network, prices.roads, start, end, prices.turn_cost, prices.u_turn_cost)
    found = find(network, RoadPosition(*start), RoadPosition(*end), slack=1000.0)[1]
    if not np.isfinite(expected):
        assert found == []
        return
    assert found[0].cost == pytest.approx(expected)
    heads = np.stack((network.starts, network.ends), axis=1)
    for way in found:
        ends = [heads[road >> 1][:: -1 if road % 2 else 1] for road in way.roads.tolist()]
        assert all(one[1] == other[0] for one, other in zip(ends, ends[1:], strict=False))
        assert all(
            (network.backward if road % 2 else network.forward)[road >> 1]
            for road in way.roads.tolist()
        )


def test_who_must_turn_round_may_go_on_and_come_back():
    """Away from the aim, with a ring at the end of the road."""
    nodes = [(0, 0), (100, 0), (200, 0), (250, 50), (250, -50)]
    network = network_of(nodes, [(0, 1), (1, 2), (2, 4), (4, 3), (3, 2)], one_way=(2, 3, 4))
    ways = find(network, RoadPosition(0, 60.0), RoadPosition(1, 20.0))[1]
    assert ways[0].roads.tolist() == [1]
    assert ways[0].cost == pytest.approx(4 + 20)
    assert [0, 2, 4, 6, 8, 3, 1] in [way.roads.tolist() for way in ways]


def test_seconds_of_a_way_are_without_turns():
    finder, ways = find(SQUARE, RoadPosition(0, 50.0), RoadPosition(4, 50.0))
    assert [finder.travel_time(way, prices_of(SQUARE)) for way in ways[:1]] == [pytest.approx(20.0)]
    assert finder.travel_time(
        RoadPath(np.array([3, 1], np.int32), 80.0, 30.0, 0.0), prices_of(SQUARE)
    ) == pytest.approx(15.0)
    assert finder.travel_time(
        RoadPath(np.array([1], np.int32), 80.0, 30.0, 0.0), prices_of(SQUARE)
    ) == pytest.approx(5.0)
