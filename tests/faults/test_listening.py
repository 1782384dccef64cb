"""Listeners that are killed again and again: each event arrives, in each place where events go.

By default, a listener is killed twice. ``GPSZIP_FAULTS=all`` kills one on a map 20 times.
"""

import contextlib
import http.client
import os
import random
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from typing import ClassVar

import numpy as np
import pytest

import gpszip
from gpszip.geo.planes import to_plane
from gpszip.live.events import Event, standing
from gpszip.model import Plane
from gpszip.model.projection import to_geographic
from gpszip.testing import shuttles
from live.running import listening, request, stored
from live.servers import broker, find_program, free_port, wait_for_port, wait_until

ALL = os.environ.get("GPSZIP_FAULTS") == "all"

#: Where the buses drive, in units of 1e-7 degrees.
MIDDLE = Plane(((480_000_000, 115_000_000),))

#: Times that the listener is killed, and fixes that it gets before each.
KILLS, FIXES = (20, 200) if ALL else (2, 60)

pytestmark = [
    pytest.mark.skipif(find_program("mosquitto") is None, reason="needs mosquitto"),
    pytest.mark.skipif(find_spec("paho") is None, reason="needs paho-mqtt"),
    pytest.mark.skipif(find_spec("starlette") is None, reason="needs gpszip[live]"),
]


class Hook(BaseHTTPRequestHandler):
    """A webhook that is sometimes busy, and sometimes takes events without an answer."""

    rng: ClassVar = random.Random(2)
    lines: ClassVar[list[str]] = []

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        chance = self.rng.random()
        if chance < 0.1:
            self.send_error(503)
            return
        self.lines += body.splitlines()
        if chance < 0.9:
            self.send_response(204)
            self.end_headers()

    def log_message(self, *_words):
        """Say nothing."""


@pytest.fixture
def hook():
    """Address of a webhook."""
    Hook.lines.clear()
    server = ThreadingHTTPServer(("127.0.0.1", 0), Hook)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/hook"
    server.shutdown()
    thread.join()
    server.server_close()


@contextlib.contextmanager
def subscriber(port):
    """Messages of a broker, as they come."""
    from paho.mqtt.client import CallbackAPIVersion, Client

    lines, client = [], Client(CallbackAPIVersion.VERSION2, client_id="test")
    ready = threading.Event()
    client.on_message = lambda _client, _data, message: lines.append(message.payload.decode())
    client.on_connect = lambda *_words: client.subscribe("gpszip/#", qos=1)
    client.on_subscribe = lambda *_words: ready.set()
    client.connect("127.0.0.1", port)
    client.loop_start()
    assert ready.wait(60)
    yield lines
    client.disconnect()
    client.loop_stop()


def make_fixes(count):
    """Fixes of two buses from two hours ago on, some of them late by up to a few minutes."""
    log = shuttles(2, lines=1, days=1, seed=3, blocks=3, period=20.0)
    rng = np.random.default_rng(1)
    rows = []
    for track in log.tracks:
        places = np.stack(to_geographic(track.positions, MIDDLE), axis=1).tolist()
        since = (track.times - log.tracks[0].times[0]).tolist()
        for time_, place in zip(since, places, strict=True):
            delay = rng.uniform(0, 300) if rng.random() < 0.05 else 0.0
            rows.append((time_ + delay, track.id, time_, place))
    rows = sorted(rows)[:count]
    return [(agent, time.time() - 7200 + time_, place) for _, agent, time_, place in rows]


def send(port, fixes, listener):
    """Send fixes until the listener dies; return how many it acknowledged."""
    for number, (agent, when, (lat, lon)) in enumerate(fixes):
        try:
            path = f"/osmand?id={agent}&lat={lat:.7f}&lon={lon:.7f}&timestamp={when:.3f}"
            assert request(port, path)[0] == 200
        except (OSError, http.client.HTTPException):
            listener.process.wait()
            return number
        time.sleep(0.001)
    return len(fixes)


def read(lines):
    """Events of lines, each once: whoever is not sure that it was taken sends it again."""
    events = {}
    for line in lines:
        event = Event.from_json(line)
        assert events.setdefault(event.id, event) == event
    return list(events.values())


def test_killed_again_and_again_each_event_arrives_everywhere(tmp_path, hook):
    # Two buses, in the long run on the map of their line.
    rng, journal, on_map = random.Random(7), tmp_path / "journal", []
    left = fixes = make_fixes(KILLS * FIXES)
    if ALL:
        tracks = [part for part in degrees_of(fixes) if len(part) > 1]
        gpszip.compress(tracks, rmse=8.0, effort=1).save(tmp_path / "map.gpsz")
        on_map = [tmp_path / "map.gpsz"]

    port, events = free_port(), tmp_path / "events.ndjson"
    with broker(tmp_path) as mqtt, subscriber(mqtt) as messages:
        to_sinks = ["-o", events, "-o", hook, "-o", f"mqtt://127.0.0.1:{mqtt}"]
        for number in range(1, KILLS + 1):
            with listening(journal, *on_map, "--http", port, *to_sinks) as listener:
                wait_for_port(port, listener.process)
                upto = len(fixes) - number * FIXES
                timer = threading.Timer(rng.uniform(0.2, 2.0), listener.process.kill)
                timer.start()
                left = left[send(port, left[: len(left) - upto], listener) :]
                timer.join()

        # What was stored has its events now, everywhere.
        with listening(journal, *on_map, "--http", port, *to_sinks) as listener:
            wait_for_port(port, listener.process)
            assert send(port, left, listener) == len(left)
            listener.end()
        with listening(journal, *on_map, "--stdin", *to_sinks) as listener:
            assert listener.process.wait(120) == 0, listener.lines
        told = read(events.read_text().splitlines())
        assert wait_until(lambda: len(read(messages)) == len(told), 10)

    # None twice, none lost.
    assert len(stored(journal)) == len(fixes)
    assert len(told) == len(events.read_text().splitlines())
    assert [event.seq for event in told] == list(range(1, len(told) + 1))
    assert read(Hook.lines) == told
    assert sorted(read(messages), key=lambda event: event.seq) == told

    # They are those of a run without an end.
    monitor = gpszip.Monitor(*on_map)
    whole = [event for fix in stored(journal) for event in monitor.push(fix)] + monitor.close()
    assert {event.id for event in standing(told)} == {event.id for event in standing(whole)}
    assert sum(event.revises is not None for event in told) > 0


def degrees_of(fixes):
    """Fixes as tracks, sorted by time."""
    names = sorted({agent for agent, _, _ in fixes})
    for name in names:
        rows = sorted((when, *place) for agent, when, place in fixes if agent == name)
        times, lat, lon = np.array(rows).T
        yield gpszip.Track(name, times, to_plane(lat, lon, MIDDLE), plane=MIDDLE)
