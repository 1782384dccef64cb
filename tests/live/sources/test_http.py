"""The server, in a process of its own, with the bodies that apps send."""

import asyncio
import base64
import contextlib
import json
import random
import socket
import threading
import time
from http.client import HTTPConnection, HTTPException
from importlib.util import find_spec
from urllib.parse import quote

import pytest

from gpszip.live import Notices
from gpszip.live.formats.encrypted import OwnTracksKeys
from gpszip.live.sources import http
from live import bodies
from live.formats.test_encrypted import seal
from live.receiving import Taken
from live.running import kill_when, listening, request, stored

pytestmark = pytest.mark.skipif(
    find_spec("starlette") is None or find_spec("uvicorn") is None, reason="needs gpszip[live]"
)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A listener without a token, its journal, and names that no other test has."""
    folder = tmp_path_factory.mktemp("server")
    with listening(folder, "--http", "127.0.0.1:0") as listener:
        yield listener, folder, iter(range(10_000))


@pytest.fixture
def send(server):
    """Send a body as a new agent; return the answer and what was stored for that agent."""
    listener, folder, numbers = server

    def call(path, body=None, **headers):
        agent = f"agent{next(numbers)}"
        path = path.replace("AGENT", agent)
        if isinstance(body, dict | list):
            body = json.dumps(body)
            headers.setdefault("content_type", "application/json")
        if isinstance(body, str):
            body = body.replace('"ann"', f'"{agent}"').replace("id=ann", f"id={agent}")
            body = body.replace("owntracks/ann/phone", f"owntracks/{agent}/phone").encode()
        answer = request(listener.port, path.replace("id=ann", f"id={agent}"), body, **headers)
        return answer, [fix for fix in stored(folder) if fix.agent.startswith(agent)]

    return call


#: Path, body, and the answer after which the app drops its queue.
APPS = {
    "owntracks": ("/owntracks", bodies.owntracks(), "[]"),
    "overland": ("/overland", bodies.overland(), '{"result":"ok"}'),
    "traccar": ("/traccar", bodies.traccar(), "{}"),
    "osmand": (f"/osmand?{bodies.OSMAND}", None, "OK"),
    "gpslogger": (f"/gpslogger?{bodies.GPSLOGGER}", None, "OK"),
}


@pytest.mark.parametrize("app", APPS)
@pytest.mark.parametrize("is_root", [False, True])
def test_apps_get_their_answer_once_all_is_stored(send, app, is_root):
    path, body, expected = APPS[app]
    (status, text), (fix,) = send(path.replace(f"/{app}", "/") if is_root else path, body)
    assert (status, text) == (200, expected)
    assert (fix.time, fix.position, fix.speed) == (bodies.TIME, (bodies.LAT, bodies.LON), 5.0)
    # At the root, fields of a query are those of OsmAnd's protocol.
    assert fix.source == ("osmand" if is_root and app == "gpslogger" else app)


def test_forms_and_files_are_taken_too(send):
    form = {"content_type": "application/x-www-form-urlencoded"}
    (status, _), fixes = send("/osmand", bodies.OSMAND, **form)
    assert (status, len(fixes)) == (200, 1)
    # JSON is none, whatever the header says.
    (status, text), fixes = send("/owntracks/AGENT", json.dumps(bodies.owntracks()), **form)
    assert (status, text, len(fixes)) == (200, "[]", 1)
    # GPSLogger posts the file of the day again and again.
    (status, text), fixes = send("/gpslogger/AGENT", bodies.GPSLOGGER_FILE * 3)
    assert (status, text, len(fixes)) == (200, "OK", 1)


def test_senders_are_named_by_path_user_headers_and_query(send, server):
    body = json.dumps(bodies.owntracks(topic=None))
    for path, headers in [
        ("/owntracks/AGENT", {}),
        ("/AGENT", {}),
        ("/owntracks?u=AGENT&d=phone", {}),
    ]:
        (status, _), fixes = send(path, body, **headers)
        assert (status, len(fixes)) == (200, 1), path
    named = {"x_limit_u": "hännah".encode(), "x_limit_d": "phone"}
    send("/owntracks", body, **named)
    credentials = base64.b64encode(b"basil:secret").decode()
    send("/owntracks", body, authorization=f"Basic {credentials}")
    assert {"hännah/phone", "basil"} <= {fix.agent for fix in stored(server[1])}


@pytest.mark.parametrize("name", ["ann#1", "ann?1", "a b", "ä/ß", "[x]"])
def test_names_in_the_path_may_have_any_letter(send, server, name):
    path = f"/gpslogger/AGENT{quote(name, safe='')}?lat=1&lon=1&timestamp={bodies.TIME}"
    (status, text), (fix,) = send(path)
    assert (status, text) == (200, "OK")
    assert fix.agent.endswith(name)


def test_a_batch_of_overland_is_stored_at_once(send):
    (status, text), fixes = send("/overland", bodies.overland(50))
    assert (status, text, len(fixes)) == (200, '{"result":"ok"}', 50)
    assert len({(fix.agent, fix.time) for fix in fixes}) == 50


@pytest.mark.parametrize(
    ("path", "body", "expected"),
    [
        ("/owntracks", b"", "[]"),
        ("/owntracks", b"{", "[]"),
        ("/owntracks", b'{"_type":"lwt","tst":1}', "[]"),
        ("/owntracks/x", json.dumps(bodies.owntracks(lat=None)).encode(), "[]"),
        ("/owntracks", b"[" * 100_000, "[]"),
        ("/overland", b'{"locations": 7}', '{"result":"ok"}'),
        ("/overland", b'{"locations": []}', '{"result":"ok"}'),
        ("/traccar", b"\xff\xfe", "{}"),
        ("/osmand?id=x&lat=no&lon=1", None, "OK"),
        ("/osmand?lat=1&lon=1", None, "OK"),
        ("/osmand?id=x&lat=0&lon=0&timestamp=1795000000", None, "OK"),
        ("/gpslogger?" + "&" * 300, None, "OK"),
        (f"/gpslogger/{quote('a' * 200)}?lat=1&lon=1", None, "OK"),
        ("/", None, "[]"),
        ("/favicon.ico", None, "[]"),
        ("/", b"hello", "[]"),
        ("/", b"time,lat\n1,2", "[]"),
    ],
)
def test_what_cannot_be_used_gets_the_same_answer(send, server, path, body, expected):
    before = len(stored(server[1]))
    assert send(path, body)[0] == (200, expected)
    assert len(stored(server[1])) == before


def test_bodies_and_queries_are_limited(server):
    listener, _, _ = server
    assert request(listener.port, "/owntracks", b" " * (2 << 20))[0] == 200
    assert request(listener.port, "/owntracks", b" " * ((2 << 20) + 1))[0] == 413
    chunks = iter([b" " * (1 << 20)] * 3)
    assert request(listener.port, "/owntracks", chunks, transfer_encoding="chunked")[0] == 413
    assert request(listener.port, "/osmand?id=" + "x" * 9_000)[0] == 413
    assert request(listener.port, "/osmand", method="DELETE")[0] == 405


def test_a_request_that_does_not_come_ends_its_connection(monkeypatch):
    monkeypatch.setattr("gpszip.live.serving._HEAD_SECONDS", 0.1)
    monkeypatch.setattr("gpszip.live.serving._IDLE_SECONDS", 0.1)

    async def ask(data):
        source = http.HttpSource("127.0.0.1", 0, Notices(print))
        serving = asyncio.create_task(source.run(None))
        reader, writer = await asyncio.open_connection(*source.address.split(":"))
        writer.write(data)
        try:
            async with asyncio.timeout(30):
                return await reader.read()
        finally:
            writer.close()
            serving.cancel()
            await asyncio.wait([serving])

    assert asyncio.run(ask(b"")) == b""
    assert asyncio.run(ask(b"GET /health HTTP/1.1\r\nHost:")) == b""
    whole = b"GET /health HTTP/1.1\r\nHost: a\r\n\r\n"
    assert asyncio.run(ask(whole + b"GET")).startswith(b"HTTP/1.1 200")


def test_a_sender_that_goes_away_is_no_fault(server):
    listener, _, _ = server
    with socket.create_connection(("127.0.0.1", listener.port)) as connection:
        connection.sendall(b"POST /owntracks HTTP/1.1\r\nHost: x\r\nContent-Length: 99\r\n\r\n{")
    assert request(listener.port, "/health")[0] == 200


def test_health_and_what_was_told(server):
    listener, folder, _ = server
    null = bodies.owntracks(topic="owntracks/null/phone", lat=0, lon=0)
    for body in (bodies.owntracks(topic="owntracks/twice/phone"),) * 2 + (null,):
        assert request(listener.port, "/owntracks", body)[0] == 200
    status, text = request(listener.port, "/health")
    report = json.loads(text)
    assert status == 200
    assert report["status"] == "ok"
    assert report["counts"]["stored"] == len(stored(folder))
    assert report["counts"]["repeated fixes left out"] >= 1
    assert report["last_received"] <= time.time()
    assert any("0,0" in line for line in listener.lines)
    assert not [line for line in listener.lines if "Traceback" in line], listener.lines


def test_tokens(tmp_path):
    options = ["--http", "127.0.0.1:0", "--token", "s3cret", "--max-rate", "0.2"]
    with listening(tmp_path, *options) as listener:
        body = bodies.owntracks()
        right = base64.b64encode(b"ann:s3cret").decode()
        wrong = base64.b64encode(b"ann:secret").decode()
        for status, path, headers in [
            (401, "/owntracks", {}),
            (401, "/owntracks", {"authorization": f"Basic {wrong}"}),
            (401, "/owntracks?token=s3cre", {"authorization": "Basic ?"}),
            (200, "/owntracks", {"authorization": f"Basic {right}"}),
            (200, "/owntracks", {"authorization": "Bearer s3cret"}),
            (200, "/owntracks?token=s3cret", {}),
        ]:
            assert request(listener.port, path, body, **headers)[0] == status, path
        # Whoever proved to be somebody is that, whatever the topic says.
        assert [fix.agent for fix in stored(tmp_path)] == ["ann/phone"]
        body = bodies.owntracks(topic="owntracks/bob/phone")
        assert request(listener.port, "/owntracks", body, authorization=f"Basic {right}")[0] == 200
        assert [fix.agent for fix in stored(tmp_path)] == ["ann/phone", "ann"]
        # Two requests of each sender at once, one in five seconds; whoever has no token is none.
        path = "/owntracks?u=ann&token=s3cret"
        codes = [request(listener.port, path, body)[0] for _ in range(3)]
        assert codes == [200, 200, 429]
        assert request(listener.port, "/health")[0] == 200
        assert listener.end() == 0


def test_a_port_that_is_taken_is_an_error(tmp_path, capfd, monkeypatch):
    from gpszip.cli.main import main

    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        address = f"127.0.0.1:{other.getsockname()[1]}"
        code = main(["listen", "--journal", str(tmp_path), "--http", address])
    assert code == 2
    assert "can't listen at 127.0.0.1" in capfd.readouterr().err


def test_killed_at_any_moment_nothing_acknowledged_is_lost_and_nothing_repeats(tmp_path):
    rng = random.Random(7)
    acknowledged, sent = set(), 0
    for round in range(1, 5):
        with listening(tmp_path, "--http", "127.0.0.1:0") as listener:
            port = listener.port
            killer = kill_when(listener, lambda: sent >= 15 * round, rng.uniform(0, 0.02))  # noqa: B023
            try:
                while True:
                    # An app sends what was not acknowledged again, and goes on then.
                    body = bodies.overland(3, device_id="ann")
                    for number, feature in enumerate(body["locations"]):
                        stamp = bodies.TIME + sent + number
                        feature["properties"]["timestamp"] = stamp
                    if request(port, "/overland", body) == (200, '{"result":"ok"}'):
                        acknowledged |= {bodies.TIME + sent + number for number in range(3)}
                        sent += 3
            except (OSError, HTTPException):
                listener.process.wait()
            killer.join()
    times = [fix.time for fix in stored(tmp_path)]
    assert acknowledged <= set(times)
    assert len(times) == len(set(times))
    assert sent >= 60


def test_a_full_disk_is_an_error_to_the_sender_and_no_end(tmp_path):
    # A limit on the size of files is a full disk to whoever writes.
    code = (
        "import resource, signal, sys\n"
        "from gpszip.cli.main import main\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (600, 600))\n"
        f"sys.exit(main(['listen', '--journal', {str(tmp_path)!r}, '--http', '127.0.0.1:0']))\n"
    )
    with listening(tmp_path, program=["-c", code]) as listener:
        big, small = bodies.overland(20), bodies.overland(2)
        assert request(listener.port, "/overland", big)[0] == 503
        assert json.loads(request(listener.port, "/health")[1])["status"] != "ok"
        assert request(listener.port, "/overland", small)[0] == 200
        assert json.loads(request(listener.port, "/health")[1])["status"] == "ok"
        assert len(stored(tmp_path)) == 2
        assert any("not stored" in line for line in listener.lines)
        assert listener.end() == 0


@contextlib.contextmanager
def serving(**options):
    """A server in this process, in a loop of its own; yields its port and what it takes."""
    taken = Taken()
    source = http.HttpSource("127.0.0.1", 0, taken.notices, **options)
    loop = asyncio.new_event_loop()
    task = loop.create_task(source.run(taken))
    thread = threading.Thread(target=loop.run_until_complete, args=(asyncio.wait([task]),))
    thread.start()
    try:
        yield int(source.address.rpartition(":")[2]), taken
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join(30)
        loop.close()


def test_who_comes_too_fast_is_told_when_to_come_again(monkeypatch):
    # Five requests at once, and another one after 100 seconds, which no machine takes for them.
    monkeypatch.setattr("gpszip.live.sources.rates._BURST_SECONDS", 500.0)
    with serving(max_rate=0.01) as (port, taken):
        connection = HTTPConnection("127.0.0.1", port, timeout=120)

        def ask(name, number):
            place = f"lat={48 + number / 1e4}&lon=11.5&timestamp={bodies.TIME + number}"
            connection.request("GET", f"/osmand?id={name}&{place}")
            answer = connection.getresponse()
            answer.read()
            return answer

        # Others are not held up, and what was acknowledged is there.
        answers = [ask("ann", number) for number in range(6)]
        assert [answer.status for answer in answers] == [200] * 5 + [429]
        assert 50 <= int(answers[-1].getheader("Retry-After")) <= 100
        assert ask("bob", 0).status == 200
        # Behind a proxy of this machine, an address is that of the sender.
        path = f"/osmand?id=ann&lat=1&lon=1&timestamp={bodies.TIME}"
        assert request(port, path, x_forwarded_for="192.0.2.7")[0] == 200
        assert [fix.agent for fix in taken.fixes] == ["ann"] * 5 + ["bob", "ann"]
        assert "127.0.0.1: requests that came too fast refused for a while" in taken.lines
        # Monitors are no senders.
        assert all(request(port, "/health")[0] == 200 for _ in range(9))
        connection.close()


def test_other_machines_cannot_write_their_address(monkeypatch):
    # 127.0.0.2 stands for another machine, whatever the environment says of proxies.
    monkeypatch.setenv("FORWARDED_ALLOW_IPS", "*")
    with serving(max_rate=0.001) as (port, taken):
        statuses = []
        for number in range(3):
            other = HTTPConnection("127.0.0.1", port, 30, source_address=("127.0.0.2", 0))
            path = f"/osmand?id=ann&lat=1&lon=1&timestamp={bodies.TIME + number}"
            other.request("GET", path, headers={"X-Forwarded-For": f"192.0.2.{number}"})
            statuses.append(other.getresponse().status)
            other.close()
        assert statuses == [200, 429, 429]
        assert "127.0.0.2: requests that came too fast refused for a while" in taken.lines


def day(rows):
    """A table of a day as curl sends it, of 100 bytes a row."""
    lines = [
        f"{bodies.TIME + t},{48 + t / 1e6:.6f},11.5,519,12,270,5.0,9,gps,{'-' * 40}"
        for t in range(rows)
    ]
    return "\n".join(
        ["time,lat,lon,elevation,accuracy,bearing,speed,satellites,provider,x", *lines]
    )


def test_tables_may_be_larger_than_other_bodies(monkeypatch):
    # Limits of a hundredth, so that this takes no time.
    monkeypatch.setattr(http, "_MAX_BODY_BYTES", 20_000)
    monkeypatch.setattr(http, "_MAX_TABLE_BYTES", 200_000)
    table = day(600).encode()
    assert len(table) > 40_000
    with serving() as (port, taken):
        assert request(port, "/gpslogger/ann", table) == (200, "OK")
        assert [fix.time for fix in taken.fixes] == [bodies.TIME + t for t in range(600)]
        assert {(fix.agent, fix.accuracy, fix.speed) for fix in taken.fixes} == {("ann", 12, 5)}
        # In parts of any size, without a length.
        taken.fixes.clear()
        parts = iter([table[at : at + 7_001] for at in range(0, len(table), 7_001)])
        chunked = request(port, "/ann", parts, transfer_encoding="chunked")
        assert (chunked, len(taken.fixes)) == ((200, "[]"), 600)
        # A text with commas is no table; neither is anything else so large.
        assert request(port, "/gpslogger/ann", b"a,b\n" * 9_000) == (200, "OK")
        assert request(port, "/gpslogger/ann", b"{" + table)[0] == 413
        assert request(port, "/gpslogger/ann", b"x" * 30_000)[0] == 413
        form = {"content_type": "application/x-www-form-urlencoded"}
        assert request(port, "/gpslogger/ann", table, **form)[0] == 413
        assert request(port, "/gpslogger/ann", table * 5)[0] == 413
        # A disk that is full is told before the end; what is sent again is a repeat.
        taken.full = 1
        assert request(port, "/gpslogger/ann", table)[0] == 503


def test_replay_waits_when_it_is_too_fast(tmp_path, capfd):
    from gpszip.cli.main import main

    rows = [f"ann,{bodies.TIME + t},{48 + t / 1e4},11.5" for t in range(12)]
    (tmp_path / "log.csv").write_text("\n".join(["id,t,lat,lon", *rows]))
    with serving(max_rate=1.0) as (port, taken):
        words = ["--as", "osmand", "--to", f"http://127.0.0.1:{port}/osmand", "--speed", "inf"]
        assert main(["replay", str(tmp_path / "log.csv"), *words]) == 0
    assert "answers 429 Too Many Requests; trying again" in capfd.readouterr().err
    assert [fix.time for fix in taken.fixes] == [bodies.TIME + t for t in range(12)]


def test_encrypted_messages_of_owntracks():
    keys = pytest.importorskip("nacl") and OwnTracksKeys(["s3cret"], "keys")
    sealed = seal(bodies.owntracks(topic="owntracks/eve/phone"))
    with serving(unseal=keys.open) as (port, taken):
        assert request(port, "/owntracks?u=ann", sealed) == (200, "[]")
        assert request(port, "/", sealed) == (200, "[]")
    assert [fix.agent for fix in taken.fixes] == ["ann", "eve/phone"]
    assert {(fix.time, fix.source) for fix in taken.fixes} == {(bodies.TIME, "owntracks")}


def test_the_rate_of_the_command_is_that_of_the_server():
    from gpszip.cli.listen import command

    (option,) = (each for each in command.params if each.name == "max_rate")
    assert option.default == http.MAX_RATE
