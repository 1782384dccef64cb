"""OwnTracks over MQTT, with a real broker."""

import json
from importlib.util import find_spec

import pytest

from gpszip.cli.main import main
from gpszip.live.replay.messages import Sample
from gpszip.live.replay.targets import MqttTarget
from gpszip.live.sources.mqtt import client_for
from live import bodies
from live.formats.test_encrypted import seal
from live.running import listening, stored
from live.servers import broker, find_program, free_port, wait_until

pytestmark = [
    pytest.mark.skipif(find_spec("paho") is None, reason="needs gpszip[live]"),
    pytest.mark.skipif(find_program("mosquitto") is None, reason="needs mosquitto"),
]


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    with broker(tmp_path_factory.mktemp("broker")) as port:
        yield port


def publish(port, topic, message, retain=False):
    client, host, port = client_for(f"mqtt://127.0.0.1:{port}", "")
    client.connect(host, port)
    client.loop_start()
    data = message if isinstance(message, bytes) else json.dumps(message)
    client.publish(topic, data, qos=1, retain=retain).wait_for_publish(30)
    client.disconnect()
    client.loop_stop()


def replay(tmp_path, port, first, count, base="mine/positions"):
    rows = [f"ann,{bodies.TIME + t},{48 + t / 1e4},11.5" for t in range(first, first + count)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["id,t,lat,lon", *rows]))
    url = f"mqtt://127.0.0.1:{port}/{base}"
    words = ["--as", "owntracks", "--to", url, "--speed", "inf", "--quiet"]
    assert main(["replay", str(log), *words]) == 0


def test_nothing_is_lost_while_the_listener_is_off(port, tmp_path):
    # A position that was there before is that of a past.
    publish(port, "mine/positions/old/phone", bodies.owntracks(), retain=True)
    options = ["--mqtt", f"mqtt://127.0.0.1:{port}/mine/positions"]
    journal = tmp_path / "journal"
    is_sealed = find_spec("nacl") is not None
    if is_sealed:
        (tmp_path / "keys").write_text("other\ns3cret\n")
        options += ["--owntracks-keys", str(tmp_path / "keys")]

    def times():
        return sorted(fix.time - bodies.TIME for fix in stored(journal))

    with listening(journal, *options) as listener:
        assert wait_until(lambda: any("retained" in line for line in listener.lines))
        replay(tmp_path, port, 0, 10)
        # Other messages of OwnTracks, nonsense, and topics below are none.
        publish(port, "mine/positions/ann/phone", {"_type": "lwt", "tst": 1})
        publish(port, "mine/positions/ann/phone", b"\xff{")
        publish(port, "mine/positions/ann/phone/event", bodies.owntracks(tst=1))
        assert wait_until(lambda: any("no JSON" in line for line in listener.lines))
        assert wait_until(lambda: len(times()) == 10)
        listener.process.kill()
        listener.process.wait()

    # The broker keeps what comes meanwhile.
    replay(tmp_path, port, 10, 10)
    with listening(journal, *options) as listener:
        assert wait_until(lambda: len(times()) == 20)
        replay(tmp_path, port, 20, 4)
        last = bodies.owntracks(tst=bodies.TIME + 24, topic=None)
        publish(port, "mine/positions/replay/ann", seal(last) if is_sealed else last)
        assert wait_until(lambda: len(times()) == 25)
        assert listener.end() == 0
    assert times() == list(range(25))
    assert {(fix.agent, fix.source) for fix in stored(journal)} == {("replay/ann", "mqtt")}


def test_levels_of_topics_have_no_signs_of_their_own(port, tmp_path):
    from urllib.parse import urlsplit

    with listening(tmp_path, "--mqtt", f"mqtt://127.0.0.1:{port}/signs") as listener:
        target = MqttTarget(urlsplit(f"mqtt://127.0.0.1:{port}/signs"))
        sample = Sample("a/b+c#", float(bodies.TIME), 48.0, 11.0)
        assert wait_until(lambda: target.send([sample]) or stored(tmp_path))
        target.close()
        assert {fix.agent for fix in stored(tmp_path)} == {"replay/a-b-c-"}
        assert listener.end() == 0


def test_addresses(tmp_path, capfd):
    assert main(["listen", "--journal", str(tmp_path), "--mqtt", "http://a"]) == 2
    assert "give one such as mqtt://" in capfd.readouterr().err
    client, host, port = client_for("mqtts://ann:p%40ss@broker", "x")
    assert (host, port) == ("broker", 8883)
    assert (client.username, client.password) == ("ann", "p@ss")


def test_a_base_is_no_pattern(tmp_path, capfd):
    assert main(["listen", "--journal", str(tmp_path), "--mqtt", "mqtt://host/+/mine"]) == 2
    assert "topics begin with one base, not with +/mine" in capfd.readouterr().err


def test_a_broker_that_comes_back_is_told(tmp_path):
    port = free_port()
    with listening(tmp_path / "journal", "--mqtt", f"mqtt://127.0.0.1:{port}") as listener:
        told = ["127.0.0.1: can't be reached; will be tried again", "127.0.0.1: connected again"]
        assert wait_until(lambda: told[0] in listener.lines), listener.lines
        with broker(tmp_path, port):
            assert wait_until(lambda: told[1] in listener.lines), listener.lines
            assert listener.end() == 0
