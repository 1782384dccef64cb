"""Kafka, with the brokers that confluent-kafka has for tests."""

import json
from importlib.util import find_spec

import pytest

from gpszip.errors import OptionError
from gpszip.live import Notices
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.text import TextParser
from gpszip.live.formats.values import Context
from gpszip.live.sources import kafka, lines
from gpszip.live.sources.kafka import KafkaSource, split_address
from live import bodies
from live.bodies import TIME
from live.receiving import Taken, running, until
from live.receiving import run as finish
from live.servers import free_port

pytestmark = pytest.mark.skipif(find_spec("aiokafka") is None, reason="needs gpszip[kafka]")
needs_brokers = pytest.mark.skipif(
    find_spec("confluent_kafka") is None, reason="needs confluent-kafka"
)


@pytest.fixture(scope="module")
def cluster():
    """A producer whose process has a broker, and the broker's address."""
    from confluent_kafka import Producer

    producer = Producer({"bootstrap.servers": "none:1", "test.mock.num.brokers": 1, "log_level": 0})
    broker = next(iter(producer.list_topics(timeout=30).brokers.values()))
    return producer, f"{broker.host}:{broker.port}"


def row(seconds, **more):
    return {"t": TIME + seconds, "lat": 48 + seconds / 1e4, "lon": 11.5, **more}


def committed(address, group, topic):
    """Offsets that a group has committed, by partition."""
    from confluent_kafka import Consumer, TopicPartition

    consumer = Consumer({"bootstrap.servers": address, "group.id": group, "log_level": 0})
    parts = consumer.list_topics(topic, timeout=30).topics[topic].partitions
    found = consumer.committed([TopicPartition(topic, part) for part in parts], timeout=30)
    consumer.close()
    return sum(max(part.offset, 0) for part in found)


@needs_brokers
def test_offsets_are_committed_once_all_is_stored(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(lines, "_RETRY_SECONDS", 0.01)
    producer, address = cluster
    values = [b"", b"{", b"7", b"a,b", b'{"x": 1}', b"[" * 99, b"x" * 70_000]
    values += [json.dumps(bodies.owntracks(topic=None)), json.dumps(row(1)), json.dumps(row(1))]
    values += [json.dumps(row(2, id="bus"))]
    for value in values:
        producer.produce("places", key=b"ann", value=value)
    producer.produce("places", key=b"\xff", value=json.dumps(row(3)))
    assert producer.flush(30) == 0
    source = KafkaSource(f"{address}/places", tmp_path, "fleet", Notices(str))
    seen = []

    class Full(Taken):
        async def store(self, items):
            seen.append(committed(address, source._group, "places"))
            await super().store(items)

    taken = Full(full=1)

    async def listen():
        async with running(source, taken):
            await until(lambda: len(taken.fixes) == 5)
            await until(lambda: committed(address, source._group, "places") == 12)

    finish(listen())
    # Neither the attempt that failed nor the one that did not had committed before.
    assert seen[:2] == [0, 0]
    assert sorted(fix.agent for fix in taken.fixes) == ["ann", "ann", "ann", "bus", "fleet"]
    assert {fix.source for fix in taken.fixes} == {"kafka"}


def test_brokers_that_are_off_are_told_once(tmp_path, monkeypatch):
    monkeypatch.setattr(kafka, "_RETRY_SECONDS", (0.01, 0.02))
    taken = Taken()

    async def listen():
        address = f"127.0.0.1:{free_port()}/places"
        async with running(KafkaSource(address, tmp_path, "", taken.notices), taken):
            event = "the client of Kafka reports a problem"
            await until(lambda: taken.notices.counts[event] >= 2)

    finish(listen())
    told = [line for line in taken.lines if "brokers can't be reached" in line]
    assert len(told) == 1


@pytest.mark.parametrize(
    "address", ["", "a", "a:b/c", "/topic", "a/", "a/b c", "a,,b/c", "a/" + "x" * 250, "a/é"]
)
def test_wrong_addresses(address):
    with pytest.raises(OptionError, match="no such address"):
        split_address(address, "--kafka")


def test_right_addresses():
    assert split_address("kafka://[::1]:9,b/t.x-1", "") == (["[::1]:9", "b:9092"], "t.x-1")


def test_positions_that_traccar_forwards():
    position = {
        "deviceTime": "2026-11-18T11:06:40.000+00:00",
        "fixTime": "2026-11-18T11:06:40.000+00:00",
        "valid": True,
        "outdated": False,
        "latitude": bodies.LAT,
        "longitude": bodies.LON,
        "speed": 5 * 3600 / 1852,
        "course": 270,
        "accuracy": 12,
        "attributes": {},
    }

    def parse(device=None, **more):
        device = {"id": 1, "uniqueId": "ann"} if device is None else device
        message = json.dumps({"position": position | more, "device": device}).encode()
        return TextParser("log").push(message, Context(TIME + 3.0, "kafka"))[0]

    fix = parse()
    assert (fix.agent, fix.time, fix.position) == ("ann", TIME, (bodies.LAT, bodies.LON))
    assert (fix.accuracy, fix.heading, fix.speed) == (12, 270, pytest.approx(5.0))
    for wrong in ({"valid": False}, {"outdated": True}, {"latitude": None}, {"fixTime": "noon"}):
        assert isinstance(parse(**wrong), Unusable)
    assert isinstance(parse(device=7), Unusable)
    assert isinstance(parse(fixTime=None), Fix)
