"""Logs that are replayed as robots, vehicles, boats and brokers have them."""

import json
import socket
import threading
from importlib.util import find_spec

import pytest
from hypothesis import given

from gpszip.cli.main import main
from gpszip.live import Notices
from gpszip.live.formats.mavlink import MavlinkParser
from gpszip.live.formats.ros import parse_ros
from gpszip.live.formats.signalk import SignalKParser
from gpszip.live.formats.text import TextParser
from gpszip.live.formats.values import Context
from gpszip.live.replay.messages import ros_message, ros_topic, row_message, signalk_delta
from live import bodies
from live.receiving import Taken, running, until
from live.receiving import run as finish
from live.replay.test_messages import samples
from live.servers import free_port

needs_websockets = pytest.mark.skipif(find_spec("websockets") is None, reason="needs gpszip[live]")
needs_pymavlink = pytest.mark.skipif(find_spec("pymavlink") is None, reason="needs gpszip[mavlink]")
needs_kafka = pytest.mark.skipif(
    find_spec("aiokafka") is None or find_spec("confluent_kafka") is None,
    reason="needs gpszip[kafka] and confluent-kafka",
)

COUNT = 12


@pytest.fixture
def log(tmp_path):
    """A log of two tracks that end at one time, and the times of each."""
    rows = [
        f"{name},{bodies.TIME + t / 2},{48 + t / 1e4:.4f},{11.5 + track}"
        for t in range(COUNT)
        for track, name in enumerate(["a", "b c"])
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["id,time,lat,lon", *rows]))
    return path


def replay(log, kind, target):
    """A thread that replays a log; its code comes at the end."""
    codes = []
    words = ["replay", str(log), "--as", kind, "--to", target, "--speed", "inf", "--quiet"]
    thread = threading.Thread(target=lambda: codes.append(main(words)))
    thread.start()
    return thread, codes


def listen(source, log, kind, target, taken):
    """Run a source while a log is replayed to it; return its fixes by agent."""
    thread, codes = replay(log, kind, target)

    async def run():
        async with running(source, taken):
            await until(lambda: len(taken.fixes) >= 2 * COUNT)

    finish(run())
    thread.join(30)
    assert codes == [0]
    return {
        agent: [fix for fix in taken.fixes if fix.agent == agent]
        for agent in sorted({fix.agent for fix in taken.fixes})
    }


def check(fixes):
    """Whether the fixes of both tracks are those of the log."""
    for track, own in enumerate(fixes.values()):
        assert [fix.time for fix in own] == [bodies.TIME + t / 2 for t in range(COUNT)]
        for t, fix in enumerate(own):
            assert fix.position == pytest.approx((48 + t / 1e4, 11.5 + track), abs=1e-8)


@needs_websockets
def test_robots(log, monkeypatch):
    from gpszip.live.sources import websocket
    from gpszip.live.sources.ros import RosSource

    monkeypatch.setattr(websocket, "RETRY_SECONDS", (0.02, 0.05))
    taken, target = Taken(), f"ws://127.0.0.1:{free_port()}"
    fixes = listen(RosSource(target, (), "", taken.notices), log, "ros", target, taken)
    assert list(fixes) == ["a", "b c"]
    check(fixes)


@needs_websockets
def test_boats(log, monkeypatch):
    from gpszip.live.sources import websocket
    from gpszip.live.sources.signalk import SignalKSource

    monkeypatch.setattr(websocket, "RETRY_SECONDS", (0.02, 0.05))
    taken, target = Taken(), f"ws://127.0.0.1:{free_port()}"
    fixes = listen(SignalKSource(target, "", taken.notices), log, "signalk", target, taken)
    assert list(fixes) == ["a", "b c"]
    check(fixes)


@needs_pymavlink
def test_vehicles(log):
    from gpszip.live.sources.mavlink import Packets

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        thread, codes = replay(log, "mavlink", f"udp://127.0.0.1:{receiver.getsockname()[1]}")
        packets = Packets(MavlinkParser("van", Notices(str), local=False))
        fixes = {"van-1": [], "van-2": []}
        for _ in range(2 * COUNT):
            for fix in packets.push(receiver.recv(1000), 0.0):
                fixes[fix.agent].append(fix)
        thread.join(30)
    assert codes == [0]
    check(fixes)


