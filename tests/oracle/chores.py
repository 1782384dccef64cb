"""Small pieces of work that other processes can import."""

import os
import signal
import time

from gpszip.errors import BoundError, CorruptArchiveError, MissingExtraError


def halved(x):
    return x / 2


def scaled(factors, i):
    return factors[i % len(factors)] * i


def process_of(_):
    time.sleep(0.05)
    return os.getpid()


def identity_of(value, _):
    return os.getpid(), id(value)


def die(x):
    if x == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def fail(x):
    raise {
        0: BoundError("too tight"),
        1: CorruptArchiveError("torn", 17),
        2: MissingExtraError("dask", "a cluster"),
    }[x]


def nap(x):
    time.sleep(30)
    return x


def joined(a, b):
    return f"({a} {b})"


class Traveller:
    """Notes each process to which it comes."""

    def __init__(self, stations):
        self.stations = stations

    def __setstate__(self, state):
        self.stations = [*state["stations"], os.getpid()]


def departed(_):
    return Traveller([])


def met(a, b):
    return Traveller([*a.stations, *b.stations])
