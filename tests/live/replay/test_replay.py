"""Logs that are sent as if they came live."""

import http.server
import io
import json
import threading
import time
from contextlib import contextmanager
from importlib.util import find_spec

import pytest

from gpszip.cli.main import main
from gpszip.errors import OutputError
from gpszip.live.formats.nmea import NmeaParser
from gpszip.live.formats.values import Context
from gpszip.live.replay import play as module
from gpszip.live.replay.messages import APPS, Sample
from gpszip.live.replay.play import play
from live import bodies
from live.running import listening, stored
from live.servers import free_port

needs_server = pytest.mark.skipif(
    find_spec("starlette") is None or find_spec("uvicorn") is None, reason="needs gpszip[live]"
)


def table(name, tracks=3, count=8):
    rows = [
        f"{name}{track},{bodies.TIME + 0.5 * t:.1f},{48 + t / 1e4 + track / 10:.4f},{11.5:.4f}"
        for t in range(count)
        for track in range(tracks)
    ]
    return "\n".join(["id,time,lat,lon", *rows, ""])


def run(capfd, *words):
    code = main(["replay", *map(str, words)])
    return code, capfd.readouterr()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("replayed")
    with listening(folder, "--http", "127.0.0.1:0", "--token", "schlüssel") as listener:
        yield listener.port, folder


@needs_server
@pytest.mark.parametrize("app", APPS)
def test_a_listener_gets_what_the_log_has(server, tmp_path, capfd, app):
    port, folder = server
    (tmp_path / "log.csv").write_text(table(app))
    url = f"http://127.0.0.1:{port}/{app}"
    options = ["--as", app, "--to", url, "--speed", "inf", "--token", "schlüssel", "--json"]
    code, told = run(capfd, tmp_path / "log.csv", *options)
    report = json.loads(told.out)
    assert (code, report["tracks"], report["points"], report["repeated"]) == (0, 3, 24, 0)
    assert report["messages"] == (3 if app == "overland" else 24)

    # Each track is a sender; its samples arrive in their order.
    fixes = [fix for fix in stored(folder) if fix.agent.startswith(app)]
    for track in range(3):
        own = [fix for fix in fixes if fix.agent == f"{app}{track}"]
        assert [fix.time for fix in own] == [bodies.TIME + 0.5 * t for t in range(8)]
        for t, fix in enumerate(own):
            assert fix.position == pytest.approx((48 + t / 1e4 + track / 10, 11.5), abs=1e-8)
            assert fix.source == app


@needs_server
def test_a_wrong_token_is_an_error(server, tmp_path, capfd):
    (tmp_path / "log.csv").write_text(table("wrong", 1, 2))
    url = f"http://127.0.0.1:{server[0]}/"
    code, told = run(capfd, tmp_path / "log.csv", "--as", "osmand", "--to", url)
    assert code == 1
    assert "answers 401" in told.err
    assert "--token" in told.err


def test_nmea_goes_to_standard_output(tmp_path, capfd):
    (tmp_path / "log.csv").write_text(table("boat", 2))
    code, told = run(capfd, tmp_path / "log.csv", "--as", "nmea", "--to", "-")
    assert (code, told.out) == (2, "")
    assert "2 tracks; choose one with --track" in told.err
    code, told = run(
        capfd, tmp_path / "log.csv", "--as", "nmea", "--to", "-", "--track", "boat1", "--speed", 1e9
    )
    assert code == 0
    assert "8 points of 1 track sent in 8 messages" in told.err
    parser, fixes = NmeaParser("boat"), []
    for line in told.out.encode().splitlines():
        fixes += parser.push(line, Context(0.0, "test"))
    fixes += parser.finish(Context(0.0, "test"))
    assert [fix.time for fix in fixes] == [bodies.TIME + 0.5 * t for t in range(8)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--as", "osmand", "--to", "udp://a:1"], "give http://HOST:PORT for osmand"),
        (["--as", "nmea", "--to", "http://a:1"], "give udp://HOST:PORT"),
        (["--as", "nmea", "--to", "udp://a:b"], "give udp://HOST:PORT"),
        (["--as", "nmea", "--to", "tcp://a"], "give udp://HOST:PORT"),
        (["--as", "osmand", "--to", "http://a:99999"], "give http://HOST:PORT"),
        (["--as", "osmand", "--to", "http://["], "give http://HOST:PORT"),
        (["--as", "osmand", "--to", "http://a..b"], "give http://HOST:PORT"),
        (["--as", "osmand", "--to", "http://a", "--speed", "nan"], "--speed nan"),
        (["--as", "osmand", "--to", "http://a", "--token", "a\nb"], "a token has letters"),
        (["--as", "nmea", "--to", "-", "--token", "a"], "--token is for http:// and https://"),
        (["--as", "morse", "--to", "-"], "morse"),
    ],
)
def test_mistakes(tmp_path, capfd, options, message):
    (tmp_path / "log.csv").write_text(table("a"))
    code, told = run(capfd, tmp_path / "log.csv", *options)
    assert code == 2
    assert message in told.err


