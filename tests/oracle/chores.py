"""Small functions that other processes can import and run."""

import os
import signal
import time
from pathlib import Path

from gpszip.errors import BoundError, CorruptArchiveError, MissingExtraError


def halve(x):
    return x / 2


def scale(factors, i):
    return factors[i % len(factors)] * i


def process_id(folder):
    """The process, once another one has come as well; each leaves a file in the folder."""
    Path(folder, str(os.getpid())).touch()
    deadline = time.monotonic() + 60
    while len(os.listdir(folder)) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    return os.getpid()


def process_and_address(value, _):
    return os.getpid(), id(value)


def kill_process_at_three(x):
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def raise_error(number):
    raise {
        0: BoundError("too tight"),
        1: CorruptArchiveError("torn", 17),
        2: MissingExtraError("dask", "a cluster"),
    }[number]


def sleep_30_seconds(folder):
    """Sleep, and leave a file that is named for the process before."""
    Path(folder, str(os.getpid())).touch()
    time.sleep(30)


def join_in_brackets(a, b):
    return f"({a} {b})"


class UnpicklingRecord:
    """Lists the processes that unpickled it."""

    def __init__(self, processes):
        self.processes = processes

    def __setstate__(self, state):
        self.processes = [*state["processes"], os.getpid()]


def empty_record(_):
    return UnpicklingRecord([])


def join_records(a, b):
    return UnpicklingRecord([*a.processes, *b.processes])
