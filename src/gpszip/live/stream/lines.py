"""The lines of a pipe that may never end, read ahead by a thread."""

from __future__ import annotations

import os
import queue
import threading
import time

__all__ = ["StreamLines"]

#: Bytes that are read at once.
_CHUNK_BYTES = 1 << 16

#: Chunks that are read ahead: 4 MB. Whoever writes to the pipe waits when they are full.
_MAX_CHUNKS = 64

#: Bytes of a line; longer ones are cut, and can't be read.
_MAX_LINE_BYTES = 1 << 20

#: Seconds of one wait: then signals are looked for.
_WAIT_SECONDS = 0.1


class StreamLines:
    """Reads a file descriptor line by line.

    Parameters
    ----------
    descriptor : int
        An open file, pipe or device.

    Attributes
    ----------
    cut : int
        Lines that were cut off when reading stopped.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._chunks: queue.Queue[bytes] = queue.Queue(_MAX_CHUNKS)
        self._rest = b""
        self._left: list[bytes] = []
        self._stopped = threading.Event()
        self._ended = False
        self.cut = 0
        # A thread that waits for a pipe can't be ended, so that it must not keep the program alive.
        threading.Thread(target=self._read, daemon=True).start()

    def stop(self) -> None:
        """Take no further bytes; those that were read already still come."""
        self._stopped.set()

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._stopped.is_set()

    def take(self, count: int, seconds: float) -> tuple[list[bytes], bool]:
        """Return the next lines, with their ends.

        Parameters
        ----------
        count : int
            Lines at most.
        seconds : float
            Time from the first line after which to return.

        Returns
        -------
        list of bytes
            The lines.
        bool
            Whether there may be more.
        """
        # Lines that are left of the last chunk count from now on.
        lines, self._left = self._left, []
        deadline = time.monotonic() + seconds if lines else float("inf")
        while len(lines) < count and time.monotonic() < deadline and not self._ended:
            lines += self._next_lines()
            if lines and deadline == float("inf"):
                deadline = time.monotonic() + seconds

        # A chunk may bring more than are asked for.
        lines, self._left = lines[:count], lines[count:]
        return lines, bool(self._left) or not self._ended

    def _next_lines(self) -> list[bytes]:
        """Wait a moment for a chunk, and return the lines that it completes."""
        try:
            chunk = self._chunks.get(timeout=0.0 if self.stopped else _WAIT_SECONDS)
        except queue.Empty:
            # What comes after a signal belongs to nobody; a line may be cut off there.
            self._ended = self.stopped
            self.cut = int(self._ended and bool(self._rest))
            return []
        if not chunk:
            self._ended = True
            return [self._rest] if self._rest else []
        *lines, rest = (self._rest + chunk).split(b"\n")
        self._rest = rest[:_MAX_LINE_BYTES]
        return [line + b"\n" for line in lines]

    def _read(self) -> None:
        """Read chunks until the end."""
        chunk = b"?"
        while chunk and not self.stopped:
            try:
                chunk = os.read(self._descriptor, _CHUNK_BYTES)
            except OSError:  # a terminal or device that is gone
                chunk = b""
            self._chunks.put(chunk)
