"""What a trip is: one answer of all that tell trips."""

from types import SimpleNamespace

import numpy as np
import pytest

import gpszip
import gpszip.history.trips as trips_module
from gpszip.history.stays.find import trips_of_archive
from gpszip.history.stays.values import Settings, TripSpans
from gpszip.history.traversals import History, Traversals, read_history
from gpszip.history.trips import cut_trips, lead_to_places, spans_of_tracks, trips_of_history
from gpszip.testing import patrol
from guard_log import NAME, guard_archive, guard_findings, guard_track


def test_all_tell_the_same_trips():
    found = trips_of_archive(guard_archive(), Settings(), None)
    spans = [(trip.start, trip.end) for trip in found.trips]
    assert len(spans) > 10
    history = read_history(guard_archive())
    assert trips_of_history(history).times.tolist() == list(map(list, spans))
    assert lead_to_places(history)
    assert [(trip.start, trip.end) for trip in guard_findings().unusual.unusual.trips] == spans

    # Those of the log, which has more positions than the archive.
    log = [(trip.start, trip.end) for trip in gpszip.trips(guard_track()).trips]
    odd = gpszip.unusual(guard_track(), guard_archive()).trips
    assert [(trip.start, trip.end) for trip in odd] == log
    np.testing.assert_allclose(log, spans, atol=60)
    own = spans_of_tracks([guard_track()], by_places=True)
    assert [span[1:] for span in own.trips] == log
    assert own.tracks == {NAME}


def test_a_trip_has_the_traversals_that_share_its_time():
    history = read_history(guard_archive())
    rows, trips = history.traversals, trips_of_history(history)
    for trip, (start, end) in enumerate(trips.times.tolist()):
        own = slice(trips.first[trip], trips.after[trip])
        assert (rows.enter[own] < end).all()
        assert (rows.leave[own] > start).all()
    drift = trips.of < 0
    assert rows.metres[drift].sum() < 0.05 * rows.metres.sum()


def test_in_a_building_trips_end_with_stops_on_edges():
    # A robot never leaves a place of 100 m.
    archive = gpszip.compress(patrol(3000), rmse=0.5, effort=1)
    history = read_history(archive)
    trips = trips_of_history(history)
    assert not trips.by_places
    assert not lead_to_places(history)
    assert spans_of_tracks([guard_track()], by_places=False) is None
    assert trips.of.tolist() == cut_trips(history.traversals).of.tolist()
    assert (trips.of >= 0).all()


@pytest.mark.parametrize("share", [0.2, 0.8])
def test_a_sample_of_many_tracks_tells_whether_trips_lead_to_places(monkeypatch, share):
    # Of 300 tracks with a traversal each, a share has trips; 30 of them are looked at.
    monkeypatch.setattr(trips_module, "_SAMPLED", 30)
    names = tuple(f"car {i}" for i in range(300))
    one, zero = np.ones(300), np.zeros(300)
    edge, forward, yes = zero.astype(np.int64), one > 0, one > 0
    track = np.arange(300, dtype=np.int32)
    rows = Traversals(names, track, edge, forward, zero, one, zero, one, zero, yes)
    has_trip = np.random.default_rng(3).permutation(300) < 300 * share
    asked = []

    def spans(archive, ids):
        asked.extend(ids)
        found = tuple((name, 0.0, 1.0) for name in ids if has_trip[names.index(name)])
        return TripSpans(frozenset(ids), found)

    monkeypatch.setattr(trips_module, "spans_of_archive", spans)
    history = History(None, rows, SimpleNamespace(timed=True, ids=names))
    assert lead_to_places(history) == (share > 0.5)
    assert len(asked) == 30
    assert {asked[0], asked[-1]} == {names[0], names[-1]}
    assert trips_of_history(history).by_places == (share > 0.5)
