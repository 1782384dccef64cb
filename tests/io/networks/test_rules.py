import math

import pytest

from gpszip.io.networks.lines import RoadUsers
from gpszip.io.networks.rules import (
    expected_speed,
    parse_directions,
    parse_speed_limit,
    road_class_speed,
    road_class_users,
)


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
    assert parse_directions(oneway, **words) == ways


@pytest.mark.parametrize(
    ("text", "kmh"),
    [
        ("50", 50),
        ("30 mph", 48.28),
        ("50;30", 30),
        ("['50', '70']", 50),
        ("DE:rural", 90),
        ("walk", 6),
        ("none", 130),
        ("80 km/h", 80),
    ],
)
def test_limits(text, kmh):
    assert parse_speed_limit(text) * 3.6 == pytest.approx(kmh, abs=0.01)


@pytest.mark.parametrize("text", [None, "", "signals", "variable", "0", "99999"])
def test_texts_without_a_limit(text):
    assert math.isnan(parse_speed_limit(text))


def test_limits_decide_on_speeds_unless_far_above_the_class():
    assert expected_speed(parse_speed_limit("30"), road_class_speed("primary")) < road_class_speed(
        "primary"
    )
    assert expected_speed(parse_speed_limit("100"), road_class_speed("service")) == pytest.approx(
        1.5 * road_class_speed("service")
    )
    assert math.isnan(expected_speed(float("nan"), road_class_speed("nothing")))


def test_users():
    assert [
        road_class_users(road)
        for road in ("footway", "motorway", "residential", "['footway', 'x']", None)
    ] == [
        RoadUsers.NON_MOTOR,
        RoadUsers.MOTOR_ONLY,
        RoadUsers.ANYBODY,
        RoadUsers.NON_MOTOR,
        RoadUsers.ANYBODY,
    ]
