"""Events as lines of a file, or of standard output."""

from __future__ import annotations

import asyncio
import os
import stat
from collections.abc import Sequence
from pathlib import Path

from gpszip.errors import InputError
from gpszip.files.os_errors import as_output_error
from gpszip.live.events import Event

__all__ = ["FileSink", "StreamSink"]

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
        If it can't be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        with as_output_error(self._path):
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
            # Pipes and devices hold nothing.
            self._is_file = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
            self._known = self._read_known() if self._is_file else set()

    async def send(self, events: Sequence[Event]) -> None:
        """Append the events that are not in the file."""
        new = [event for event in events if event.id not in self._known]
        size = os.fstat(self._descriptor).st_size
        try:
            _write_all(self._descriptor, _lines(new))
        except OSError:
            # On a full disk, a part of a line would stay.
            if self._is_file:
                os.ftruncate(self._descriptor, size)
            raise
        self._known.update(event.id for event in new)

    async def close(self) -> None:
        """Flush the file to disk, and close it."""
        try:
            if self._is_file:
                os.fsync(self._descriptor)
        finally:
            os.close(self._descriptor)

    def forget(self) -> None:
        """Forget which events are in the file: none of them comes again."""
        self._known.clear()

    def _read_known(self) -> set[str]:
        """Remove a line that was cut off; return the ids of the last events."""
        size = os.fstat(self._descriptor).st_size
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
