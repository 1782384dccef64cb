"""Listeners in processes of their own, and requests to them."""

import http.client
import json
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

from gpszip.live.journal import read_segment, segments
from live.servers import wait_until


class Listener:
    """A process of ``gpszip listen`` and the lines that it tells."""

    def __init__(self, folder, *options, stdin=subprocess.DEVNULL, program=None):
        program = program or ["-m", "gpszip", "listen", "--journal", str(folder)]
        self.process = subprocess.Popen(
            [sys.executable, *program, *map(str, options)],
            stdin=stdin,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.lines = []
        self._ready = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        with self.process.stderr as stream:
            for line in stream:
                self.lines.append(line.rstrip("\n"))
                self._ready.set()
        self._ready.set()

    @property
    def port(self):
        """Port of the server, once it listens."""
        assert self._ready.wait(60)
        told = re.search(r":(\d+)$", next((line for line in self.lines if "http://" in line), ""))
        assert told, self.lines
        return int(told[1])

    def end(self, number=signal.SIGTERM):
        """End the process by a signal; return its exit code."""
        self.process.send_signal(number)
        code = self.process.wait(60)
        self._reader.join(60)
        return code

    def close(self):
        """End the process, whatever it does."""
        self.process.kill()
        self.process.wait()
        self._reader.join(60)


def kill_when(listener, holds, pause):
    """Kill a listener a moment after something holds; return the thread that does."""

    def kill():
        wait_until(holds)
        time.sleep(pause)
        listener.process.kill()

    thread = threading.Thread(target=kill)
    thread.start()
    return thread


@contextmanager
def listening(folder, *options, **more):
    """Run a listener, and end it."""
    listener = Listener(folder, *options, **more)
    try:
        yield listener
    finally:
        listener.close()


def request(port, path, body=None, method=None, **headers):
    """Status and body of a request."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    if isinstance(body, dict | list):
        body, named = json.dumps(body), {"content-type": "application/json"} | named
    try:
        method = method or ("GET" if body is None else "POST")
        is_chunked = "transfer-encoding" in named
        connection.request(method, path, body, named, encode_chunked=is_chunked)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def stored(folder):
    """All fixes of a journal, in the order in which they were written."""
    return [fix for path in segments(folder) for fix in read_segment(path)]
