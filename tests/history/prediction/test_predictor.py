"""What follows a route: against plain twins, and against what generated buses did."""

import datetime
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gpszip
from gpszip.errors import OptionError
from gpszip.history.prediction.contexts import ORDERS, context_keys, label_keys, route_keys
from gpszip.history.prediction.counting import (
    count_all,
    count_before,
    group_contexts,
    kinds_of_counts,
)
from gpszip.history.prediction.predictor import Predictor
from gpszip.history.prediction.sequence_model import Passes, train
from gpszip.history.prediction.softmax import Feature, fit_weights, mix, softmax
from gpszip.history.traversals import History
from gpszip.testing import LogWithTruth, shuttles
from oracle import sequence_model as twin
from oracle.histories import back_off, count_followers, exits_of, routes_of, true_history

#: Days of which the buses' history is known; the day after is asked about.
KNOWN = 2


@pytest.fixture(scope="module")
def buses() -> LogWithTruth:
    return shuttles(5, lines=5, days=KNOWN + 1, blocks=8, period=600.0, seed=3)


@pytest.fixture(scope="module")
def known(buses: LogWithTruth) -> History:
    """All but the last day."""
    return true_history(buses, until=buses.tracks[0].times[0] - 7 * 3600 + KNOWN * 86_400)


@pytest.fixture(scope="module")
def asked(buses: LogWithTruth, known: History) -> list:
    """Routes of the last day: agent, edges, times."""
    end = known.traversals.enter.max() + 3600
    return [each for each in routes_of(true_history(buses).traversals) if each[2][0] > end]


@pytest.fixture(scope="module")
def predictor(known: History) -> Predictor:
    return Predictor(known)


def decisions(routes, exits):
    """Places of routes with two ways on besides the way back: agent, time, route so far, next."""
    for agent, edges, times in routes:
        for i in range(1, len(edges)):
            if len(exits[edges[i - 1]]) > 2:
                yield agent, times[i], edges[:i], edges[i]


def scores(probabilities, taken):
    """Share of decisions of which the likeliest exit was taken, and mean bits."""
    top = [
        max(p, key=p.get) == exit_taken for p, exit_taken in zip(probabilities, taken, strict=True)
    ]
    bits = [-math.log2(p[exit_taken]) for p, exit_taken in zip(probabilities, taken, strict=True)]
    return np.mean(top), np.mean(bits)


def test_mixture_beats_every_order_alone(known, asked, predictor):
    exits = exits_of(known.network)
    counts = count_followers([edges for _, edges, _ in routes_of(known.traversals)], range(1, 9))
    cases = list(decisions(asked, exits))[::3]
    taken = [each[-1] for each in cases]
    mixed = [
        {road[:2]: road.probability for road in predictor.next(so_far, time, agent)}
        for agent, time, so_far, _ in cases
    ]
    top, bits = scores(mixed, taken)
    assert len(cases) > 1_000
    for order in (1, 2, 8):
        alone = [back_off(counts, so_far, exits, order) for _, _, so_far, _ in cases]
        top_alone, bits_alone = scores(alone, taken)
        assert top > top_alone
        assert bits < 0.9 * bits_alone

    # Of those said with a probability, so many happen.
    best = np.array([max(p.values()) for p in mixed])
    right = np.array([max(p, key=p.get) == t for p, t in zip(mixed, taken, strict=True)])
    for low, high in ((0.5, 0.95), (0.95, 1.0)):
        band = (best >= low) & (best < high)
        assert band.sum() > 50
        # Three standard errors and what a new day differs from the days before.
        error = 3 * right[band].std() / math.sqrt(band.sum())
        assert abs(right[band].mean() - best[band].mean()) < 0.03 + error


def test_model_is_the_plain_twin(known, predictor):
    model, exits = predictor.model, predictor.exits
    routes = [
        [2 * edge + (not forward) for edge, forward in edges]
        for _, edges, _ in routes_of(known.traversals)
    ]
    counts = count_followers(routes, ORDERS)
    rng = np.random.default_rng(1)
    for route in routes:
        for end in rng.integers(1, min(len(route), 200), 12).tolist():
            # What was travelled, and the same with another beginning.
            for so_far in (route[:end], [*route[5 : end + 5], *route[:end]]):
                options = model.options[so_far[-1]]
                cosines = exits.cosines[so_far[-1], : len(options)].tolist()
                expected = twin.predict(
                    model._weights, ORDERS, (1, 2, 4), counts, cosines, so_far, options
                )
                assert model.predict(so_far) == pytest.approx(expected, rel=1e-9)


