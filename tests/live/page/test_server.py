"""The server of the live page, asked as browsers and others would."""

import base64
import gzip
import http.client
import json
import socket
from importlib.util import find_spec

import pytest

from gpszip.errors import OptionError
from gpszip.live.page.server import MAX_CLIENTS, PageServer
from live.page.running import Stream, event, fix, serving
from live.running import request

pytestmark = pytest.mark.skipif(
    find_spec("starlette") is None or find_spec("uvicorn") is None, reason="needs gpszip[live]"
)


@pytest.fixture(scope="module")
def page():
    with serving(page="<p>page</p>") as running:
        yield running


def ask(port, path, method="GET", **headers):
    """Answer to a request, and its body."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    try:
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer, answer.read()
    finally:
        connection.close()


def test_the_page_and_its_map_are_sealed(page):
    for path, kind in [("/", "text/html; charset=utf-8"), ("/scene", "application/json")]:
        answer, body = ask(page.port, path)
        assert (answer.status, answer.getheader("Content-Type")) == (200, kind)
        policy = answer.getheader("Content-Security-Policy")
        assert "default-src 'none'" in policy
        assert "connect-src 'self'" in policy
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
        assert answer.getheader("Access-Control-Allow-Origin") is None
    assert json.loads(body)["title"] == "Live positions"
    answer, packed = ask(page.port, "/scene", **{"Accept-Encoding": "gzip, br"})
    assert answer.getheader("Content-Encoding") == "gzip"
    assert gzip.decompress(packed) == body


@pytest.mark.parametrize(
    "path", ["/index.html", "//", "/scene/", "/../etc/passwd", "/%2e%2e/", "/health", "/stream/1"]
)
def test_nothing_else_is_served(page, path):
    assert ask(page.port, path)[0].status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS", "TRACE"])
def test_only_get_is_allowed(page, method):
    answer, _ = ask(page.port, "/", method)
    assert (answer.status, answer.getheader("Allow")) == (405, "GET")


def test_other_names_that_lead_here_are_refused(page):
    assert ask(page.port, "/scene", Host="evil.example:80")[0].status == 421
    assert ask(page.port, "/scene", Host=f"localhost:{page.port}")[0].status == 200


def test_a_request_with_a_long_head_is_refused(page):
    with socket.create_connection(("127.0.0.1", page.port), 30) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + 20_000 * b"x")
        assert connection.recv(100).startswith(b"HTTP/1.1 400")


def test_the_stream_tells_what_is_known_and_what_changes(page):
    page.take(fix("ann", 0), fix("ann", 60, (48.001, 11.5), heading=90.0, speed=float("nan")))
    page.send(event("stay.start", "1"), event("predicted", "2"))
    stream = Stream(page.port)
    assert stream.answer.getheader("Content-Type").startswith("text/event-stream")
    assert stream.next("tails") == [["ann", 1.7e9, 48.0, 11.5, 1.7e9 + 60, 48.001, 11.5]]
    assert [each["id"] for each in stream.next("outlooks")] == ["2"]
    ((*row, heading, speed, is_geographic),) = stream.next("agents")
    assert (row[0], row[4:6], heading, speed, is_geographic) == ("ann", [48.001, 11.5], 90, None, 1)
    assert [each["id"] for each in stream.next("events")] == ["1", "2"]
    assert stream.next("state")["agents"] == 1

    # What changes.
    page.take(fix("ann", 120, (48.002, 11.5)))
    assert stream.next("agents")[0][4] == 48.002
    page.notices.count("stored", 3)

    # A phone sends what it kept: all of its way is shown.
    page.take(*(fix("ann", 120 + 60 * k, (48.002 + k / 1e3, 11.5)) for k in (1, 2, 3)))
    assert stream.next("tails")[0][-6:] == [1.7e9 + 240, 48.004, 11.5, 1.7e9 + 300, 48.005, 11.5]
    while stream.next("state")["counts"].get("stored") != 3:
        pass
    page.send(event("stay.end", "3"))
    assert [each["id"] for each in stream.next("events")] == ["3"]
    stream.close()

    # A page that comes again gets what it lacks; an id of another run is none.
    again = Stream(page.port, last_event_id=stream.id.rpartition("-")[0] + "-2")
    assert [each["id"] for each in again.next("events")] == ["3"]
    again.close()
    for id in ["0000-2", "", "x", stream.id.replace("-", "--")]:
        other = Stream(page.port, last_event_id=id)
        assert [each["id"] for each in other.next("events")] == ["1", "2", "3"]
        other.close()


def test_pages_are_limited():
    with serving(page="") as page:
        streams = [Stream(page.port) for _ in range(MAX_CLIENTS)]
        for stream in streams:
            stream.next("hello")
        assert request(page.port, "/stream")[0] == 503
        assert request(page.port, "/")[0] == 200

        # Whoever closes a page makes room for another one.
        for stream in streams:
            stream.close()
        page.take(fix("ann"))
        while (after := Stream(page.port)).answer.status != 200:
            after.close()
        after.close()


def test_a_token_is_asked_for():
    with serving(page="", token="sécret") as page:
        right = base64.b64encode("ann:sécret".encode()).decode()
        wrong = base64.b64encode(b"ann:secret").decode()
        refused, _ = ask(page.port, "/", Authorization=f"Basic {wrong}")
        assert refused.status == 401
        assert refused.getheader("WWW-Authenticate").startswith("Basic")
        assert ask(page.port, "/stream")[0].status == 401
        assert ask(page.port, "/nothing?token=x")[0].status == 401
        assert ask(page.port, "/", Authorization=f"Basic {right}")[0].status == 200
        assert ask(page.port, "/scene?token=s%C3%A9cret", Host="positions.example")[0].status == 200
        assert page.notices.counts["requests to the page with a wrong token refused"] == 3


def test_other_machines_need_a_token(page):
    with pytest.raises(OptionError, match="other machines reach the page"):
        PageServer("0.0.0.0", 0, page.notices, "", b"{}")
    with pytest.raises(OptionError, match="can't listen at"):
        PageServer("127.0.0.1", page.port, page.notices, "", b"{}")
