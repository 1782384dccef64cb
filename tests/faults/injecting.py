"""Run commands while the system fails at one call, once for every call, and print what became of each as a line of JSON.

    PYTHONPATH=tests python -m faults.injecting [--all | --times=N --signal=NUMBER] [COMMAND...]

A process that has everything loaded forks one child for each fault; strace is attached to the child and lets its n-th call of a
kind fail. When no n-th call is left, the next kind follows. Each child starts in a new copy of a folder that holds the inputs,
and an output of an earlier run.
"""

from __future__ import annotations

import atexit
import ctypes
import json
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

#: Errors of each call. What is interrupted is made again (but closing a file, which nobody can), all others are told.
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

#: Those that are tried where time is short.
BRIEF = {call: FAULTS[call][:1] for call in ("mkdir", "write", "fsync", "rename", "unlinkat")}

#: Seconds after which a child hangs, and option of prctl by which a process lets others trace it.
_PATIENCE, _PR_SET_PTRACER = 60.0, 0x59616D61


@dataclass
class Outcome:
    """What became of a command under a fault."""

    command: str
    fault: str
    number: int
    code: int
    told: str
    output: str
    left: list[str] = field(default_factory=list)
    struck: str = ""


def sweep(name: str, faults: dict[str, tuple[str, ...]], template: Path):
    """Yield the outcome of a command for every call and error."""
    for call, errors in faults.items():
        for error in errors:
            for number in range(1, 1000):
                outcome = _attempt(name, template, call, f"error={error}", number)
                if not outcome.struck:
                    break
                yield outcome


def ended(name: str, template: Path, number: int, times: int, seed: int):
    """Yield the outcome of a command that gets a signal at random moments."""
    chance = random.Random(seed)
    start = time.monotonic()
    _attempt(name, template)
    whole = time.monotonic() - start
    for _ in range(times):
        yield _attempt(name, template, number=number, at=chance.uniform(0, 1.1 * whole))


def _attempt(
    name: str,
    template: Path,
    call: str = "",
    error: str = "",
    number: int = 0,
    at: float | None = None,
) -> Outcome:
    command = COMMANDS[name]
    with _folder() as room:
        shutil.copytree(template, room / "there")
        (room / "tmp").mkdir()
        child, gate = _child(room, command.arguments)
        tracer = None
        if call:
            tracer = _strace(child, room, call, error, number)
        gate.send(b"!")
        gate.close()
        if at is not None:
            time.sleep(at)
            os.kill(child, number)
        code = _wait(child)
        struck = ""
        if tracer is not None:
            tracer.wait(_PATIENCE)
            struck = next(
                (
                    line
                    for line in (room / "calls").read_text(errors="replace").splitlines()
                    if "INJECTED" in line
                ),
                "",
            )
        told = (room / "told").read_text(errors="replace")
        there, tmp = room / "there", room / "tmp"
        left = sorted(f"tmp/{path.name}" for path in tmp.iterdir())
        left += sorted(
            f"there/{path.name}" for path in there.iterdir() if path.name not in command.files
        )
        return Outcome(
            name,
            f"{call}:{error}" if call else f"signal {number}",
            number,
            code,
            told,
            command.state(there),
            left,
            struck,
        )


@contextmanager
def _folder():
    """A temporary folder that a child does not remove when it ends."""
    folder = Path(tempfile.mkdtemp(prefix="faults-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def _child(room: Path, arguments: list[str]) -> tuple[int, socket.socket]:
    """Fork a child that waits for a byte, then runs the command."""
    ours, its = socket.socketpair()
    child = os.fork()
    if child:
        its.close()
        ours.recv(1)
        return child, ours
    code = 99
    try:
        ours.close()
        ctypes.CDLL(None).prctl(_PR_SET_PTRACER, ctypes.c_long(-1), 0, 0, 0)
        os.chdir(room / "there")
        os.environ["TMPDIR"] = str(room / "tmp")
        tempfile.tempdir = None
        told = os.open(room / "told", os.O_WRONLY | os.O_CREAT)
        os.dup2(told, 2)
        os.dup2(told, 1)
        signal.signal(
            signal.SIGINT, signal.default_int_handler
        )  # who runs this may have it ignore them
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        its.send(b"!")
        its.recv(1)
        sys.argv = ["gpszip", *arguments]
        code = run()
    except SystemExit as end:
        code = end.code
        atexit._run_exitfuncs()
    except KeyboardInterrupt:
        code = 97  # before it began
    finally:
        os._exit(code)


def _strace(child: int, room: Path, call: str, error: str, number: int) -> subprocess.Popen:
    (room / "calls").touch()
    inject = f"inject={call}:{error}:when={number}"
    command = [
        "strace",
        "-f",
        "-y",
        "-o",
        str(room / "calls"),
        "-e",
        f"trace={call}",
        "-e",
        inject,
        "-p",
        str(child),
    ]
    tracer = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    until = time.monotonic() + _PATIENCE
    while "TracerPid:\t0" in Path(f"/proc/{child}/status").read_text():
        if tracer.poll() is not None or time.monotonic() > until:
            os.kill(child, signal.SIGKILL)
            raise SystemExit("strace can't be attached here")
        time.sleep(0.001)
    return tracer


def _wait(child: int) -> int:
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return 98  # it hangs


def _run() -> None:
    # with --memory, even small logs are encoded in batches
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
                ended(name, template, number, times, seed=len(name))
                if times
                else sweep(name, faults, template)
            )
            for outcome in found:
                print(json.dumps(outcome.__dict__), flush=True)  # noqa: T201


if __name__ == "__main__":
    _run()
