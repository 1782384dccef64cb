"""Run commands while one system call fails, once for every call, and print outcomes as JSON.

    PYTHONPATH=tests python -m faults.injecting [--all | --times=N --signal=NUMBER] [COMMAND...]

A process that has everything loaded forks one child for each fault. strace is attached to the child
and lets its n-th call of a kind fail. When there is no n-th call, the next kind follows. Each child
starts in a new copy of a folder with the inputs and with the output of an earlier run.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import math
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from faults.commands import COMMANDS, prepare
from gpszip.cli.main import run
from gpszip.pipeline import memory as budget

__all__ = ["BRIEF", "FAULTS", "Outcome", "sweep"]

#: Errors of each call. Interrupted calls are repeated (except close), all others are reported.
FAULTS = {
    "openat": ("EIO", "EMFILE", "EINTR"),
    "mkdir": ("ENOSPC",),
    "write": ("ENOSPC", "EIO", "EINTR"),
    "pwrite64": ("ENOSPC",),
    "read": ("EINTR",),
    "fsync": ("EIO", "EINTR"),
    "fdatasync": ("EIO",),
    "close": ("EIO",),
    "chmod": ("EPERM",),
    "ftruncate": ("EIO",),
    "rename": ("EIO", "ENOSPC"),
    "link": ("EPERM",),
    "unlink": ("EIO",),
    "unlinkat": ("EIO",),
    "rmdir": ("EIO",),
}

#: Those that are tried by default.
BRIEF = {call: FAULTS[call][:1] for call in ("mkdir", "write", "fsync", "rename", "unlinkat")}

#: Seconds after which a child counts as hanging.
_TIMEOUT = 60.0

#: Option of prctl by which a process allows others to trace it.
_PR_SET_PTRACER = 0x59616D61

#: Exit codes of a child that failed outside of the command, got a signal before it, or hangs.
_CHILD_FAILED, _NOT_STARTED, _HANGS = 99, 97, 98


@dataclass
class Outcome:
    """The outcome of a command under a fault."""

    command: str
    fault: str
    number: int
    code: int
    message: str
    output: str
    left: list[str] = field(default_factory=list)
    injected: str = ""


def sweep(name: str, faults: dict[str, tuple[str, ...]], template: Path):
    """Yield the outcome of a command for every call and error."""
    for call, errors in faults.items():
        for error in errors:
            for number in range(1, 1000):
                outcome = _attempt(name, template, call, f"error={error}", number)
                if not outcome.injected:
                    break
                yield outcome


def interrupt(name: str, template: Path, number: int, times: int, seed: int):
    """Yield the outcome of a command that gets a signal at random moments."""
    chance = random.Random(seed)
    # The first run may wait for the disk, or for other processes: the faster of two counts.
    duration = math.inf
    for _ in range(2):
        start = time.monotonic()
        _attempt(name, template)
        duration = min(duration, time.monotonic() - start)

    for _ in range(times):
        yield _attempt(name, template, number=number, at=chance.uniform(0, 1.1 * duration))


def _attempt(
    name: str,
    template: Path,
    call: str = "",
    error: str = "",
    number: int = 0,
    at: float | None = None,
) -> Outcome:
    """Run a command in a child, with a failing call or a signal after ``at`` seconds."""
    command = COMMANDS[name]
    with _folder() as folder:
        # Start.
        shutil.copytree(template, folder / "work")
        (folder / "tmp").mkdir()
        child, gate = _child(folder, command.arguments)
        tracer = None
        if call:
            tracer = _strace(child, folder, call, error, number)
        gate.send(b"!")
        gate.close()

        # Wait.
        if at is not None:
            time.sleep(at)
            os.kill(child, number)
        code = _wait(child)
        injected = ""
        if tracer is not None:
            tracer.wait(_TIMEOUT)
            calls = (folder / "calls").read_text(errors="replace").splitlines()
            injected = next((line for line in calls if "INJECTED" in line), "")

        # What is left, and what was said.
        message = (folder / "message").read_text(errors="replace")
        work, tmp = folder / "work", folder / "tmp"
        left = sorted(f"tmp/{path.name}" for path in tmp.iterdir())
        left += sorted(
            f"work/{path.name}" for path in work.iterdir() if path.name not in command.files
        )
        return Outcome(
            name,
            f"{call}:{error}" if call else f"signal {number}",
            number,
            code,
            message,
            command.state(work),
            left,
            injected,
        )


@contextmanager
def _folder():
    """A temporary folder that a child does not remove when it ends."""
    folder = Path(tempfile.mkdtemp(prefix="faults-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def _child(folder: Path, arguments: list[str]) -> tuple[int, socket.socket]:
    """Fork a child that waits for a byte, then runs the command."""
    ours, its = socket.socketpair()
    child = os.fork()
    if child:
        its.close()
        ours.recv(1)
        return child, ours
    code = _CHILD_FAILED
    try:
        # Wait until the parent has attached a tracer.
        ours.close()
        ctypes.CDLL(None).prctl(_PR_SET_PTRACER, ctypes.c_long(-1), 0, 0, 0)
        os.chdir(folder / "work")
        os.environ["TMPDIR"] = str(folder / "tmp")
        tempfile.tempdir = None
        message = os.open(folder / "message", os.O_WRONLY | os.O_CREAT)
        os.dup2(message, 2)
        os.dup2(message, 1)
        # The parent may ignore these signals.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        its.send(b"!")
        its.recv(1)
        sys.argv = ["gpszip", *arguments]
        code = run()
    except SystemExit as end:
        code = end.code
        atexit._run_exitfuncs()
    except KeyboardInterrupt:
        code = _NOT_STARTED
    finally:
        os._exit(code)


def _strace(child: int, folder: Path, call: str, error: str, number: int) -> subprocess.Popen:
    (folder / "calls").touch()
    inject = f"inject={call}:{error}:when={number}"
    command = [
        "strace",
        "-f",
        "-y",
        "-o",
        str(folder / "calls"),
        "-e",
        f"trace={call}",
        "-e",
        inject,
        "-p",
        str(child),
    ]
    tracer = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    until = time.monotonic() + _TIMEOUT
    while "TracerPid:\t0" in Path(f"/proc/{child}/status").read_text():
        if tracer.poll() is not None or time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            raise SystemExit("strace can't be attached here")
        time.sleep(0.001)
    return tracer


def _wait(child: int) -> int:
    until = time.monotonic() + _TIMEOUT
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return _HANGS


def _run() -> None:
    # With --memory, even small logs are encoded in batches.
    budget._BYTES_IN_MEMORY = 1 << 40
    words = sys.argv[1:]
    faults = FAULTS if "--all" in words else BRIEF
    given = dict(word[2:].split("=") for word in words if "=" in word)
    times, number = int(given.get("times", 0)), int(given.get("signal", signal.SIGKILL))
    names = [word for word in words if not word.startswith("--")] or list(COMMANDS)
    with _folder() as folder:
        for name in names:
            template = folder / name
            prepare(template, name)
            found = (
                interrupt(name, template, number, times, seed=len(name))
                if times
                else sweep(name, faults, template)
            )
            for outcome in found:
                print(json.dumps(outcome.__dict__), flush=True)  # noqa: T201


if __name__ == "__main__":
    _run()
