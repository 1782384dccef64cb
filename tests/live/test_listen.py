"""The command gpszip listen as a user runs it."""

import asyncio
import contextlib
import errno
import io
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from http.client import HTTPException
from importlib.util import find_spec

import numpy as np
import pytest

import gpszip
from gpszip.cli.main import main
from gpszip.live import Fix, Journal, Notices
from gpszip.live.events import Event, standing
from gpszip.live.journal import segments
from gpszip.live.listen import Rolling
from live import bodies
from live.page.running import Stream
from live.receiving import until
from live.running import kill_when, listening, request, stored
from live.servers import free_port, wait_until

needs_server = pytest.mark.skipif(
    find_spec("starlette") is None or find_spec("uvicorn") is None, reason="needs gpszip[live]"
)


@pytest.fixture
def listen(tmp_path, capfd):
    """Run the command in this process, with a text as standard input."""

    def call(text, *options):
        read, write = os.pipe()
        saved = os.dup(0)
        os.dup2(read, 0)
        os.close(read)
        writer = threading.Thread(target=_write, args=(write, text.encode()))
        writer.start()
        try:
            code = main(["listen", "--journal", str(tmp_path / "journal"), *map(str, options)])
        finally:
            os.dup2(saved, 0)
            os.close(saved)
            writer.join()
        return code, capfd.readouterr()

    return call


def _write(descriptor, data):
    with io.FileIO(descriptor, "w") as pipe, contextlib.suppress(BrokenPipeError):
        pipe.write(data)


def table(first, count, agent="ann"):
    rows = [f"{agent},{bodies.TIME + t},{48 + t / 1e4},{11.5}" for t in range(first, first + count)]
    return "\n".join(["id,time,lat,lon", *rows, ""])


def test_standard_input_goes_to_the_journal_and_to_the_archive(listen, tmp_path):
    archive = tmp_path / "a.gpsz"
    to_archive = ["--archive", archive, "--max-error", "5m", "--effort", "1"]
    code, told = listen(table(0, 50) + "ann,x,1,1\n", *to_archive)
    assert code == 0
    assert told.out == ""
    assert "ann: rows without a readable time left out (x)" in told.err
    assert "50 fixes stored" in told.err
    assert "a.gpsz: 50 fixes appended; 1 segment of the journal deleted" in told.err

    # Later ones are appended; the summary is JSON where that is asked for.
    code, told = listen(table(40, 60), *to_archive, "--json")
    report = json.loads(told.out)
    assert (code, told.err) == (0, "")
    assert (report["stored"], report["archived"]["known"]) == (60, 10)
    found = gpszip.open(archive).position("ann", bodies.TIME + np.arange(100.0))
    assert np.abs(found[:, 0] - (48 + np.arange(100) / 1e4)).max() < 5.01 / 111_000


