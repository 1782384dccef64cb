"""Messages of apps: each of the same position."""

import base64
from dataclasses import astuple
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.live import Fix, Unusable
from gpszip.live.formats import values
from gpszip.live.formats.apps import App, app_of, parse_message
from gpszip.live.formats.query import parse_query
from gpszip.live.formats.values import (
    Context,
    MessageError,
    clean_name,
    parse_json,
    parse_time,
    to_number,
)
from live import bodies

CONTEXT = Context(bodies.TIME + 3.0, "test")

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


def query_fields(text):
    return dict(pair.split("=", 1) for pair in text.split("&"))


FIXES = {
    "owntracks": lambda: parse_message(App.OWNTRACKS, bodies.owntracks(), CONTEXT),
    "overland": lambda: parse_message(App.OVERLAND, bodies.overland(), CONTEXT),
    "traccar": lambda: parse_message(App.TRACCAR, bodies.traccar(), CONTEXT),
    "osmand": lambda: parse_query(query_fields(bodies.OSMAND), CONTEXT),
    "gpslogger": lambda: parse_query(query_fields(bodies.GPSLOGGER), CONTEXT),
}


@pytest.mark.parametrize("app", FIXES)
def test_every_app_gives_the_same_fix(app):
    (fix,) = FIXES[app]()
    assert fix.agent == ("ann/phone" if app == "owntracks" else "ann")
    assert (fix.time, fix.received) == (bodies.TIME, bodies.TIME + 3)
    assert fix.position == (bodies.LAT, bodies.LON)
    assert (fix.accuracy, fix.heading, fix.speed, fix.quality) == (12, 270, 5.0, "")


def test_apps_are_told_apart_by_their_members():
    assert app_of(bodies.owntracks()) is App.OWNTRACKS
    assert app_of(bodies.overland()) is App.OVERLAND
    assert app_of(bodies.traccar()) is App.TRACCAR
    assert app_of({"location": {}}) is app_of(7) is app_of({}) is None


@pytest.mark.parametrize("kind", ["lwt", "card", "cmd", "status", "waypoint", "steps", None, 7])
def test_owntracks_sends_other_messages_too(kind):
    (item,) = parse_message(App.OWNTRACKS, bodies.owntracks(_type=kind), CONTEXT)
    assert isinstance(item, Unusable)
    assert "other than locations" in item.reason


def test_owntracks_names_its_sender():
    def agent(context_agent="", **more):
        message = bodies.owntracks(**more)
        return parse_message(App.OWNTRACKS, message, Context(0.0, "t", context_agent))[0].agent

    assert agent(topic=None) == "an"
    assert agent(topic="my/base/bob/car") == "bob/car"
    assert agent("carl", topic=None) == "carl"
    assert "name" in parse_message(App.OWNTRACKS, {"_type": "location"}, CONTEXT)[0].reason


def test_encrypted_messages_are_told():
    body = {"_type": "encrypted", "data": base64.b64encode(b"x").decode()}
    assert "encrypted" in parse_message(App.OWNTRACKS, body, CONTEXT)[0].reason


@pytest.mark.parametrize("accuracy", [0, -1, None, "", "much", True])
def test_no_accuracy_is_perfect(accuracy):
    (fix,) = parse_message(App.OWNTRACKS, bodies.owntracks(acc=accuracy), CONTEXT)
    assert fix.accuracy is None


@pytest.mark.parametrize("app", ["overland", "traccar"])
def test_negative_numbers_are_unknown(app):
    body = bodies.overland(speed=-1, course=-1) if app == "overland" else bodies.traccar()
    if app == "traccar":
        body["location"]["coords"] |= {"speed": -1, "heading": -1}
    (fix,) = parse_message(App(app), body, CONTEXT)
    assert (fix.speed, fix.heading) == (None, None)


def test_overland_batches_are_taken_item_by_item():
    body = bodies.overland(3)
    body["locations"][1] = {"type": "Feature", "properties": {"action": "visit"}}
    body["locations"] += [7, {"type": "Feature"}, {"properties": {"device_id": "x" * 101}}]
    found = parse_message(App.OVERLAND, body, Context(0.0, "t", "ann"))
    assert [isinstance(item, Fix) for item in found] == [True, False, True, False, False, False]


def test_overland_without_a_device_is_named_by_its_path():
    (fix,) = parse_message(App.OVERLAND, bodies.overland(device_id=""), Context(0.0, "t", "bob"))
    assert fix.agent == "bob"


def test_a_message_without_a_time_counts_when_it_comes():
    (fix,) = parse_query({"id": "a", "lat": "1", "lon": "2"}, CONTEXT)
    assert (fix.time, fix.quality) == (CONTEXT.received, "arrival")


