"""Trips of an archive, scored by what its other trips did."""

import numpy as np
import pytest

from gpszip.errors import OptionError
from gpszip.history.traversals import History
from gpszip.history.trips import _number_spans, choose_trips, cut_trips
from gpszip.history.unusual.first_look import quick_bits, rarest_parts
from gpszip.history.unusual.own_trips import _choose, score_own_trips
from guard_log import ODD_ROUND, ROUNDS, START, guard_archive, guard_findings


@pytest.fixture(scope="module")
def spans():
    return [(trip.track, trip.start, trip.end) for trip in guard_findings().trips.trips]


def test_the_trip_that_goes_another_way_is_the_most_unusual(spans):
    own = guard_findings().unusual
    first, second, *_ = own.unusual.ranked
    assert (first.start, first.end) == spans[ODD_ROUND][1:]
    assert first.score > second.score + 5
    assert first.anomalies
    assert "rare turn" in first.reason
    assert (len(own.unusual), own.left_out, own.usual) == (ROUNDS, 0, 0)


def test_where_all_go_one_way_the_next_edge_is_foreseen():
    foresight = guard_findings().unusual.foresight
    assert foresight.decisions > ROUNDS
    assert 0.9 < foresight.right < 1.0
    assert 0.0 < foresight.bits < 1.0


def test_trips_since_a_time_are_scored_by_those_before(spans):
    history = guard_findings().history
    since = spans[ODD_ROUND - 1][1] - 100.0
    own = score_own_trips(history, since, choose_trips(history.traversals, guard_findings().trips))
    assert len(own.unusual) == ROUNDS - ODD_ROUND + 1
    assert own.left_out == ODD_ROUND - 1
    assert own.unusual.ranked[0].start == spans[ODD_ROUND][1]


def test_without_spans_trips_end_with_long_stops():
    """An agent stands on the edge at the station, which is the last one of its trip."""
    history = guard_findings().history
    rows = history.traversals
    own = score_own_trips(history, trips=cut_trips(rows))
    assert len(own.unusual) == 1 + int((rows.standing[:-1] >= 300).sum())
    ends = [trip.end for trip in own.unusual.trips]
    assert ends == rows.leave[[*np.flatnonzero(rows.standing[:-1] >= 300), len(rows) - 1]].tolist()


def test_a_traversal_belongs_to_the_last_span_that_has_some_of_its_time():
    rows = guard_findings().history.traversals
    (name,) = guard_archive().ids
    random = np.random.default_rng(2)
    edges = np.sort(random.uniform(rows.enter.min(), rows.leave.max(), 14)).reshape(-1, 2)
    spans = [(name, *edge) for edge in random.permutation(edges).tolist()]
    spans += [("another", START, START + 1e6)]

    # A plain search.
    expected = []
    for enter, leave in zip(rows.enter, rows.leave, strict=True):
        own = [
            (start, i)
            for i, (track, start, end) in enumerate(spans)
            if track == name and start < leave and enter < end
        ]
        last = max(
            (
                (start, i)
                for i, (track, start, _) in enumerate(spans)
                if track == name and start < leave
            ),
            default=(0, -1),
        )
        expected.append(last[1] if last in own else -1)
    assert _number_spans(rows, spans).tolist() == expected
    assert -1 in expected


def test_too_few_trips_and_tracks_without_times_are_refused(spans):
    network, rows = guard_findings().history.network, guard_findings().history.traversals
    with pytest.raises(OptionError, match="too few trips"):
        score_own_trips(History(network, rows), spans[-2][1])
    with pytest.raises(OptionError, match="no track has times"):
        score_own_trips(History(network, rows.take(np.zeros(len(rows), bool))))


def test_of_many_trips_the_rarest_that_fit_in_are_scored():
    rarest = np.array([2.0, 3.0, -1.0, 5.0])
    assert _choose(np.array([4, 50, 1, 5]), rarest, 10).tolist() == [True, False, False, True]
    # One is scored, however long it is.
    assert _choose(np.array([40, 50, 30, 60]), rarest, 10).tolist() == [False, False, False, True]


def test_the_odd_trip_is_the_rarest_at_a_first_look():
    history = guard_findings().history
    trips = choose_trips(history.traversals, guard_findings().trips)
    rows = history.traversals.take(trips.of >= 0)
    of = trips.of[trips.of >= 0]
    first = np.flatnonzero(np.diff(of, prepend=-1))
    bits = quick_bits(rows, of != ODD_ROUND)
    assert rarest_parts(bits, first).argmax() == ODD_ROUND

    # A plain count of what followed the last edges.
    directed, starts = rows.directed.tolist(), rows.starts.tolist()
    for i in range(len(rows)):
        chance = 0.2
        for order in (1, 2, 4, 8):
            if starts[i] or any(starts[i - order + 1 : i]) or i < order:
                break
            context = directed[i - order : i]
            seen = [
                j
                for j in range(order, len(rows))
                if directed[j - order : j] == context
                and not any(starts[j - order + 1 : j + 1])
                and ODD_ROUND not in (of[j - 1], of[j])
            ]
            same = sum(directed[j] == directed[i] for j in seen)
            chance = (same + chance) / (len(seen) + 1)
        assert bits[i] == pytest.approx(0.0 if starts[i] else -np.log2(chance))
