"""What a trip is: one answer of all that tell trips."""

import numpy as np

import gpszip
from gpszip.history.stays.find import trips_of_archive
from gpszip.history.stays.values import Settings
from gpszip.history.traversals import read_history
from gpszip.history.trips import cut_trips, trips_of_history
from gpszip.testing import patrol
from guard_log import guard_archive, guard_findings, guard_track


def test_all_tell_the_same_trips():
    found = trips_of_archive(guard_archive(), Settings(), None)
    spans = [(trip.start, trip.end) for trip in found.trips]
    assert len(spans) > 10
    assert trips_of_history(read_history(guard_archive())).times.tolist() == list(map(list, spans))
    assert [(trip.start, trip.end) for trip in guard_findings().unusual.unusual.trips] == spans

    # Those of the log, which has more positions than the archive.
    log = [(trip.start, trip.end) for trip in gpszip.trips(guard_track()).trips]
    odd = gpszip.unusual(guard_track(), guard_archive()).trips
    assert [(trip.start, trip.end) for trip in odd] == log
    np.testing.assert_allclose(log, spans, atol=60)


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
    assert trips.of.tolist() == cut_trips(history.traversals).of.tolist()
    assert (trips.of >= 0).all()