def test_learning_counts_what_training_counts(known, predictor):
    # Two routes of 300 edges, the second of which is learned.
    rows = known.traversals
    hours = (rows.enter // 3600 % 24).astype(np.int64)
    first, second = np.flatnonzero(rows.starts)[[0, 3]].tolist()
    one, other = np.arange(first, first + 300), np.arange(second, second + 300)

    def passes(chosen):
        columns = (rows.directed, rows.starts, hours, rows.track.astype(np.int64))
        return Passes(*(column[chosen] for column in columns))

    learned = train(predictor.exits, passes(one))
    trained = train(predictor.exits, passes(np.append(one, other)))
    learned.learn(rows.directed[other].tolist(), hours[other].tolist(), int(rows.track[second]))
    assert len(learned) == len(trained)
    for key, row in trained._rows.items():
        assert np.array_equal(learned._counts[learned._rows[key]], trained._counts[row])


def test_a_turn_that_was_learned_is_expected(known, asked):
    # Somebody takes a way that nobody took, and again.
    small = known.traversals.take(np.arange(len(known.traversals)) < 400)
    predictor = Predictor(History(known.network, small))
    before, rarest = predictor.next(asked[0][1][:1])[0], predictor.next(asked[0][1][:1])[-1]
    for _ in range(30):
        predictor.learn([asked[0][1][0], rarest[:2]], [1.7e9, 1.7e9 + 9], "somebody")
    after = predictor.next(asked[0][1][:1], 1.7e9, "somebody")[0]
    assert after[:2] == rarest[:2] != before[:2]


def test_exits_are_those_of_the_network(known, predictor):
    for (edge, forward), options in exits_of(known.network).items():
        told = predictor.next([(edge, forward)])
        assert sorted(road[:2] for road in told) == sorted(options)
        assert sum(road.probability for road in told) == pytest.approx(1)
        assert [road.probability for road in told] == sorted(
            (road.probability for road in told), reverse=True
        )


def test_where_nobody_went_straight_on_is_likelier_than_back():
    # A cross whose arms 0 and 1 lie in one line, and 2 and 3 across; only 2 to 3 was travelled.
    nodes = np.array([[-50.0, 0], [50, 0], [0, -50], [0, 50], [0, 0]])
    edges = np.array([[0, 4], [4, 1], [2, 4], [4, 3]])
    track = gpszip.Track("a", range(11), [[0, 10.0 * t - 50] for t in range(11)])
    walk = gpszip.Walk(
        "a", np.array([2, 4, 3], np.int32), np.array([0.0, 5, 10]), np.zeros(2, bool)
    )
    from gpszip.testing.log_with_truth import join_truth

    log = join_truth([track], [track.positions], nodes, edges, [walk])
    number = {tuple(sorted(pair)): i for i, pair in enumerate(log.road_map.edges.tolist())}
    told = Predictor(true_history(log)).next(
        [(number[0, 4], log.road_map.edges[number[0, 4]][0] == 0)]
    )
    assert told[0].edge == number[1, 4]
    assert told[-1].edge == number[0, 4]


def test_routes_are_the_likeliest_of_all(predictor, asked):
    agent, edges, times = asked[0]
    so_far = edges[:30]
    p = {(): 1.0}
    for _ in range(3):
        p = {
            (*route, road[:2]): probability * road.probability
            for route, probability in p.items()
            for road in predictor.next([*so_far, *route], times[30], agent)
        }
    best = sorted(p.items(), key=lambda item: -item[1])[:4]
    told = predictor.routes(so_far, 3, times[30], agent, count=4)
    assert [each.edges for each in told] == [route for route, _ in best]
    assert [each.probability for each in told] == pytest.approx([q for _, q in best])


def test_next_edges_are_right_more_often_than_chosen_one_by_one_by_angle(predictor, asked, known):
    exits = exits_of(known.network)
    right = []
    for agent, edges, times in asked:
        for i in range(20, len(edges) - 5, 40):
            (best,) = predictor.routes(edges[:i], 5, times[i], agent, count=1)
            assert len(best.edges) == 5
            for one, other in itertools.pairwise([edges[i - 1], *best.edges]):
                assert other in exits[one]
            right.append(best.edges == tuple(edges[i : i + 5]))
    assert np.mean(right) > 0.75


def test_unknown_edges_and_empty_routes_are_errors(predictor):
    edges = len(predictor.network)
    with pytest.raises(OptionError, match=f"edge 1 of the route is {edges}; the archive has"):
        predictor.next([(0, True), (edges, False)])
    with pytest.raises(OptionError, match="edge 0 of the route is -1"):
        predictor.next([(-1, True)])
    with pytest.raises(OptionError, match="the route is empty"):
        predictor.next([])
    with pytest.raises(OptionError, match="give pairs of an edge"):
        predictor.next([7])
    with pytest.raises(OptionError, match="m is 0"):
        predictor.routes([(0, True)], 0)
    with pytest.raises(OptionError, match="2 edges and 1 times"):
        predictor.learn([(0, True), (0, False)], [1.0])


def test_what_comes_before_a_break_is_forgotten(predictor, asked):
    _, edges, _ = asked[0]
    elsewhere = next(
        each
        for each in exits_of(predictor.network)
        if edges[10] not in exits_of(predictor.network)[each]
    )
    assert predictor.next([elsewhere, *edges[10:20]]) == predictor.next(edges[10:20])


def test_names_of_unknown_agents_say_nothing(predictor, asked):
    _, edges, _ = asked[0]
    assert predictor.next(edges[:20], agent="nobody") == predictor.next(edges[:20])


def test_a_time_that_is_not_known_says_nothing(predictor, asked):
    _, edges, _ = asked[0]
    assert predictor.next(edges[:20], math.nan) == predictor.next(edges[:20])
    rest = edges[20:25]
    without = predictor.arrival(edges[:20], rest)
    assert predictor.arrival(edges[:20], rest, math.nan) == without
    now = asked[0][2][20]
    unknown = [math.nan] * 20
    assert predictor.arrival(edges[:20], rest, now, times=unknown) == predictor.arrival(
        edges[:20], rest, now
    )


@given(st.lists(st.integers(0, 5), min_size=1, max_size=30), st.data())
def test_keys_of_routes_are_those_of_batches(route, data):
    starts = np.array(data.draw(st.lists(st.booleans(), min_size=len(route), max_size=len(route))))
    edges = np.array(route, np.int64)
    starts[0] = True
    begin = np.flatnonzero(starts)[-1]
    batch = [
        (order, int(keys[-1])) for order, keys, whole in context_keys(edges, starts) if whole[-1]
    ]
    assert batch == list(route_keys(label_keys(edges[begin:], 0).tolist()))


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(-1, 2)), max_size=40))
def test_counts_are_those_of_a_loop(pairs):
    keys = np.array([key for key, _ in pairs], np.uint64)
    chosen = np.array([taken for _, taken in pairs], np.int64)
    groups = group_contexts(keys, keys != 3)  # moments of key 3 have no context
    before = count_before(groups, chosen, 3, np.arange(len(pairs)))
    table = {key: [0, 0, 0] for key in range(4)}
    for i, (key, taken) in enumerate(pairs):
        assert before[i].tolist() == table[key]
        if key != 3 and taken >= 0:
            table[key][taken] += 1
    total = count_all(groups, chosen, 3)
    assert total.tolist() == [table[key] for key in groups.keys.tolist()]
    assert kinds_of_counts(total).tolist() == [twin.kind_of(table[k]) for k in groups.keys.tolist()]


