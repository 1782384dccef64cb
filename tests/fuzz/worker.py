"""A process that takes inputs one after the other within a bound on memory: each line ``NUMBER SEED``, each answer a line of JSON.

The process may be killed at any input, by itself or by who waits for it; the input can be made again from target and seed.
"""

from __future__ import annotations

import base64
import json
import os
import random
import resource
import sys
import time
import traceback
import warnings

from fuzz import mutations
from fuzz.targets import TARGETS, run

__all__ = ["ROOM", "answer", "input_of", "serve"]

#: Bytes of address space that an input may take beside what is there before.
ROOM = 1 << 30


def input_of(name: str, seed: int) -> bytes:
    """The input of this number: the same in every process."""
    chance = random.Random(seed)
    target = TARGETS[name]
    return target.made(chance.randrange(1 << 16), mutations.drawn(chance, target.kinds))


def serve(name: str) -> None:
    """Answer lines from standard input until it ends."""
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries that print don't disturb the answers
    for seed in TARGETS[name].seeds():
        run(name, seed)
    _bound()
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        seed = int(line)
        data = input_of(name, seed)
        print(json.dumps(answer(name, data)), file=answers, flush=True)


def _bound() -> None:
    with open("/proc/self/statm", encoding="ascii") as file:
        there = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (there + ROOM, resource.RLIM_INFINITY))


def answer(name: str, data: bytes) -> dict:
    """What became of an input; a leak is all that is neither an answer nor an error raised on purpose."""
    start = time.process_time()
    try:
        accepted, leak = run(name, data), ""
    except BaseException:  # whatever it is, it is what is looked for
        accepted, leak = False, traceback.format_exc(limit=-12)
    seconds = time.process_time() - start
    return {
        "accepted": accepted,
        "leak": leak,
        "seconds": seconds,
        "data": base64.b64encode(data).decode() if leak else "",
    }


if __name__ == "__main__":
    serve(sys.argv[1])
