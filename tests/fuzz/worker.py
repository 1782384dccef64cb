"""A process that takes the inputs of one target, within a bound on memory.

Each line that it reads is a seed; each line that it writes is an answer in JSON. An input can be
made again from target and seed, so the process may be killed at any input.
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

__all__ = ["MAX_EXTRA_BYTES", "answer", "make_input", "serve"]

#: Bytes of address space that an input may take, beyond those of the process before it.
MAX_EXTRA_BYTES = 1 << 30


def make_input(target: str, seed: int) -> bytes:
    """Return the input of a seed, which is the same in every process."""
    rng = random.Random(seed)
    number = rng.randrange(1 << 16)
    return TARGETS[target].mutate(number, mutations.draw(rng, TARGETS[target].kinds))


def serve(target: str) -> None:
    """Answer the lines of standard input until it ends."""
    # Libraries that print write to standard error, not among the answers.
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    # Import and compile all that valid files need, before memory is bounded.
    for seed in TARGETS[target].seeds():
        run(target, seed)
    _bound_memory()
    print("ready", file=answers, flush=True)

    for line in sys.stdin:
        data = make_input(target, int(line))
        print(json.dumps(answer(target, data)), file=answers, flush=True)


def _bound_memory() -> None:
    with open("/proc/self/statm", encoding="ascii") as file:
        pages = int(file.read().split()[0])
    size = pages * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (size + MAX_EXTRA_BYTES, resource.RLIM_INFINITY))


def answer(target: str, data: bytes) -> dict:
    """Run a target on an input.

    Returns
    -------
    dict
        ``accepted`` says whether it was read; ``leak`` is the traceback of an exception that is not
        raised on purpose, and ``data`` the input then.
    """
    start = time.process_time()
    try:
        accepted, leak = run(target, data), ""
    except BaseException:  # any exception is what fuzzing looks for
        accepted, leak = False, traceback.format_exc(limit=-12)
    return {
        "accepted": accepted,
        "leak": leak,
        "seconds": time.process_time() - start,
        "data": base64.b64encode(data).decode() if leak else "",
    }


if __name__ == "__main__":
    serve(sys.argv[1])
