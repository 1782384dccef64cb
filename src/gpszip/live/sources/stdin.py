"""Standard input as a source: CSV with a header, JSON lines, or NMEA."""

from __future__ import annotations

import asyncio
import io
import os
import threading
from collections.abc import AsyncIterator, Mapping
from datetime import UTC, tzinfo

from gpszip.live.formats.text import TextParser
from gpszip.live.formats.values import Context
from gpszip.live.source import Receiver
from gpszip.live.sources.lines import IDLE_SECONDS, store_lines

__all__ = ["StreamSource", "read_descriptor_chunks", "read_descriptor_lines"]

#: Bytes of a line; longer ones are cut.
_MAX_LINE_BYTES = 1 << 20

#: Chunks that are read ahead.
_QUEUE_CHUNKS = 4


class StreamSource:
    """Reads a file descriptor to its end.

    Parameters
    ----------
    descriptor : int
        An open file or pipe, such as 0, standard input.
    name : str
        What messages call it.
    agent : str
        Who is where, unless the lines say so.
    columns : mapping of str to str, optional
        Columns by role.
    timezone : tzinfo
        Zone of times without one.
    """

    def __init__(
        self,
        descriptor: int,
        name: str,
        agent: str,
        *,
        columns: Mapping[str, str] | None = None,
        timezone: tzinfo = UTC,
    ) -> None:
        self._descriptor, self._name, self._agent = descriptor, name, agent
        self._columns, self._timezone = columns, timezone

    async def run(self, receiver: Receiver) -> None:
        """Store all lines."""
        parser = TextParser(self._agent, self._columns, self._name)

        def make_context(received: float) -> Context:
            return Context(received, "stdin", "", self._timezone)

        await store_lines(read_descriptor_lines(self._descriptor), parser, receiver, make_context)


async def read_descriptor_lines(descriptor: int) -> AsyncIterator[list[bytes]]:
    """Yield lines of a descriptor, and an empty list where none comes for a while."""
    rest = b""
    async for chunk in read_descriptor_chunks(descriptor):
        if chunk is None:
            yield []
            continue
        *lines, rest = (rest + chunk).split(b"\n")
        rest = rest[:_MAX_LINE_BYTES]
        if lines:
            yield lines
    if rest:
        yield [rest]


async def read_descriptor_chunks(descriptor: int) -> AsyncIterator[bytes | None]:
    """Yield what is read from a descriptor, and None where nothing comes for a while."""
    # A thread of its own reads: files can't be waited for in the event loop, and a thread of the
    # pool would keep the program from ending.
    loop = asyncio.get_running_loop()
    queue: asyncio.Queue[bytes] = asyncio.Queue()
    space = threading.Semaphore(_QUEUE_CHUNKS)

    # The thread may outlive this loop by one read. It has a descriptor of its own, so that it never
    # takes what a later reader of the same number waits for.
    own = os.dup(descriptor)

    def read() -> None:
        chunk = b"?"
        with io.FileIO(own) as file:
            while chunk:
                space.acquire()
                try:
                    chunk = file.read(1 << 16) or b""
                except OSError:  # a terminal that is gone
                    chunk = b""
                try:
                    loop.call_soon_threadsafe(queue.put_nowait, chunk)
                except RuntimeError:  # the loop has ended
                    return

    # Take what it reads.
    threading.Thread(target=read, daemon=True).start()
    while True:
        try:
            async with asyncio.timeout(IDLE_SECONDS):
                chunk = await queue.get()
        except TimeoutError:
            yield None
            continue
        space.release()
        if not chunk:
            return
        yield chunk
