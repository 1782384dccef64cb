"""Small functions that other processes can import and run."""

import os
import signal
import time

from gpszip.errors import BoundError, CorruptArchiveError, MissingExtraError


def halve(x):
    return x / 2


def scale(factors, i):
    return factors[i % len(factors)] * i


def process_id(_):
    time.sleep(0.05)
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


def sleep_30_seconds(x):
    time.sleep(30)
    return x


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