def test_a_time_that_cannot_be_read_is_none():
    with pytest.raises(MessageError, match=r"time can.t be read"):
        parse_query({"id": "a", "lat": "1", "lon": "2", "timestamp": "noon"}, CONTEXT)
    (item,) = parse_message(App.OWNTRACKS, bodies.owntracks(tst="noon"), CONTEXT)
    assert "time can't be read" in item.reason


def test_queries_have_many_spellings():
    def fix(text, context=CONTEXT):
        return parse_query(query_fields(text), context)[0]

    assert fix("deviceid=a&location=1.5,2.5").position == (1.5, 2.5)
    assert fix("id=a&lat=1&lon=2&timestamp=1795000000500").time == 1_795_000_000.5
    berlin = Context(0.0, "t", "", ZoneInfo("Europe/Berlin"))
    assert fix("id=a&lat=1&lon=2&timestamp=2026-11-18 12:06:40", berlin).time == bodies.TIME
    assert "not valid" in fix("id=a&lat=1&lon=2&valid=false").reason
    assert fix("id=a&lat=1&lon=2&spd_kph=36").speed == 10.0
    assert "without a position" in fix("id=a&lat=&lon=2").reason
    sentence = "$GPRMC,110640,A,4808.22924,N,01134.56744,E,9.719,270,181126,,"
    opengts = fix(f"id=a&dev=b&gprmc={sentence}")
    assert opengts.time == bodies.TIME
    assert opengts.position == pytest.approx((bodies.LAT, bodies.LON))
    assert opengts.speed == pytest.approx(5.0, abs=1e-3)


@given(st.sampled_from([App.OWNTRACKS, App.OVERLAND, App.TRACCAR]), json_values)
def test_no_message_raises(app, value):
    names = {
        App.OWNTRACKS: {"_type": "location", "tid": "a", "lat": value, "lon": 1, "tst": value},
        App.OVERLAND: {"locations": [value, {"properties": value, "geometry": value}]},
        App.TRACCAR: {"device_id": value, "location": {"coords": value, "timestamp": value}},
    }
    for message in (value, names[app]):
        for item in parse_message(app, message, CONTEXT):
            assert isinstance(item, Fix | Unusable)
            if isinstance(item, Fix):
                assert all(isinstance(number, float) for number in (item.time, *item.position))
                assert len(astuple(item)) == 11


@given(st.dictionaries(st.sampled_from(["id", "lat", "lon", "timestamp", "gprmc"]), st.text()))
def test_no_query_raises(fields):
    try:
        parse_query(fields, CONTEXT)
    except MessageError as error:
        assert "left out" in str(error)


# Values.


def test_names_are_limited():
    assert clean_name(None, True, " ", 7) == "7"
    for wrong in ("x" * 101, "x" * 10_000, "a\nb", "a\x1b[2J", 10**5_000, "\ud800"):
        with pytest.raises(MessageError, match="name"):
            clean_name(wrong)
    with pytest.raises(MessageError, match="without a name"):
        clean_name("", None)


@pytest.mark.parametrize(
    "wrong", [b"{", b"[1, NaN]", b'{"a": Infinity}', b"\xff", b"1" * 5000, b"[" * 1000]
)
def test_bad_json_is_refused(wrong):
    with pytest.raises(MessageError):
        parse_json(wrong)


@given(st.recursive(st.text('"\\[{a', max_size=4), lambda inner: st.lists(inner, max_size=2)))
def test_the_depth_of_json_is_its_levels(value):
    import json

    def depth(item):
        return 1 + max(map(depth, item), default=0) if isinstance(item, list) else 0

    limit, values._MAX_DEPTH = values._MAX_DEPTH, 0
    try:
        assert values._depth(json.dumps(value).encode()) == depth(value)
    finally:
        values._MAX_DEPTH = limit


def test_times_and_numbers():
    iso = "2026-11-18T11:06:40"
    for text in (f"{iso}Z", f"{iso}+00:00", "2026-11-18T12:06:40+0100", "2026-11-18 11:06:40"):
        assert parse_time(text) == bodies.TIME
    for unit in (1, 1e3, 1e6, 1e9):
        assert parse_time(bodies.TIME * unit) == bodies.TIME
    for wrong in (None, "", "now", [], "9" * 41, True, "9999-99-99T00:00:00"):
        assert parse_time(wrong) is None
    assert [to_number(value) for value in ("1_0", 10**400, "inf", [], "1e3")] == [None] * 4 + [1e3]
