"""All that a history tells, or why it doesn't."""

import numpy as np
import pytest

import gpszip
from gpszip.errors import OptionError
from gpszip.pipeline.findings import PARTS, find_all
from guard_log import START, guard_archive, guard_findings, guard_track


@pytest.fixture(scope="module")
def shape():
    """A track without times."""
    line = np.column_stack([np.arange(20.0) * 10, np.zeros(20)])
    track = gpszip.Track("shape", np.arange(20.0) * 10, line, timed=False)
    return gpszip.compress(track, rmse=1.0, effort=1, times=False)


def test_all_parts_are_those_of_the_functions():
    found, archive = guard_findings(), guard_archive()
    assert found.notes == {}
    trips = gpszip.trips(archive, timezone="Europe/Berlin")
    assert [trip.start for trip in found.trips.trips] == [trip.start for trip in trips.trips]
    used = gpszip.usage(archive, timezone="Europe/Berlin")
    for name in ("edge", "hour", "weekday", "traversals"):
        np.testing.assert_array_equal(found.usage[name], used[name])
    rounds = gpszip.rounds(archive)
    assert found.rounds.rounds == rounds.rounds
    assert found.calendar.name == "Europe/Berlin"

    # Changes are sought in the last quarter of all travel, at the rate of gpszip.changes.
    enter = found.history.traversals.enter
    assert (enter < found.since).sum() == int(0.75 * len(enter))
    assert found.changes.false_alarms == 0.1


def test_only_what_is_asked_for_is_found():
    found = find_all(guard_archive(), ["usage"])
    assert found.usage is not None
    assert found.trips is found.changes is found.unusual is found.rounds is None
    assert (found.parts, found.notes) == (("usage",), {})


def test_what_cant_be_told_has_a_reason(shape):
    found = find_all(shape)
    assert set(found.notes) == {"trips", "changes", "unusual", "rounds"}
    assert found.notes["trips"] == "no track has times, so there are no stays and trips"
    assert "no track has times" in found.notes["unusual"]
    assert found.usage["traversals"].tolist() == [1]


def test_a_track_that_stands_still_has_a_stay_and_no_edges():
    times = START + np.arange(60.0) * 30
    still = gpszip.compress(gpszip.Track("still", times, np.zeros((60, 2))), rmse=1.0, effort=1)
    found = find_all(still)
    assert found.history is None
    assert len(found.trips.stays) == 1
    assert found.notes == dict.fromkeys(PARTS[1:], "nothing moves in it")


def test_a_round_that_tells_little_of_all_travel_is_none():
    """A walk to and fro over a cross: any of its arms would do as a base."""
    random = np.random.default_rng(4)
    arms = np.array([[90, 0], [0, 90], [-90, 0], [0, -90]], float)
    places = np.zeros((81, 2))
    places[1::2] = arms[random.integers(0, 4, 40)]
    cross = gpszip.compress(gpszip.Track("cross", np.arange(81) * 60.0, places), rmse=1.0, effort=1)
    assert find_all(cross, ["rounds"]).notes == {"rounds": "travel doesn't repeat in rounds"}


def test_the_log_tells_trips_if_it_is_at_hand():
    """A log that is wrong by a kilometre, as it says itself, has no trips; its archive has."""
    track = guard_track()
    attributes = {"accuracy": np.full(len(track), 90.0)}
    vague = gpszip.Track(
        track.id, track.times, track.positions, plane=track.plane, attributes=attributes
    )
    seen = find_all(guard_archive(), ["trips"], tracks=[vague]).trips
    expected = gpszip.trips(vague)
    assert [trip.start for trip in seen.trips] == [trip.start for trip in expected.trips]
    assert len(seen.trips) != len(guard_findings().trips.trips)
    other = find_all(guard_archive(), ["trips"], tracks=[gpszip.Track("b", [0.0], [[0.0, 0.0]])])
    assert len(other.trips.trips) == len(guard_findings().trips.trips)


def test_wrong_questions_are_refused(shape):
    with pytest.raises(OptionError, match="'speed' is no part of a history"):
        find_all(shape, ["speed"])
    with pytest.raises(OptionError, match="since lies outside"):
        find_all(guard_archive(), since=START - 10)
    with pytest.raises(OptionError, match="since lies outside"):
        find_all(shape, since=5.0)
    with pytest.raises(OptionError, match="no time zone 'Nowhere'"):
        find_all(guard_archive(), timezone="Nowhere")


def test_two_samples_are_too_little_to_compare_times():
    track = gpszip.Track("two", [0.0, 60.0], [[0.0, 0.0], [300.0, 0.0]])
    found = find_all(gpszip.compress(track, rmse=1.0, effort=1), ["changes"])
    assert found.notes == {"changes": "there is too little travel to compare times"}
