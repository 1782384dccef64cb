"""Stays, trips and places of whole logs, against planted truth."""

import math
import sys

import numpy as np
import pytest

import gpszip
import phones
from gpszip.errors import OptionError
from gpszip.history import local_time
from gpszip.testing import person


def phone_log(day, seed, stated=True, **options):
    times, positions, accuracy = phones.record(day, seed, **options)
    attributes = {"accuracy": accuracy} if stated else {}
    track = gpszip.Track("phone", times, positions, attributes=attributes)
    return track, accuracy


def spans(items):
    return [(item.start, item.end) for item in items]


@pytest.mark.parametrize(
    "options",
    [{}, {"period": 30.0, "idle": 120.0}, {"wakes": 200.0}],
    ids=["often", "less", "wakes"],
)
@pytest.mark.parametrize("travel", [phones.drive, phones.ride], ids=["drives", "rides"])
def test_trips_of_noisy_phones(travel, options):
    # trains lead farther
    far = (9000, 25_000) if travel is phones.ride else (3000, 12_000)
    found, plain = [], []
    for seed in range(8):
        day = phones.a_round_trip(travel, seed, far)
        track, accuracy = phone_log(day, seed, **options)
        found.append((spans(gpszip.trips(track).trips), day.trips))
        plain.append((phones.plain_trips(track.times, track.positions, accuracy), day.trips))
    assert phones.f1(found) >= 0.85
    assert phones.f1(found) >= phones.f1(plain) + 0.1


@pytest.mark.parametrize("stated", [True, False])
def test_a_phone_that_lies_still_has_no_trip(stated):
    for seed in range(6):
        day = phones.Day()
        day.stay(20 * 3600.0)
        poor = 0.08 if stated else 0.02
        track, _ = phone_log(day, seed, stated, period=20.0, poor=poor)
        found = gpszip.trips(track)
        assert not found.trips
        assert sum(stay.end - stay.start for stay in found.stays) > 0.95 * day.now


@pytest.fixture(scope="module")
def month():
    log = person(30, seed=3)
    (track,), (walk,) = log.tracks, log.walks
    waits = np.flatnonzero(walk.nodes[1:] == walk.nodes[:-1])
    stays = []
    for wait in waits:
        begin, end = walk.times[wait], walk.times[wait + 1]
        if stays and stays[-1][1] == begin:
            begin = stays.pop()[0]
        stays.append((begin, end, log.road_map.nodes[walk.nodes[wait]]))
    return track, stays, gpszip.trips(track)


def test_all_stays_of_a_person_that_were_seen_are_found_with_their_places(month):
    track, stays, found = month
    places = {place.number: np.array(place.position) for place in found.places}
    # A fix there, or the first one of the next trip.
    seen = [
        stay
        for stay in stays
        if stay[1] - stay[0] >= 300
        and ((track.times >= stay[0]) & (track.times <= stay[1] + 12)).any()
    ]
    assert len(seen) > 60
    for begin, end, position in seen:
        assert any(
            min(end, stay.end) - max(begin, stay.start) > 0.5 * (end - begin)
            and np.linalg.norm(places[stay.place] - position) < 100
            for stay in found.stays
        ), (begin, end, position)


def test_all_trips_of_a_person_that_were_recorded_are_found(month):
    track, stays, found = month
    trips = [(one[1], other[0]) for one, other in zip(stays, stays[1:], strict=False)]
    recorded = [
        trip for trip in trips if ((track.times >= trip[0]) & (track.times <= trip[1])).sum() > 1
    ]
    assert phones.f1([(spans(found.trips), recorded)]) > 0.97


def test_places_of_a_person(month):
    _, stays, found = month
    truth = np.array([stay[2] for stay in stays])
    home = found.places[0]
    np.testing.assert_allclose(home.position, truth[0], atol=15)
    assert home.visits == pytest.approx((truth == truth[0]).all(axis=1).sum(), abs=3)
    assert sum(place.visits for place in found.places) == len(found.stays)
    dwell = sum(stay.end - stay.start for stay in found.stays)
    assert sum(place.dwell for place in found.places) == pytest.approx(dwell)
    assert sum(found.matrix.values()) == len(found.trips)
    assert sum(place.departures for place in found.places) == len(found.trips)
    # times that are no dates have no hours
    assert found.timezone == home.role == "" and not home.hours


def commuter(days=7, start=1_714_953_600.0, period=60.0):
    """A week from Monday, 2024-05-06 in UTC: at work from 9 to 17, 4 km away."""
    knots, x = [], []
    for day in range(days):
        base = start + 86_400 * day
        hours = [0, 8.7, 9, 17, 17.3, 23.99] if day < 5 else [0, 23.99]
        knots += [base + 3600 * hour for hour in hours]
        x += [0, 0, 4000, 4000, 0, 0] if day < 5 else [0, 0]
    times = np.arange(start, knots[-1], period)
    along = np.interp(times, knots, x)
    return gpszip.Track("phone", times, np.stack([along, 0 * along], axis=1))


