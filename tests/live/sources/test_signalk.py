"""Signal K: a server that speaks its protocol, and what it is asked for."""

import json
import math
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib.util import find_spec

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import OptionError
from gpszip.live import Fix, Notices, Unusable
from gpszip.live.formats.signalk import SignalKParser
from gpszip.live.formats.values import Context
from gpszip.live.sources import websocket
from gpszip.live.sources.signalk import SignalKSource
from live.bodies import ISO, LAT, LON, TIME
from live.receiving import Taken, running, send, serving, until
from live.receiving import run as finish

needs_websockets = pytest.mark.skipif(find_spec("websockets") is None, reason="needs gpszip[live]")

DAY = 86_400

SELF = "vessels.urn:mrn:signalk:uuid:c0d79334-4e25-4245-8892-54e8ccc8021d"
OTHER = "vessels.urn:mrn:imo:mmsi:230099999"
HELLO = {"name": "boat", "version": "2.8.0", "self": SELF, "roles": ["main"], "timestamp": ISO}


def delta(vessel, values, source="gps.1", seconds=0, **more):
    stamp = f"2026-11-18T11:06:{40 + seconds:02}.000Z"
    listed = [{"path": f"navigation.{path}", "value": value} for path, value in values.items()]
    update = {"$source": source, "timestamp": stamp, "values": listed} | more
    return {"context": vessel, "updates": [update]}


def at(lat=LAT, lon=LON):
    return {"position": {"latitude": lat, "longitude": lon}}


def parse(*messages, name="", received=TIME + 2.0):
    """Fixes and others of messages that come one second after the other."""
    parser = SignalKParser(name, Notices(str))
    items = []
    for number, message in enumerate(messages):
        items += parser.parse(message, Context(received + number, "signalk"))
    return [each for each in items if isinstance(each, Fix)], [
        each for each in items if isinstance(each, Unusable)
    ]


def test_the_own_vessel_and_others():
    moving = {"speedOverGround": 5.0, "courseOverGroundTrue": math.pi / 2, "speedThroughWater": 1}
    fixes, others = parse(
        HELLO,
        delta(SELF, at() | moving),
        delta("vessels.self", at(), seconds=1),
        delta(OTHER, at(1.0), source="ais"),
        {"updates": delta(SELF, at(), seconds=2)["updates"]},
    )
    own = "c0d79334-4e25-4245-8892-54e8ccc8021d"
    assert [fix.agent for fix in fixes] == [own, own, "230099999", own]
    assert (fixes[0].position, fixes[0].time, fixes[0].source) == ((LAT, LON), TIME, "signalk")
    # The last speed and course count for some seconds.
    assert [(fix.speed, fix.heading) for fix in fixes] == [(5.0, 90.0)] * 2 + [
        (None, None),
        (5.0, 90.0),
    ]
    assert others == []
    fixes, _ = parse(HELLO, delta(SELF, at()), delta(OTHER, at()), name="Ann's boat")
    assert [fix.agent for fix in fixes] == ["Ann's boat", "230099999"]


def test_one_source_counts_until_it_is_lost():
    messages = [delta(SELF, at(t), source="gps.1" if t % 2 else "gps.2") for t in range(6)]
    fixes, _ = parse(*messages)
    assert [fix.position[0] for fix in fixes] == [0, 2, 4]
    # Another one counts more than ten seconds after the last of the first.
    messages = [delta(SELF, at(1.0), source={})] + [delta(SELF, at(t)) for t in range(2, 16)]
    fixes, _ = parse(*messages)
    assert [fix.position[0] for fix in fixes] == [1, 12, 13, 14, 15]
    # So it is by the times of positions, such as those of a log that is played faster.
    messages = [delta(SELF, at(1.0), source="b"), delta(SELF, at(2.0), seconds=11)]
    fixes, _ = parse(*messages, delta(SELF, at(3.0), source="b", seconds=12))
    assert [fix.position[0] for fix in fixes] == [1, 2]


def test_speed_and_course_are_those_of_the_source_and_not_old():
    fixes, _ = parse(
        delta(SELF, {"speedOverGround": 9.0}, source="other"),
        delta(SELF, {"speedOverGround": 5.0, "courseOverGroundTrue": None}),
        delta(SELF, at()),
        *[{} for _ in range(9)],
        delta(SELF, at(1.0), seconds=9),
    )
    assert [(fix.speed, fix.heading) for fix in fixes] == [(5.0, None), (None, None)]


