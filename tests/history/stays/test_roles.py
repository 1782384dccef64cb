"""Local hours of stays, and what places are by them."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import OptionError
from gpszip.history.local_time import find_zone, hour_rows
from gpszip.history.stays.roles import find_roles, usual_hours


def seconds(*date):
    return datetime(*date, tzinfo=UTC).timestamp()


def test_hours_of_a_zone_with_half_an_hour():
    start = seconds(2024, 3, 5, 18, 20)  # 23:50 in Kolkata
    _, durations, hours, days = hour_rows([start], [start + 1200], find_zone("Asia/Kolkata"))
    assert dict(zip(hours.tolist(), durations.tolist(), strict=False)) == {23: 600, 0: 600}
    assert np.diff(days).tolist() == [1]


def test_the_night_in_which_clocks_go_back_is_longer():
    zone = find_zone("Europe/Berlin")
    start, end = seconds(2024, 10, 26, 22), seconds(2024, 10, 27, 5)  # local midnight to 6
    _, durations, hours, _ = hour_rows([start], [end], zone)
    assert np.bincount(hours, durations).tolist() == [3600, 3600, 7200, 3600, 3600, 3600]


@given(st.floats(1e9, 2e9), st.floats(0, 1e6))
def test_parts_make_up_the_whole(start, duration):
    rows, durations, hours, days = hour_rows([start], [start + duration], UTC)
    assert durations.sum() == pytest.approx(duration, abs=1e-5)
    assert ((hours >= 0) & (hours < 24)).all() and (np.diff(days) >= 0).all()
    assert not rows.any()


def test_an_unknown_zone_is_refused():
    with pytest.raises(OptionError, match="there is no time zone 'Mars/Base'"):
        find_zone("Mars/Base")
    with pytest.raises(OptionError, match="no time zone"):
        find_zone("../../etc/passwd")


def week(place_of_hour, days):
    """Parts of an hour each: place, hour and day."""
    rows = [
        (place, hour, day)
        for day in range(days)
        for hour in range(24)
        if (place := place_of_hour(day, hour)) is not None
    ]
    place, hour, day = np.array(rows, np.int64).reshape(-1, 3).T
    return place, np.zeros(len(place), np.int64), np.full(len(place), 3600.0), hour, day


def a_worker(day, hour):
    # 1970-01-05, day 4, is a Monday
    return 1 if (day + 3) % 7 < 5 and 8 <= hour < 17 else 0


def test_home_and_work_with_their_evidence():
    home, work = find_roles(*week(a_worker, 14), 2)
    assert home == ("home", "14 of 14 nights known")
    assert work == ("work", "10 of 10 working days known")


def test_two_nights_are_no_home():
    (only,) = find_roles(*week(lambda *_: 0, 2), 1)
    assert only == ("", "2 of 2 nights known; 2 of 2 working days known")


def test_a_place_of_few_of_many_nights_is_no_home():
    roles = find_roles(*week(lambda day, _: day % 3, 12), 3)
    assert [role.name for role in roles] == ["", "", ""]
    assert roles[0].evidence.startswith("4 of 12 nights known")


def test_each_track_has_nights_of_its_own():
    place, owner, duration, hour, day = week(lambda *_: 0, 2)
    twice = [np.concatenate([values, values]) for values in (place, duration, hour, day)]
    (only,) = find_roles(twice[0], np.concatenate([owner, owner + 1]), *twice[1:], 1)
    assert only.name == "home"


def test_usual_hours():
    place, owner, duration, hour, day = week(a_worker, 7)
    rows = place == 1
    assert usual_hours(duration[rows], hour[rows], day[rows], owner[rows]) == "8-17"
    assert usual_hours(duration[~rows], hour[~rows], day[~rows], owner[~rows]) == "0-8, 17-24"