def test_roles_of_a_commuter_depend_on_the_time_zone():
    home, work = gpszip.trips(commuter(), timezone="UTC").places
    assert (home.role, home.evidence) == ("home", "7 of 7 nights known")
    assert (work.role, work.evidence) == ("work", "5 of 5 working days known")
    assert work.usual == "9-17"
    assert work.weekdays[5:] == (0, 0) and work.weekdays[0] == pytest.approx(8 * 3600, abs=300)

    # in Tokyo, the same hours are an evening and a night
    found = gpszip.trips(commuter(), timezone="Asia/Tokyo")
    assert found.places[1].usual == "0-2, 18-24"
    assert found.places[1].role == ""


def test_without_a_time_zone_nothing_is_home_or_work():
    # Midnight to 7 h of UTC is an afternoon in Los Angeles.
    found = gpszip.trips(commuter())
    assert (found.timezone, found.timezone_from) == ("UTC", "default")
    assert [(place.role, place.evidence) for place in found.places] == [("", ""), ("", "")]
    assert found.places[1].usual == "9-17"


def test_the_time_zone_is_said(monkeypatch):
    assert gpszip.trips(commuter(1)).timezone_from == "default"
    with pytest.raises(OptionError, match="no time zone 'Berlin'"):
        gpszip.trips(commuter(1), timezone="Berlin")

    # a package may know that of the place
    class Finder:
        def timezone_at(self, *, lat, lng):
            return "Europe/Berlin" if (round(lat), round(lng)) == (52, 13) else None

    module = type(sys)("timezonefinder")
    module.TimezoneFinder = Finder
    monkeypatch.setitem(sys.modules, "timezonefinder", module)
    assert local_time.zone_of_place(52.4, 13.3) == "Europe/Berlin"
    log = {"t": 1.7e9 + np.arange(600.0), "lat": np.full(600, 52.4), "lon": np.full(600, 13.3)}
    found = gpszip.trips(log)
    assert (found.timezone, found.timezone_from) == ("Europe/Berlin", "place")


def test_an_archive_gives_what_its_log_gives():
    track = commuter(days=4, period=300.0)
    archive = gpszip.compress(track, max_error=5.0, effort=1)
    found, expected = gpszip.trips(archive, timezone="UTC"), gpszip.trips(track, timezone="UTC")
    assert found.matrix == expected.matrix == {(1, 2): 4, (2, 1): 4}
    np.testing.assert_allclose(spans(found.trips), spans(expected.trips), atol=180)
    assert [place.role for place in found.places] == ["home", "work"]
    assert found.trips[0].length == pytest.approx(4000, abs=20)


def test_an_archive_that_keeps_errors_uses_them():
    day = phones.a_round_trip(phones.drive, 1)
    track, _ = phone_log(day, 1, period=20.0)
    archive = gpszip.compress(track, max_error=20.0, effort=1, keep=["accuracy"])
    assert phones.f1([(spans(gpszip.trips(archive).trips), day.trips)]) == 1.0


def test_tracks_without_times_are_refused():
    shape = gpszip.Track("shape", [0.0, 5.0], [[0, 0], [5, 0]], timed=False)
    with pytest.raises(OptionError, match="no track has times"):
        gpszip.trips(shape)
    with pytest.raises(OptionError, match="radius is -1"):
        gpszip.trips(commuter(1), radius=-1.0)
    with pytest.raises(OptionError, match="min_stay is nan"):
        gpszip.trips(commuter(1), min_stay=math.nan)


def test_places_are_those_of_all_tracks():
    one = commuter(5)
    other = gpszip.Track("friend", one.times[:2000] + 30, one.positions[:2000] + 40)
    found = gpszip.trips([one, other], timezone="UTC")
    assert len(found.places) == 2
    assert {stay.track for stay in found.stays if stay.place == 1} == {"phone", "friend"}


def test_a_robot_has_small_places():
    times = np.arange(0.0, 400.0, 0.5)
    x = np.interp(times, [0, 100, 140, 260, 300, 400], [0, 0, 20, 20, 0, 0])
    track = gpszip.Track("robot", times, np.stack([x, 0 * x], axis=1))
    found = gpszip.trips(track, radius=1.0, min_stay=30.0, max_pause=60.0)
    assert found.matrix == {(1, 2): 1, (2, 1): 1}
    np.testing.assert_allclose(spans(found.trips), [(100, 140), (260, 300)], atol=3)