def test_a_sentence_without_a_date_is_of_the_day_of_the_one_with_a_date():
    # As a real server sends them: it takes its own date for the time of day of GGA.
    def sentence(kind, day, lat, seconds=0):
        message = delta(SELF, at(lat), seconds=seconds)
        (update,) = message["updates"]
        update["source"] = {"type": "NMEA0183", "sentence": kind, "label": "gps.1"}
        update["timestamp"] = update["timestamp"].replace("-18T", f"-{day}T")
        return message

    # A log of another day, a receiver across midnight, and a date that is known.
    fixes, _ = parse(
        sentence("RMC", 15, 1.0), sentence("GGA", 18, 1.0), sentence("GLL", 18, 2.0, seconds=5)
    )
    assert [fix.time - TIME for fix in fixes] == [-3 * DAY, -3 * DAY, -3 * DAY + 5]
    (fix,), _ = parse(sentence("GGA", 19, 1.0))
    assert fix.time == TIME
    (fix,), _ = parse(sentence("RMC", 17, 1.0))
    assert fix.time == TIME - DAY


def test_a_position_without_a_time_counts_when_it_comes_and_a_lost_one_does_not():
    fixes, others = parse(
        delta(SELF, at(), timestamp=None),
        delta(SELF, {"position": None}),
        delta(SELF, {"position": {"latitude": None, "longitude": 1}}),
        delta(SELF, at(), timestamp="noon"),
        delta("vessels.urn:x:" + "y" * 200, at()),
    )
    assert [(fix.time, fix.quality) for fix in fixes] == [(TIME + 2.0, "arrival")]
    assert [each.reason.split(" left")[0] for each in others] == [
        "positions that a vessel has lost",
        "messages without a position",
        "messages whose time can't be read",
        "messages with a name of too many letters",
    ]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


@given(json_values)
def test_no_message_raises(value):
    update = {"source": value, "timestamp": value, "values": [{"path": value, "value": value}]}
    wrong = {"path": "navigation.position", "value": value}
    parse(
        value,
        {"self": value, "context": value, "updates": value},
        {"context": value, "updates": [value, update, {"values": value}]},
        {"updates": [{"$source": value, "source": {"label": value}, "values": [wrong]}]},
        delta(SELF, {"position": {"latitude": value, "longitude": value}}),
        delta(SELF, {"speedOverGround": value, "courseOverGroundTrue": value} | at()),
    )


class Server:
    """A server of Signal K that greets, and sends once it was asked."""

    def __init__(self, *messages):
        self.messages, self.asked, self.paths = messages, [], []

    async def __call__(self, connection):
        self.paths.append(connection.request.path)
        await send(connection, HELLO)
        self.asked.append(json.loads(await connection.recv()))
        await send(connection, *self.messages)
        await connection.wait_closed()


@contextmanager
def pages(body):
    """A web server with one body at all paths."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            data = body()
            self.send_response(200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_):
            pass

    asked = []
    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server.server_port, asked
        server.shutdown()
        thread.join()


@needs_websockets
def test_a_stream_with_what_is_wrong_between():
    wrong = ["{", "[" * 99, "7", b"\xff", json.dumps(delta(SELF, at(95.0)))]
    server = Server(*wrong, delta(SELF, at()), delta(OTHER, at(1.0)))
    taken = Taken(full=1)

    async def listen():
        async with serving(server) as port:
            source = SignalKSource(f"ws://127.0.0.1:{port}", "boat", taken.notices)
            async with running(source, taken):
                await until(lambda: len(taken.fixes) == 2)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gpszip.live.sources.lines._RETRY_SECONDS", 0.01)
        finish(listen())
    assert [fix.agent for fix in taken.fixes] == ["boat", "230099999"]
    assert server.paths == ["/signalk/v1/stream?subscribe=none"]
    (asked,) = server.asked
    assert asked["context"] == "vessels.*"
    assert [each["path"].partition(".")[2] for each in asked["subscribe"]] == [
        "position",
        "speedOverGround",
        "courseOverGroundTrue",
    ]


@needs_websockets
def test_a_server_is_found_by_its_page(monkeypatch):
    monkeypatch.setattr(websocket, "RETRY_SECONDS", (0.01, 0.02))
    server, taken = Server(delta(SELF, at())), Taken()
    answers = [b"", b"[1]", b'{"endpoints": {"v1": {"signalk-ws": "file:///etc/passwd"}}}']

    async def listen():
        async with serving(server) as port:
            found = {"endpoints": {"v1": {"signalk-ws": f"ws://127.0.0.1:{port}/stream"}}}
            with pages(lambda: answers.pop(0) if answers else json.dumps(found).encode()) as (
                page,
                asked,
            ):
                url = f"http://127.0.0.1:{page}?vessels=self&token=x"
                async with running(SignalKSource(url, "", taken.notices), taken):
                    await until(lambda: taken.fixes)
                return asked

    assert finish(listen()) == ["/signalk"] * 4
    assert server.paths == ["/stream?subscribe=none&token=x"]
    assert server.asked[0]["context"] == "vessels.self"
    told = [line for line in taken.lines if "names no stream of Signal K" in line]
    assert len(told) == 1


@needs_websockets
@pytest.mark.parametrize("url", ["tcp://a", "ws://", "ws://a:b", "ws://a?vessels=none"])
def test_wrong_addresses(url):
    with pytest.raises(OptionError):
        SignalKSource(url, "", Notices(str))