def test_lines_that_wait_for_others_are_stored_before_the_end(tmp_path):
    # A receiver that goes on without another sentence for a while.
    with listening(tmp_path, "--name", "boat", stdin=subprocess.PIPE) as listener:
        line = "$GPRMC,110640,A,4808.0,N,01134.0,E,9.719,270,181126,,\n"
        listener.process.stdin.write(line)
        listener.process.stdin.flush()
        deadline = time.monotonic() + 60
        while not stored(tmp_path) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert [(fix.agent, fix.time) for fix in stored(tmp_path)] == [("boat", bodies.TIME)]
        assert listener.end(signal.SIGTERM) == 0
        listener.process.stdin.close()


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--roll", "1h"], 2, "--roll needs --archive"),
        (["--rmse", "5m"], 2, "--rmse needs --archive"),
        (["--archive", "a.gpsz"], 2, "a new archive needs a bound"),
        (["--timezone", "Mars"], 2, "no such zone"),
        (["--http", "host:port"], 2, "give HOST:PORT"),
        (["--http", "0", "--token", ""], 2, "a token has letters"),
        (["--http", "0", "--token", "a\n"], 2, "a token has letters"),
        (["--nmea", "."], 1, "is a folder"),
        (["--topic", "/odom"], 2, "--topic needs --ros"),
        (["--max-rate", "0"], 2, "not in the range x>0"),
        (["--max-rate", "nan"], 2, "nan is no number of requests"),
        (["-o", ""], 2, "no address of events"),
        (["--http", "0", "--owntracks-keys", "none"], 1, "can't be read"),
        (["--owntracks-keys", "none"], 2, "--owntracks-keys needs --http or --mqtt"),
        (["--token", "a"], 2, "--token needs --http or --page"),
        (["--max-rate", "9", "--page", "0"], 2, "--max-rate needs --http"),
        (["--delay", "1s"], 2, "--delay needs --output or --page"),
        (["--silent-after", "1h", "--http", "0"], 2, "--silent-after needs --output or --page"),
        (["-o", "a", "--archive", "a", "--rmse", "5m"], 2, "that is the archive"),
        (["--effort", "5"], 2, "--effort needs --archive"),
        (["--sign", "k", "-o", "mqtt://a"], 2, "--sign needs -o with a webhook"),
        (["--columns", "t=a", "--gpsd", "a"], 2, "--columns needs --stdin"),
        (["--roll-now", "--archive", "a", "--http", "0"], 2, "leave out --http"),
        (["--name", "x" * 91], 2, "give at most 90 letters"),
        (["--name", "a\nb"], 2, "give at most 90 letters"),
        (["--columns", "t,x,y"], 2, "name columns of the header"),
        (["--archive", "none/a.gpsz", "--rmse", "5m"], 1, "no such folder"),
    ],
)
def test_mistakes_are_told_before_anything_is_opened(listen, tmp_path, options, code, message):
    found, told = listen("", *options)
    assert (found, segments(tmp_path / "journal")) == (code, [])
    assert message in told.err


def test_a_table_without_positions_is_an_error(listen):
    code, told = listen("hello,world\n1,2\n")
    assert code == 1
    assert "standard input: " in told.err
    # Nor are there times without a column of them, for which compress has --no-times.
    code, told = listen("id,lat,lon\nann,48,11\n")
    assert (code, "no column of times" in told.err, "--no-times" in told.err) == (1, True, False)


def walk(first, count):
    """Rows of someone who stays, and leaves again and again."""
    times = range(first, first + count)
    places = [48 + max(0, t % 60 - 20) * 1e-3 for t in times]
    rows = [f"ann,{bodies.TIME + 60 * t},{x},11.5" for t, x in zip(times, places, strict=True)]
    return "\n".join(["id,time,lat,lon", *rows, ""])


def expected_events(folder):
    """Ids of the events that stand in the end, had nothing been interrupted."""
    monitor = gpszip.Monitor()
    found = [event for fix in stored(folder) for event in monitor.push(fix)]
    return {event.id for event in standing(found + monitor.close())}


def test_events_are_written_once_and_go_on_after_a_restart(listen, tmp_path):
    events = tmp_path / "events.ndjson"
    code, told = listen(walk(0, 100), "-o", events, "-o", "-")
    assert code == 0, told.err
    assert told.out == events.read_text()
    assert f"events sent: {2 * len(told.out.splitlines())}" in told.err
    code, told = listen(walk(80, 120), "-o", events)
    found = [Event.from_json(line) for line in events.read_text().splitlines()]
    assert [event.seq for event in found] == list(range(1, len(found) + 1))
    assert {event.id for event in standing(found)} == expected_events(tmp_path / "journal")
    assert {event.kind for event in found} >= {"stay.start", "trip.start", "trip.end"}


def test_events_do_not_go_to_files_of_the_journal(listen, tmp_path):
    code, told = listen("", "-o", tmp_path / "journal" / "events")
    assert (code, "the journal has its own files there" in told.err) == (2, True)


def test_events_and_the_summary_do_not_share_standard_output(listen):
    code, told = listen("", "-o", "-", "--json")
    assert (code, "both write to standard output" in told.err) == (2, True)


