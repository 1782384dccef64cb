"""Fuzz every target in turn, print counts, and keep the inputs that failed.

PYTHONPATH=tests python -m fuzz.run [--minutes 60] [--seconds 5] [--seed 0] [--target NAME]...
    [--keep FOLDER]

The exit code is 1 if an input failed.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import hashlib
import json
import os
import selectors
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from fuzz.targets import TARGETS
from fuzz.worker import make_input

__all__ = ["FuzzResult", "WorkerLostError", "WorkerProcess", "fuzz", "main"]

#: Seconds that one input may take.
_MAX_INPUT_SECONDS = 20.0

#: Seconds that a worker may take to start.
_MAX_START_SECONDS = 120.0

#: Seconds after which it is the turn of the next target.
_TURN_SECONDS = 20.0

#: Bytes of a worker's error output that are kept.
_MAX_ERROR_BYTES = 4000

#: Environment of a worker. The bound on memory counts addresses, and Arrow's own pool reserves a
#: GiB of them at once, the C library 64 MiB for each thread.
_ENVIRONMENT = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2"}


class WorkerLostError(Exception):
    """The worker ended, or took too long for one input."""


class WorkerProcess:
    """A process that takes inputs of one target."""

    def __init__(self, target: str) -> None:
        path = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
        self.process = subprocess.Popen(
            [sys.executable, "-m", "fuzz.worker", target],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": path, **_ENVIRONMENT},
        )
        self.errors = b""
        self._unread = b""
        self._ready = selectors.DefaultSelector()
        self._ready.register(self.process.stdout, selectors.EVENT_READ)
        self._ready.register(self.process.stderr, selectors.EVENT_READ)
        self._read_line(_MAX_START_SECONDS)

    def take(self, seed: int) -> dict:
        """Return the answer to the input of this seed."""
        self.process.stdin.write(b"%d\n" % seed)
        self.process.stdin.flush()
        return json.loads(self._read_line(_MAX_INPUT_SECONDS))

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            with contextlib.suppress(BrokenPipeError):
                stream.close()
        self._ready.close()

    def _read_line(self, seconds: float) -> bytes:
        deadline = time.monotonic() + seconds
        while b"\n" not in self._unread:
            for key, _ in self._ready.select(max(deadline - time.monotonic(), 0)):
                chunk = os.read(key.fd, 1 << 16)
                if key.fileobj is self.process.stderr:
                    self.errors = (self.errors + chunk)[-_MAX_ERROR_BYTES:]
                    if not chunk:
                        self._ready.unregister(key.fileobj)
                elif chunk:
                    self._unread += chunk
                else:
                    code, errors = self.process.wait(), self.errors.decode(errors="replace")
                    raise WorkerLostError(f"the process ended with {code}: {errors}")
            if time.monotonic() > deadline:
                raise WorkerLostError(f"no answer within {seconds:.0f} s")
        line, _, self._unread = self._unread.partition(b"\n")
        return line


class Failure(NamedTuple):
    """An input that failed, and the traceback."""

    data: bytes
    traceback: str


class FuzzResult(NamedTuple):
    """What came of fuzzing a target.

    Parameters
    ----------
    counts : Counter
        Number of inputs that were accepted, refused and failed.
    failures : dict of str to Failure
        The first input that failed at each line of code.
    next_seed : int
        Seed of the next input.
    """

    counts: Counter
    failures: dict[str, Failure]
    next_seed: int


def fuzz(target: str, seed: int, seconds: float, max_inputs: int = 1 << 40) -> FuzzResult:
    """Feed a target inputs for a number of seconds, or a number of inputs."""
    counts, failures = Counter(), {}
    worker = WorkerProcess(target)
    deadline = time.monotonic() + seconds
    try:
        for next_seed in range(seed, seed + max_inputs):
            if time.monotonic() >= deadline:
                return FuzzResult(counts, failures, next_seed)
            try:
                answer = worker.take(next_seed)
            except (WorkerLostError, BrokenPipeError) as error:
                answer = {
                    "leak": str(error) or "the process is gone",
                    "data": base64.b64encode(make_input(target, next_seed)).decode(),
                }
                worker.close()
                worker = WorkerProcess(target)
            if answer["leak"]:
                counts["failed"] += 1
                failure = Failure(base64.b64decode(answer["data"]), answer["leak"])
                failures.setdefault(_location(failure.traceback), failure)
            else:
                counts["accepted" if answer["accepted"] else "refused"] += 1
    finally:
        worker.close()
    return FuzzResult(counts, failures, seed + max_inputs)


def _location(traceback: str) -> str:
    """Return the last line of the project's code in a traceback, and the kind of the error."""
    lines = traceback.strip().splitlines()
    project_lines = [line.strip() for line in lines if "/gpszip/" in line]
    return f"{project_lines[-1] if project_lines else ''} {lines[-1].split(':')[0]}"


def main(arguments: list[str]) -> int:
    """Fuzz, and return the exit code."""
    # Options
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument(
        "--seconds", type=float, default=_TURN_SECONDS, help="after which the next target follows"
    )
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--target", action="append", choices=sorted(TARGETS))
    parser.add_argument(
        "--keep", type=Path, default=Path("fuzz-failures"), help="folder for inputs that failed"
    )
    options = parser.parse_args(arguments)

    # Targets in turn
    targets = options.target or list(TARGETS)
    seeds = dict.fromkeys(targets, options.seed << 32)
    totals = {target: Counter() for target in targets}
    failed = 0
    deadline = time.monotonic() + 60 * options.minutes
    while time.monotonic() < deadline:
        for target in targets:
            seconds = min(options.seconds, max(deadline - time.monotonic(), 0))
            counts, failures, seeds[target] = fuzz(target, seeds[target], seconds)
            totals[target] += counts
            failed += len(failures)
            for location, failure in failures.items():
                _keep(options.keep, target, location, failure)

    # Counts
    for target, counts in totals.items():
        print(  # noqa: T201
            f"{target:<22} {counts.total():>9,} inputs, {counts['accepted']:,} accepted, "
            f"{counts['failed']:,} failed"
        )
    return 1 if failed else 0


def _keep(folder: Path, target: str, location: str, failure: Failure) -> None:
    """Store an input that failed, unless one that failed at the same line is there."""
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(location.encode()).hexdigest()[:8]
    path = folder / f"{target.replace(' ', '-').replace(',', '')}-{digest}"
    if not path.exists():
        path.write_bytes(failure.data)
        text = f"{target}: {location}\n\n{failure.traceback}\n"
        path.with_name(f"{path.name}.txt").write_text(text)
        print(f"FAILED {target}: {location}: see {path}", flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