@needs_pymavlink
def test_times_of_mavlink(tmp_path, capfd):
    from gpszip.live.sources.mavlink import Packets

    # Longer than a system can tell how long it has been on.
    log = tmp_path / "log.csv"
    times = [bodies.TIME + 86_400 * day for day in (0, 49, 50, 51)]
    log.write_text("\n".join(["id,time,lat,lon", *(f"a,{time},48,11" for time in times)]))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        target = f"udp://127.0.0.1:{receiver.getsockname()[1]}"
        thread, codes = replay(log, "mavlink", target)
        thread.join(30)
        packets = Packets(MavlinkParser("van", Notices(str), local=False))
        found = [fix for _ in times for fix in packets.push(receiver.recv(1000), 0.0)]
    assert (codes, [fix.time for fix in found]) == ([0], times)

    # Earlier than its clock can tell.
    log.write_text("id,time,lat,lon\na,-50,48,11\na,-40,48,11\n")
    assert main(["replay", str(log), "--as", "mavlink", "--to", target]) == 2
    assert "MAVLink has no times before 1973" in capfd.readouterr().err


@needs_kafka
def test_a_topic_of_kafka(log):
    from confluent_kafka import Consumer, Producer

    brokers = {"bootstrap.servers": "none:1", "test.mock.num.brokers": 1, "log_level": 0}
    producer = Producer(brokers)
    broker = next(iter(producer.list_topics(timeout=30).brokers.values()))
    address = f"{broker.host}:{broker.port}"
    thread, codes = replay(log, "kafka", f"{address}/places")
    thread.join(30)
    assert codes == [0]

    # Each track is in one partition, in its order.
    consumer = Consumer({"bootstrap.servers": address, "group.id": "g", "log_level": 0})
    topic = consumer.list_topics("places", timeout=30).topics["places"]
    from confluent_kafka import TopicPartition

    consumer.assign([TopicPartition("places", part, 0) for part in topic.partitions])
    fixes = {b"a": [], b"b c": []}
    while sum(map(len, fixes.values())) < 2 * COUNT:
        message = consumer.poll(30)
        (fix,) = TextParser("log").push(message.value(), Context(0.0, "kafka"))
        assert fix.agent.encode() == message.key()
        fixes[message.key()].append(fix)
    consumer.close()
    check(fixes)


@given(samples)
def test_messages_say_what_the_sample_says(sample):
    context = Context(1.8e9, "test", sample.track)
    published = json.loads(ros_message(sample))
    assert published["topic"] == ros_topic(sample.track)
    (delta,) = SignalKParser("", Notices(str)).parse(json.loads(signalk_delta(sample)), context)
    (row,) = TextParser("log").push(row_message(sample), Context(1.8e9, "test"))
    for fix in (parse_ros(published["msg"], context), delta, row):
        assert fix.time == pytest.approx(sample.time, abs=1e-6)
        assert fix.position == pytest.approx((sample.latitude, sample.longitude), abs=1e-9)
        assert fix.agent == sample.track


@pytest.mark.parametrize(
    ("kind", "target", "message"),
    [
        ("ros", "http://a:1", "give ws://HOST:PORT for ros"),
        ("signalk", "ws://a", "give ws://HOST:PORT for signalk"),
        ("mavlink", "tcp://a:1", "give udp://HOST:PORT for mavlink"),
        ("kafka", "a:1", "no such address"),
        ("mavlink", "udp://127.0.0.1:9", "MAVLink has 240 systems, and there are 241 tracks"),
    ],
)
def test_targets_that_do_not_fit(tmp_path, capfd, kind, target, message):
    if kind == "mavlink":
        pytest.importorskip("pymavlink")
    log = tmp_path / "log.csv"
    rows = [f"{n},{bodies.TIME + t},48,11" for n in range(241) for t in range(2)]
    log.write_text("\n".join(["id,time,lat,lon", *rows]))
    assert main(["replay", str(log), "--as", kind, "--to", target]) == 2
    assert message in capfd.readouterr().err
