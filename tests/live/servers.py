"""Brokers and receivers that tests start, where Debian's packages are installed."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import contextmanager
from pathlib import Path

#: Where Debian has servers; the path of users often lacks it.
_FOLDERS = ("/usr/sbin", "/usr/local/sbin")


def find_program(name):
    """Path of a program; None if it is not installed."""
    found = shutil.which(name)
    return found or next((f"{each}/{name}" for each in _FOLDERS if Path(each, name).exists()), None)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_for_port(port, process):
    """Wait until a server listens."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and process.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            time.sleep(0.02)
        else:
            return
    raise AssertionError(f"{process.args} does not listen")


@contextmanager
def running(*command):
    """A server that ends with the block, and all that it started."""
    process = subprocess.Popen(
        [str(word) for word in command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


@contextmanager
def broker(folder, port=None):
    """Mosquitto on a port, a free one by default; yields the port."""
    port = port or free_port()
    config = Path(folder) / "mosquitto.conf"
    config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
    with running(find_program("mosquitto"), "-c", config) as process:
        wait_for_port(port, process)
        yield port


def wait_until(holds, seconds=120):
    """Wait until something holds; return whether it does."""
    deadline = time.monotonic() + seconds
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.1)
    return holds()