def test_logs_that_apps_cannot_send_are_refused(tmp_path, capfd):
    (tmp_path / "metres.csv").write_text("t,x,y\n1,2,3\n2,3,4\n")
    code, told = run(capfd, tmp_path / "metres.csv", "--as", "osmand", "--to", "http://127.0.0.1:9")
    assert code == 2
    assert "not in latitude and longitude" in told.err


# Sending.


class Recorder:
    """A target that keeps what it gets, and fails where it is told to."""

    def __init__(self, got, failures=0, max_samples=1):
        self.got, self.failures, self.max_samples = got, failures, max_samples

    def send(self, samples):
        if self.failures:
            self.failures -= 1
            raise OSError("gone")
        self.got.append((time.monotonic(), list(samples)))

    def close(self):
        self.got.append(None)


SAMPLES = [Sample("ab"[n % 2], n / 10, 48.0, 11.0) for n in range(10)]


def test_nothing_is_sent_before_it_is_due():
    got = []
    begin = time.monotonic()
    played = play(SAMPLES, lambda: Recorder(got), speed=2.0)
    sent = [each for each in got if each]
    assert [sample for _, batch in sent for sample in batch] == SAMPLES
    assert all(when - begin >= batch[0].time / 2 for when, batch in sent)
    assert (played.samples, played.messages, played.repeated) == (10, 10, 0)


def test_messages_hold_what_is_due_at_about_the_same_time():
    got = []
    play(SAMPLES, lambda: Recorder(got, max_samples=4), speed=float("inf"))
    assert [len(each[1]) for each in got if each] == [4, 4, 2]
    got.clear()
    # 0.45 s of the log are 0.9 s.
    play(SAMPLES, lambda: Recorder(got, max_samples=99), speed=1.0)
    assert [len(each[1]) for each in got if each] == [6, 4]


def test_tracks_have_connections_of_their_own():
    got = []
    play(SAMPLES, lambda: Recorder(got), float("inf"), workers=9)
    assert got.count(None) == 2
    for track in "ab":
        own = [batch[0] for _, batch in filter(None, got) if batch[0].track == track]
        assert own == [sample for sample in SAMPLES if sample.track == track]


def test_what_did_not_arrive_is_sent_again(monkeypatch):
    monkeypatch.setattr(module, "_RETRY_SECONDS", (0.001, 0.002))
    got = []
    told = []
    target = Recorder(got, failures=2)
    played = play(SAMPLES[:3], lambda: target, float("inf"), tell=told.append)
    assert told == ["gone; trying again"]
    assert [batch[0] for _, batch in filter(None, got)] == SAMPLES[:3]
    assert (played.messages, played.repeated) == (3, 2)
    with pytest.raises(OutputError, match="can't be reached: gone"):
        play(SAMPLES[:3], lambda: Recorder(got, failures=999), float("inf"), workers=2)


@contextmanager
def serving(codes):
    """A server that answers with these codes in turn."""
    paths = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            paths.append(self.path)
            self.send_response(codes.pop(0))
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}", paths
        server.shutdown()
        thread.join()


def test_errors_of_a_server_are_waited_for(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(module, "_RETRY_SECONDS", (0.001, 0.002))
    (tmp_path / "log.csv").write_text(table("a", 1, 2))
    with serving([503, 200, 500, 200]) as (url, paths):
        options = ["--as", "osmand", "--to", f"{url}/my in?key=ö", "--speed", "inf"]
        code, told = run(capfd, tmp_path / "log.csv", *options)
    assert code == 0
    assert "2 messages; 2 of them again" in told.err
    assert told.err.count("answers 503 Service Unavailable; trying again") == 1
    assert len(paths) == 4
    assert paths[0] == paths[1]
    assert paths[0].startswith("/my%20in?key=%C3%B6&id=a0&lat=48.0&")


def test_passwords_are_not_shown(tmp_path, capfd):
    pytest.importorskip("paho.mqtt")
    (tmp_path / "log.csv").write_text(table("a", 1, 2))
    url = f"ann:s3cret@127.0.0.1:{free_port()}/base"
    code, told = run(capfd, tmp_path / "log.csv", "--as", "owntracks", "--to", f"mqtt://{url}")
    assert code == 1
    assert "can't be reached" in told.err
    assert "s3cret" not in told.err


def test_a_stream_that_ends_is_an_error():
    from gpszip.live.replay.targets import StreamTarget

    class Full(io.RawIOBase):
        def writable(self):
            return True

        def write(self, data):
            raise OSError(28, "No space left")

    target = StreamTarget(Full())
    with pytest.raises(OutputError, match="No space left"):
        target.send(SAMPLES[:1] and [Sample("a", 1.7e9, 1.0, 2.0)])