def test_a_journal_with_events_is_not_archived_without_them(listen, tmp_path):
    to_archive = ["--archive", tmp_path / "a.gpsz", "--max-error", "5m"]
    events = ["-o", tmp_path / "events.ndjson"]
    assert listen(walk(0, 10), *events)[0] == 0
    code, told = listen(walk(10, 10), *to_archive)
    assert (code, "add -o or --page, or remove" in told.err) == (2, True)
    # Nor are positions that were stored without events meanwhile, until these are found.
    assert listen(walk(10, 10))[0] == 0
    code, told = listen("", *to_archive, "--roll-now")
    assert (code, "run gpszip listen with -o or --page again" in told.err) == (2, True)
    assert len(stored(tmp_path / "journal")) == 20
    assert not (tmp_path / "a.gpsz").exists()


@needs_server
def test_killed_while_it_archives_nothing_acknowledged_is_lost(tmp_path):
    rng = random.Random(3)
    archive = tmp_path / "a.gpsz"
    to_archive = ["--archive", archive, "--max-error", "5m", "--effort", "1"]
    acknowledged = 0
    for round in range(1, 3):
        options = ["--http", "127.0.0.1:0", *to_archive, "--roll", "0.3s"]
        with listening(tmp_path / "journal", *options) as listener:
            port = listener.port
            # While a process archives the journal, or soon after.
            rolling = tmp_path / "journal" / "rolling"
            killer = kill_when(
                listener,
                lambda: acknowledged >= 20 * round and rolling.exists(),  # noqa: B023
                rng.uniform(0, 0.5),
            )
            try:
                while True:
                    when = bodies.TIME + acknowledged
                    place = f"lat={48 + acknowledged / 1e4:.6f}&lon=11.5"
                    if request(port, f"/osmand?id=ann&{place}&timestamp={when}")[0] == 200:
                        acknowledged += 1
                    time.sleep(0.005)
            except (OSError, HTTPException):
                listener.process.wait()
            killer.join()
        if archive.exists():
            # Whole at every moment.
            assert gpszip.open(archive.read_bytes()).ids == ("ann",)

    # What is left is archived by hand; a process that archives may outlive its listener.
    command = ["-m", "gpszip", "listen", "--journal", tmp_path / "journal", *to_archive]
    deadline = time.monotonic() + 60
    while segments(tmp_path / "journal") and time.monotonic() < deadline:
        subprocess.run([sys.executable, *command, "--roll-now"], check=False, capture_output=True)
    times = np.arange(acknowledged, dtype=float)
    found = gpszip.open(archive).position("ann", bodies.TIME + times)
    assert acknowledged >= 40
    assert np.abs(found[:, 0] - (48 + times / 1e4)).max() < 5.01 / 111_000


def test_an_archive_that_fails_is_told_and_the_listener_goes_on(tmp_path):
    archive = tmp_path / "a.gpsz"
    options = ["--archive", archive, "--max-error", "5m", "--effort", "1", "--roll", "0.1s"]
    with listening(tmp_path / "journal", *options, stdin=subprocess.PIPE) as listener:
        # Metres can't be appended to an archive in degrees.
        listener.process.stdin.write(table(0, 5))
        listener.process.stdin.flush()
        assert wait_until(archive.exists)
        gpszip.compress(gpszip.Track("a", [0, 1], [[0.0, 0.0], [9.0, 0.0]]), max_error=1).save(
            archive, force=True
        )
        listener.process.stdin.write(table(5, 5).partition("\n")[2])
        listener.process.stdin.flush()
        assert wait_until(lambda: any("not archived" in line for line in listener.lines), 15), (
            listener.lines
        )
        assert listener.process.poll() is None
        listener.process.stdin.close()
        assert listener.process.wait(60) == 2
    assert any("the archive in metres" in line for line in listener.lines)
    assert len(stored(tmp_path / "journal")) == 5


def test_a_variable_that_is_empty_is_no_token(listen, monkeypatch):
    monkeypatch.setenv("GPSZIP_TOKEN", "")
    code, told = listen("", "--http", "0")
    assert (code, "GPSZIP_TOKEN is empty" in told.err) == (2, True)


