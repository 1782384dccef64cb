"""Events on disk, and on their way to sinks."""

import asyncio
import http.server
import json
import threading
from contextlib import contextmanager
from urllib.parse import urlsplit

import pytest

from gpszip.errors import OptionError, OutputError
from gpszip.live import Notices
from gpszip.live.events import Event
from gpszip.live.outbox import Outbox
from gpszip.live.sinks.file import FileSink
from gpszip.live.sinks.mqtt import MqttSink
from gpszip.live.sinks.open import open_sink
from gpszip.live.sinks.webhook import WebhookSink, sign
from live.servers import broker, find_program


def event(number, agent="bus"):
    return Event("silent", f"{number:016x}", agent, 1.7e9 + number, 1.7e9 + number)


class Taking:
    """A sink that fails as often as it is told, and keeps the rest."""

    def __init__(self, failures=0, refusals=0):
        self.taken, self.failures, self.refusals = [], failures, refusals

    async def send(self, events):
        if self.failures:
            self.failures -= 1
            raise OSError("not now")
        if self.refusals:
            self.refusals -= 1
            raise OutputError("never")
        self.taken += [(each.seq, each.id) for each in events]


def deliver(folder, sinks, events, *, notices=None, checkpoint=False):
    """Put events into an outbox, and wait until they are sent."""

    async def run():
        outbox = Outbox(folder, sinks, notices or Notices(print))
        sending = outbox.start()
        for each in events:
            await outbox.put([each])
        await outbox.finish()
        if checkpoint:
            outbox.checkpoint()
        for task in sending:
            task.cancel()
        await outbox.close()

    asyncio.run(run())


def test_events_are_numbered_and_known_again(tmp_path):
    sink = Taking()
    deliver(tmp_path, {"a": sink}, [event(1), event(2), event(1)])
    assert [seq for seq, _ in sink.taken] == [1, 2]

    # The monitor finds them again after it was killed; a second sink gets what is still there.
    later, other = Taking(), Taking()
    deliver(tmp_path, {"a": later, "b": other}, [event(1), event(2), event(3)], checkpoint=True)
    assert later.taken == [(3, event(3).id)]
    assert [seq for seq, _ in other.taken] == [1, 2, 3]

    # Numbers go on when all are forgotten.
    last = Taking()
    deliver(tmp_path, {"a": last}, [event(4)])
    assert last.taken == [(4, event(4).id)]


def test_a_sink_that_fails_gets_all_events_later_and_one_that_refuses_is_passed_over(tmp_path):
    notices = Notices(lambda _: None)
    failing, refusing = Taking(failures=1), Taking(refusals=1)
    events = [event(number) for number in range(5)]
    deliver(tmp_path, {"a": failing, "b": refusing}, events, notices=notices)
    assert [seq for seq, _ in failing.taken] == [1, 2, 3, 4, 5]
    assert notices.counts["events not sent yet"] == 1
    left_out = notices.counts["events left out, as they were refused"]
    assert len(refusing.taken) == 5 - left_out < 5


def test_who_refuses_is_named_without_what_may_be_secret(tmp_path):
    told = []
    sinks = {name: Taking(refusals=1) for name in ("-", "a.ndjson", "https://u:p@h:8/token?key=k")}
    deliver(tmp_path, sinks, [event(1)], notices=Notices(told.append))
    names = ("standard output", "a.ndjson", "https://h:8")
    assert sorted(told) == sorted(f"{name}: events refused (never)" for name in names)


def test_a_line_that_was_cut_off_is_no_event(tmp_path):
    deliver(tmp_path, {"a": Taking()}, [event(1)])
    with (tmp_path / "events").open("ab") as file:
        file.write(b'{"kind":"sil')
    sink = Taking()
    deliver(tmp_path, {"a": sink}, [event(1), event(2)])
    assert [seq for seq, _ in sink.taken] == [2]


def test_a_file_has_each_event_once(tmp_path):
    path = tmp_path / "events.ndjson"

    async def send(events):
        sink = FileSink(path)
        await sink.send(events)
        await sink.close()

    asyncio.run(send([event(1), event(2)]))
    with path.open("ab") as file:
        file.write(b'{"kind":"sil')
    asyncio.run(send([event(2), event(3)]))
    lines = [json.loads(line)["id"] for line in path.read_text().splitlines()]
    assert lines == [event(number).id for number in (1, 2, 3)]


def test_a_file_of_another_kind_is_left_as_it_is(tmp_path):
    path = tmp_path / "walk.csv"
    path.write_text("t,lat,lon\n1,2")
    with pytest.raises(OutputError, match="holds something else than events"):
        FileSink(path)
    assert path.read_text() == "t,lat,lon\n1,2"


@contextmanager
def webhook(answers):
    """A server that gives these answers, one by one; yields its address and what came."""
    requests = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            requests.append((self.path, dict(self.headers), body))
            self.send_response(answers.pop(0))
            self.end_headers()

        def log_message(self, *_words):
            pass

    server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/in?of=me", requests
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_a_webhook_gets_signed_lines_until_it_takes_them(tmp_path):
    with webhook([503, 204]) as (url, requests):
        sink = WebhookSink(urlsplit(url), "secret")
        deliver(tmp_path, {"a": sink}, [event(1, "b\x1b\u2028us")])
    (path, headers, body), (_, _, again) = requests
    assert (path, body) == ("/in?of=me", again)
    assert Event.from_json(body).agent == "b\x1b\u2028us"
    stamp, signature = headers["X-GPSZip-Signature"].removeprefix("t=").split(",v1=")
    assert signature == sign("secret", stamp, body)
    assert headers["X-GPSZip-Seq"] == "1"


def test_a_webhook_that_refuses_is_told(tmp_path):
    notices = Notices(lambda _: None)
    with webhook([403]) as (url, _):
        deliver(tmp_path, {"a": open_sink(url)}, [event(1)], notices=notices)
    assert notices.counts["events left out, as they were refused"] == 1


@pytest.mark.skipif(find_program("mosquitto") is None, reason="needs mosquitto")
def test_a_broker_gets_a_message_for_each_event(tmp_path):
    mqtt = pytest.importorskip("paho.mqtt.client")
    with broker(tmp_path) as port:
        come, subscribed = [], threading.Event()
        client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        client.on_subscribe = lambda *_: subscribed.set()
        client.on_message = lambda _client, _data, message: come.append(message)
        client.connect("127.0.0.1", port)
        client.subscribe("yard/#", qos=1)
        client.loop_start()
        assert subscribed.wait(30)
        sink = MqttSink(f"mqtt://127.0.0.1:{port}/yard")
        deliver(tmp_path, {"a": sink}, [event(1, "ann/ph+ne"), event(2)])
        client.disconnect()
        client.loop_stop()
    assert [message.topic for message in come] == ["yard/ann-ph-ne/silent", "yard/bus/silent"]
    assert [Event.from_json(message.payload).id for message in come] == [event(1).id, event(2).id]


@pytest.mark.parametrize("text", ["ftp://host/", "http://", "mqtt://"])
def test_addresses_that_are_none_are_refused(text):
    with pytest.raises(OptionError):
        open_sink(text)