def test_fitted_weights_are_a_maximum():
    rng = np.random.default_rng(5)
    exists = rng.random((400, 3)) < 0.8
    exists[:, 0] = True
    kind = rng.integers(0, 2, 400)
    features = [
        Feature(rng.normal(size=(400, 3)), kind, 2, 0.3),
        Feature(rng.normal(size=(400, 3)), np.zeros(400, np.int64), 1, -0.2),
    ]
    p = softmax(mix(features, np.array([1.0, -2.0, 0.5])), exists)
    chosen = np.array([rng.choice(3, p=row) for row in p])
    begin = np.array([0.3, 0.3, -0.2])

    def objective(weights):
        q = softmax(mix(features, weights), exists)
        return np.log(q[np.arange(400), chosen]).sum() - 15 * ((weights - begin) ** 2).sum()

    weights = fit_weights(features, exists, chosen)
    best = objective(weights)
    assert best > objective(begin) + 1
    for step in 0.02 * np.vstack((np.eye(3), -np.eye(3))):
        assert objective(weights + step) < best


def test_destinations_are_where_trips_ended(predictor, known, asked):
    # A round of a bus ends nowhere, but a trip ends in the evening; all known ends are told.
    told = predictor.destination(asked[0][1][:10])
    assert sum(each.probability for each in told) == pytest.approx(1)
    rows = known.traversals
    last = np.append(np.flatnonzero(rows.starts)[1:], len(rows)) - 1
    heads = np.where(
        rows.forward[last],
        known.network.ends[rows.edge[last]],
        known.network.starts[rows.edge[last]],
    )
    assert {each.node for each in told} == set(heads.tolist())


