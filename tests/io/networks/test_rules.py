import math

import pytest

from gpszip.io.networks.lines import Users
from gpszip.io.networks.rules import class_speed, class_users, directions, expected_speed, speed_limit


@pytest.mark.parametrize(
    ("words", "ways"),
    [
        ({"oneway": None}, (True, True)),
        ({"oneway": "yes"}, (True, False)),
        ({"oneway": "True"}, (True, False)),
        ({"oneway": "1"}, (True, False)),
        ({"oneway": "-1"}, (False, True)),
        ({"oneway": "reverse"}, (False, True)),
        ({"oneway": "no"}, (True, True)),
        ({"oneway": "B"}, (True, True)),
        ({"oneway": "F"}, (True, False)),
        ({"oneway": "reversible"}, (True, True)),
        ({"oneway": None, "junction": "roundabout"}, (True, False)),
        ({"oneway": "-1", "junction": "roundabout"}, (False, True)),
        ({"oneway": None, "road": "motorway"}, (True, False)),
        ({"oneway": None, "road": "motorway_link"}, (True, True)),
        ({"oneway": "no", "road": "motorway"}, (True, True)),
    ],
)
def test_directions(words, ways):
    oneway = words.pop("oneway")
    assert directions(oneway, **words) == ways


@pytest.mark.parametrize(
    ("text", "kmh"),
    [("50", 50), ("30 mph", 48.28), ("50;30", 30), ("['50', '70']", 50), ("DE:rural", 90), ("walk", 6), ("none", 130), ("80 km/h", 80)],
)
def test_limits(text, kmh):
    assert speed_limit(text) * 3.6 == pytest.approx(kmh, abs=0.01)


@pytest.mark.parametrize("text", [None, "", "signals", "variable", "0", "99999"])
def test_limits_that_say_nothing(text):
    assert math.isnan(speed_limit(text))


def test_limits_count_for_more_than_classes_unless_they_are_absurd():
    assert expected_speed(speed_limit("30"), class_speed("primary")) < class_speed("primary")
    assert expected_speed(speed_limit("100"), class_speed("service")) == pytest.approx(1.5 * class_speed("service"))
    assert math.isnan(expected_speed(float("nan"), class_speed("nothing")))


def test_users():
    assert [class_users(road) for road in ("footway", "motorway", "residential", "['footway', 'x']", None)] == [
        Users.NO_MOTORS,
        Users.MOTORS,
        Users.ANYBODY,
        Users.NO_MOTORS,
        Users.ANYBODY,
    ]