def test_a_process_that_cannot_begin_is_told_and_tried_again(tmp_path, monkeypatch):
    async def refuse(*_words, **_options):
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    async def roll_until_tried_again():
        rolling = asyncio.create_task(Rolling(0.01, []).run(journal, notices))
        await until(lambda: notices.counts["journal not archived"] > 1)
        rolling.cancel()
        await asyncio.wait([rolling])

    lines = []
    journal, notices = Journal(tmp_path), Notices(lines.append)
    journal.append([Fix("bus", "test", 7.0, 8.0, (48.0, 11.5))])
    monkeypatch.setattr(asyncio, "create_subprocess_exec", refuse)
    asyncio.run(roll_until_tried_again())
    journal.close()
    assert lines[0] == "journal not archived (Cannot allocate memory)"


def test_a_broker_that_is_off_is_told(tmp_path):
    pytest.importorskip("paho.mqtt")
    with listening(tmp_path, "--mqtt", f"mqtt://127.0.0.1:{free_port()}") as listener:
        told = "127.0.0.1: can't be reached; will be tried again"
        assert wait_until(lambda: told in listener.lines), listener.lines
        assert listener.end() == 0


@pytest.mark.parametrize(
    ("package", "extra", "options"),
    [
        ("starlette", "live", ["--http", "0"]),
        ("paho.mqtt.client", "live", ["--mqtt", "mqtt://127.0.0.1"]),
        ("websockets.asyncio.client", "live", ["--ros", "ws://127.0.0.1"]),
        ("websockets.asyncio.client", "live", ["--signalk", "ws://127.0.0.1"]),
        ("pymavlink.dialects.v20.common", "mavlink", ["--mavlink", "udp://:14550"]),
        ("aiokafka", "kafka", ["--kafka", "127.0.0.1/places"]),
    ],
)
def test_a_missing_extra_is_named(listen, monkeypatch, package, extra, options):
    monkeypatch.setitem(sys.modules, package, None)
    code, told = listen("", *options)
    assert code == 1
    assert f"{options[0]} needs the extra '{extra}': pip install 'gpszip[{extra}]'" in told.err


def test_a_key_of_the_environment_needs_its_extra_and_is_not_shown(listen, monkeypatch):
    monkeypatch.setenv("GPSZIP_OWNTRACKS_KEY", "s3cret" * 9)
    pytest.importorskip("nacl")
    code, told = listen("", "--stdin")
    assert (code, "s3cret" in told.err) == (1, False)
    assert "GPSZIP_OWNTRACKS_KEY: key 1: a key has 54 bytes" in told.err
    monkeypatch.setitem(sys.modules, "nacl.secret", None)
    assert "pip install 'gpszip[encrypted]'" in listen("", "--stdin")[1].err


@needs_server
def test_a_page_shows_what_other_servers_took(tmp_path):
    page = free_port()
    options = ["--http", "127.0.0.1:0", "--page", page, "--delay", "0.1s"]
    with listening(tmp_path / "journal", *options) as listener:
        assert request(listener.port, "/owntracks", bodies.owntracks())[0] == 200
        assert wait_until(lambda: f"live page at http://127.0.0.1:{page}/" in listener.lines)
        stream = Stream(page)
        ((name, source, *_),) = stream.next("agents")
        assert (name, source) == ("ann/phone", "owntracks")
        assert [each["kind"] for each in stream.next("events")] == ["source.stale"]

        # An open page does not keep the listener from its end.
        assert listener.end() == 0
        stream.close()


@needs_server
def test_a_page_for_other_machines_needs_a_token(listen, monkeypatch):
    code, told = listen("", "--page", "0.0.0.0:0")
    assert code == 2
    assert "other machines reach the page at 0.0.0.0; add a token with --token" in told.err
    monkeypatch.setenv("GPSZIP_TOKEN", "")
    code, told = listen("", "--page", "0.0.0.0:0")
    assert code == 2
    assert "GPSZIP_TOKEN is empty" in told.err
    monkeypatch.setenv("GPSZIP_TOKEN", "secret")
    code, told = listen(table(0, 5), "--page", "0.0.0.0:0")
    assert code == 0
    assert "live page at http://0.0.0.0:" in told.err