def test_destination_follows_from_the_way_travelled():
    # Trips from the west go north from the middle, and trips from the south go east.
    nodes = np.array([[-100.0, 0], [0, -100], [0, 0], [0, 100], [100, 0]])
    edges = np.array([[0, 2], [1, 2], [2, 3], [2, 4]])
    from gpszip.testing.log_with_truth import join_truth

    walks = [
        gpszip.Walk(f"{i}", np.array(path, np.int32), np.array([0.0, 9, 18]), np.zeros(2, bool))
        for i, path in enumerate([[0, 2, 3], [1, 2, 4]] * 6)
    ]
    tracks = [gpszip.Track(f"{i}", [0, 18], [[0, 0], [1, 1]]) for i in range(12)]
    log = join_truth(tracks, [track.positions for track in tracks], nodes, edges, walks)
    predictor = Predictor(true_history(log))
    for path, _, end in ([0, 2, 3], [1, 2, 4]) and ((0, 2, 3), (1, 2, 4)):
        pair = sorted((path, 2))
        edge = log.road_map.edges.tolist().index(pair)
        told = predictor.destination([(edge, pair[0] == path)])
        assert told[0].node == end
        # Six of six trips, and two in the prior, of which half ended there.
        assert told[0].probability == pytest.approx(7 / 8)


def test_hours_are_local_and_times_may_be_dates(known, asked):
    agent, route, times = asked[0]
    rows = known.traversals
    few = History(known.network, rows.take(np.arange(len(rows)) < 400))
    berlin = Predictor(few, timezone="Europe/Berlin")
    assert berlin.hours_of(np.array([1_704_099_600.0, math.nan])).tolist() == [10, -1]
    zone = datetime.timezone(datetime.timedelta(hours=1))
    same = [
        np.datetime64("2024-01-01T09:00"),
        "2024-01-01T09:00:00Z",
        datetime.datetime(2024, 1, 1, 10, tzinfo=zone),
        datetime.datetime(2024, 1, 1, 9),
        1_704_099_600,
    ]
    told = [berlin.next(route[:30], time, agent) for time in same]
    assert told == told[:1] * 5
    assert berlin.next(route[:30], np.datetime64("NaT")) == berlin.next(route[:30])
    dates = np.array(times).astype(np.int64).astype("datetime64[s]")
    assert berlin.surprise(route, dates, agent) == berlin.surprise(route, np.floor(times), agent)
    node = berlin.destination(route[:20])[0].node
    arrivals = [
        berlin.arrival(route[:20], node, when[20], agent, times=when[:20])
        for when in (np.floor(times), dates)
    ]
    assert arrivals[0] == arrivals[1]
    with pytest.raises(OptionError, match="no time zone"):
        Predictor(few, timezone="Europe/Atlantis")
    with pytest.raises(OptionError, match="single time"):
        berlin.next(route[:30], [1.0, 2.0])


def test_times_and_metres_that_are_wrong_are_refused(predictor, asked):
    agent, route, times = asked[0]
    wrong = [
        lambda: predictor.surprise(route, times[:1], agent),
        lambda: predictor.learn(route, times[:1], agent),
        lambda: predictor.arrival(route, 0, times[-1], metres_left=math.nan),
        lambda: predictor.arrival(route, 0, 1e18),
        lambda: predictor.arrival(route, 0, times=times[:1]),
    ]
    for ask in wrong:
        with pytest.raises(OptionError):
            ask()
