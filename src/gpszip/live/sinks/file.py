"""Events as lines of a file, or of standard output."""

from __future__ import annotations

import asyncio
import os
import stat
from collections.abc import Sequence
from pathlib import Path

from gpszip.errors import InputError, OutputError
from gpszip.files.os_errors import as_output_error
from gpszip.live.events import Event

__all__ = ["FileSink", "StreamSink"]

#: With which the line of an event begins.
_BEGIN = b'{"kind":"'

#: Bytes at the end of a file whose events are known again: far more than are sent again after the
#: process was killed.
_KNOWN_BYTES = 4 << 20


class StreamSink:
    """Writes events to a descriptor, such as standard output.

    Parameters
    ----------
    descriptor : int, default 1
        Where to.
    """

    def __init__(self, descriptor: int = 1) -> None:
        self._descriptor = descriptor

    async def send(self, events: Sequence[Event]) -> None:
        """Write a line for each event."""
        # A pipe that nobody reads any more is a matter of the whole process.
        with as_output_error("standard output"):
            # Beside the event loop: whoever reads the pipe may be slow.
            await asyncio.to_thread(_write_all, self._descriptor, _lines(events))


class FileSink:
    """Appends events to a file; none is in it twice, even if the process is killed.

    Parameters
    ----------
    path : path
        The file, which is made if it is missing. A line that was cut off is removed.

    Raises
    ------
    OutputError
        If it can't be written, or holds something else.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        with as_output_error(self._path):
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
            # Pipes and devices hold nothing.
            self._is_file = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
            try:
                self._known = self._read_known() if self._is_file else set()
            except BaseException:
                os.close(self._descriptor)
                raise

    async def send(self, events: Sequence[Event]) -> None:
        """Append the events that were not in the file when it was opened."""
        # Only what was sent just before the process was killed comes again.
        new = [event for event in events if event.id not in self._known]
        await asyncio.to_thread(self._append, _lines(new))

    async def close(self) -> None:
        """Flush the file to disk, and close it."""
        try:
            if self._is_file:
                os.fsync(self._descriptor)
        finally:
            os.close(self._descriptor)

    def _append(self, data: bytes) -> None:
        size = os.fstat(self._descriptor).st_size
        try:
            _write_all(self._descriptor, data)
        except OSError:
            # On a full disk, a part of a line would stay.
            if self._is_file:
                os.ftruncate(self._descriptor, size)
            raise

    def _read_known(self) -> set[str]:
        """Remove a line that was cut off; return the ids of the last events."""
        # Nothing is appended to, or cut off from, a file of another kind.
        size = os.fstat(self._descriptor).st_size
        head = os.read(self._descriptor, len(_BEGIN))
        if head != _BEGIN[: len(head)]:
            raise OutputError(
                "holds something else than events", path=self._path, remedy="name another file"
            )

        start = max(0, size - _KNOWN_BYTES)
        os.lseek(self._descriptor, start, os.SEEK_SET)
        data = b""
        while part := os.read(self._descriptor, _KNOWN_BYTES):
            data += part
        end = data.rfind(b"\n") + 1
        if start + end < size:
            os.ftruncate(self._descriptor, start + end)

        # The first line may be a part of one.
        known = set()
        for line in data[:end].splitlines():
            try:
                known.add(Event.from_json(line).id)
            except InputError:
                continue
        return known


def _lines(events: Sequence[Event]) -> bytes:
    return "".join(f"{event.to_json()}\n" for event in events).encode("ascii")


def _write_all(descriptor: int, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[os.write(descriptor, left) :]
