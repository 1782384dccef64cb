"""Receivers: gpsd with gpsfake, and NMEA over TCP, over UDP and from files."""

import json
import os
import socket
import threading

import pytest

from gpszip.cli.main import main
from gpszip.live.replay.messages import Sample, nmea_sentences
from live import bodies
from live.running import listening, stored
from live.servers import find_program, free_port, running, wait_until

SAMPLES = [Sample("boat", bodies.TIME + t, 48 + t / 1e4, 11.5) for t in range(20)]


def log(folder):
    path = folder / "boat.nmea"
    path.write_bytes(b"".join(map(nmea_sentences, SAMPLES)))
    return path


def check(fixes, agent):
    assert [fix.time for fix in fixes] == [sample.time for sample in SAMPLES]
    for fix, sample in zip(fixes, SAMPLES, strict=True):
        assert fix.position == pytest.approx((sample.latitude, sample.longitude), abs=1e-8)
        assert fix.agent == agent


@pytest.mark.skipif(
    find_program("gpsfake") is None or find_program("gpsd") is None,
    reason="needs gpsd and gpsd-clients",
)
def test_gpsd(tmp_path):
    port = free_port()
    journal = tmp_path / "journal"
    with listening(journal, "--gpsd", f"127.0.0.1:{port}", "--name", "boat") as listener:
        # gpsd is off at first.
        assert wait_until(lambda: any("can't be reached" in line for line in listener.lines))
        # It plays the log again and again: repeats are left out.
        fake = [find_program("gpsfake"), "-q", "-c", "0.05", "-P", port, log(tmp_path)]
        with running(*fake):
            assert wait_until(lambda: len(stored(journal)) >= 15)
        assert listener.end() == 0
    # Where it begins anew, gpsd has a position before it has a time.
    fixes = [fix for fix in stored(journal) if not fix.quality.startswith("arrival")]
    by_time = {sample.time: sample for sample in SAMPLES}
    assert len({fix.time for fix in fixes}) == len(fixes)
    for fix in fixes:
        assert (fix.agent, fix.kind) == ("boat", "TPV")
        assert fix.position == pytest.approx((by_time[fix.time].latitude, 11.5), abs=1e-8)


def test_a_server_that_speaks_as_gpsd_and_goes_away(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        asked = []

        def serve():
            for number in range(2):
                connection, _ = server.accept()
                with connection:
                    asked.append(connection.recv(100))
                    report = {"class": "TPV", "mode": 3, "lat": 48 + number, "lon": 11.5}
                    report["time"] = bodies.TIME + number
                    lines = ['{"class":"VERSION"}', "{cut", "7", "", json.dumps(report), ""]
                    connection.sendall("\r\n".join(lines).encode())

        thread = threading.Thread(target=serve)
        thread.start()
        with listening(tmp_path, "--gpsd", f"127.0.0.1:{port}") as listener:
            assert wait_until(lambda: len(stored(tmp_path)) == 2)
            thread.join()
            assert listener.end() == 0
    assert asked == [b'?WATCH={"enable":true,"json":true}\n'] * 2
    assert [fix.position for fix in stored(tmp_path)] == [(48, 11.5), (49, 11.5)]
    assert any("connected again" in line for line in listener.lines)


def test_nmea_over_tcp(tmp_path):
    port = free_port()
    path = log(tmp_path)
    words = ["--as", "nmea", "--to", f"tcp://127.0.0.1:{port}", "--speed", "inf", "--quiet"]
    sender = threading.Thread(target=main, args=(["replay", str(path), *words],))
    sender.start()
    journal = tmp_path / "journal"
    with listening(journal, "--nmea", f"tcp://127.0.0.1:{port}", "--name", "boat") as listener:
        assert wait_until(lambda: len(stored(journal)) == len(SAMPLES))
        sender.join()
        assert listener.end() == 0
    check(stored(journal), "boat")


def test_nmea_over_udp(tmp_path):
    port = free_port()
    path = log(tmp_path)
    journal = tmp_path / "journal"
    with listening(journal, "--nmea", f"udp://127.0.0.1:{port}") as listener:
        # Datagrams are lost until somebody listens; what was stored already is left out.
        words = ["--as", "nmea", "--to", f"udp://127.0.0.1:{port}", "--speed", "inf", "--quiet"]

        def send():
            assert main(["replay", str(path), *words]) == 0
            return len(stored(journal)) == len(SAMPLES)

        assert wait_until(send)
        assert listener.end() == 0
    check(sorted(stored(journal), key=lambda fix: fix.time), "127.0.0.1")


def test_nmea_from_a_file(tmp_path, capfd):
    path = log(tmp_path)
    journal = tmp_path / "journal"
    assert main(["listen", "--journal", str(journal), "--nmea", str(path)]) == 0
    assert "20 fixes stored" in capfd.readouterr().err
    check(stored(journal), "boat.nmea")


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo-terminals")
def test_nmea_from_a_serial_device(tmp_path):
    master, slave = os.openpty()
    with listening(tmp_path, "--nmea", os.ttyname(slave), "--name", "boat") as listener:
        for sample in SAMPLES:
            os.write(master, nmea_sentences(sample))
        assert wait_until(lambda: len(stored(tmp_path)) == len(SAMPLES))
        os.close(slave)
        os.close(master)
        assert listener.process.wait(60) == 0
        assert wait_until(lambda: "boat: the device is gone" in listener.lines), listener.lines
    check(stored(tmp_path), "boat")


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--nmea", "none.nmea"], 1, "can't be opened"),
        (["--nmea", "http://a"], 2, "no such address"),
        (["--nmea", "tcp://a:b"], 2, "no such address"),
        (["--gpsd", "a:b"], 2, "give HOST:PORT"),
    ],
)
def test_mistakes(tmp_path, capfd, options, code, message):
    assert main(["listen", "--journal", str(tmp_path), *options]) == code
    assert message in capfd.readouterr().err


def test_a_port_of_udp_that_is_taken_is_an_error(tmp_path, capfd):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        address = f"udp://127.0.0.1:{other.getsockname()[1]}"
        assert main(["listen", "--journal", str(tmp_path), "--nmea", address]) == 2
    assert "can't listen at 127.0.0.1" in capfd.readouterr().err
