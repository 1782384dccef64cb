"""Fuzz every target in turn for as long as asked; print counts, keep the inputs that failed, end with 1 if there are any.

PYTHONPATH=tests python -m fuzz.run [--minutes 60] [--seconds 5] [--seed 0] [--target NAME]... [--keep FOLDER]
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

from fuzz.targets import TARGETS
from fuzz.worker import input_of

__all__ = ["fuzz", "main"]

#: Seconds that one input may take, and seconds for which a target has its turn.
PATIENCE, TURN = 20.0, 20.0


class Lost(Exception):
    """The worker is gone, or has been for too long at one input."""


class Worker:
    """A process that takes inputs of one target."""

    def __init__(self, name: str) -> None:
        command, pipe = [sys.executable, "-m", "fuzz.worker", name], subprocess.PIPE
        places = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
        # the bound is on addresses: Arrow's own pool reserves a GiB of them at once, the C library 64 MiB for each thread
        own = {"PYTHONPATH": places, "ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2"}
        self.process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, env={**os.environ, **own}
        )
        self._rest = b""
        self._ready = selectors.DefaultSelector()
        self._ready.register(self.process.stdout, selectors.EVENT_READ)
        self._ready.register(self.process.stderr, selectors.EVENT_READ)
        self.words = b""
        self._line(120)

    def take(self, seed: int) -> dict:
        """Answer of the input with this number."""
        self.process.stdin.write(b"%d\n" % seed)
        self.process.stdin.flush()
        return json.loads(self._line(PATIENCE))

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            with contextlib.suppress(BrokenPipeError):
                stream.close()
        self._ready.close()

    def _line(self, patience: float) -> bytes:
        until = time.monotonic() + patience
        while b"\n" not in self._rest:
            for key, _ in self._ready.select(max(until - time.monotonic(), 0)):
                piece = os.read(key.fd, 1 << 16)
                if key.fileobj is self.process.stderr:
                    self.words = (self.words + piece)[-4000:]
                    if not piece:
                        self._ready.unregister(key.fileobj)
                elif not piece:
                    raise Lost(
                        f"the process ended with {self.process.wait()}: {self.words.decode(errors='replace')}"
                    )
                else:
                    self._rest += piece
            if time.monotonic() > until:
                raise Lost(f"no answer within {patience:.0f} s")
        line, _, self._rest = self._rest.partition(b"\n")
        return line


def fuzz(
    name: str, seed: int, seconds: float, most: int = 1 << 40
) -> tuple[Counter, dict[str, tuple[bytes, str]], int]:
    """Let a target take inputs for so many seconds, or so many of them.

    Returns
    -------
    Counter
        How many were accepted, and how many refused.
    dict of str to (bytes, str)
        Inputs that failed by the place where they did, and what was said.
    int
        The next seed.
    """
    counts, failed = Counter(), {}
    worker = Worker(name)
    until = time.monotonic() + seconds
    try:
        while time.monotonic() < until and most > 0:
            try:
                answer = worker.take(seed)
            except (Lost, BrokenPipeError) as error:
                answer = {
                    "leak": str(error) or "the process is gone",
                    "data": base64.b64encode(input_of(name, seed)).decode(),
                }
                worker.close()
                worker = Worker(name)
            if answer["leak"]:
                counts["failed"] += 1
                failed.setdefault(
                    _place(answer["leak"]), (base64.b64decode(answer["data"]), answer["leak"])
                )
            else:
                counts["accepted" if answer["accepted"] else "refused"] += 1
            seed, most = seed + 1, most - 1
    finally:
        worker.close()
    return counts, failed, seed


def _place(leak: str) -> str:
    """What tells faults apart: the last lines of the project's own in the traceback, and the kind of error."""
    lines = leak.strip().splitlines()
    own = [line.strip() for line in lines if "/gpszip/" in line]
    return f"{own[-1] if own else ''} {lines[-1].split(':')[0]}"


def main(words: list[str]) -> int:
    """Fuzz, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument(
        "--seconds", type=float, default=TURN, help="for which a target has its turn"
    )
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--target", action="append", choices=sorted(TARGETS))
    parser.add_argument(
        "--keep", type=Path, default=Path("fuzz-failures"), help="folder for inputs that failed"
    )
    asked = parser.parse_args(words)
    names, until = asked.target or list(TARGETS), time.monotonic() + 60 * asked.minutes
    seeds, totals, bad = (
        dict.fromkeys(names, asked.seed << 32),
        {name: Counter() for name in names},
        0,
    )
    while time.monotonic() < until:
        for name in names:
            counts, failed, seeds[name] = fuzz(
                name, seeds[name], min(asked.seconds, max(until - time.monotonic(), 0))
            )
            totals[name] += counts
            for place, (data, leak) in failed.items():
                bad += 1
                _keep(asked.keep, name, place, data, leak)
    for name, counts in totals.items():
        accepted, failures = counts["accepted"], counts["failed"]
        line = f"{name:<22} {counts.total():>9,} inputs, {accepted:,} accepted, {failures:,} failed"
        print(line)  # noqa: T201
    return 1 if bad else 0


def _keep(folder: Path, name: str, place: str, data: bytes, leak: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{name.replace(' ', '-').replace(',', '')}-{hashlib.sha256(place.encode()).hexdigest()[:8]}"
    if not (folder / stem).exists():
        (folder / stem).write_bytes(data)
        (folder / f"{stem}.txt").write_text(f"{name}: {place}\n\n{leak}\n")
        print(f"FAILED {name}: {place}: see {folder / stem}", flush=True)  # noqa: T201


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
