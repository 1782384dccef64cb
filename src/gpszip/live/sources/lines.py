"""Sources of lines: standard input, files, and connections over TCP."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Protocol

from gpszip.errors import OutputError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import Context
from gpszip.live.source import Receiver

__all__ = ["IDLE_SECONDS", "LineParser", "read_stream_lines", "store_lines", "store_patiently"]

#: Lines that are stored together: a file is read much faster than it is flushed to disk.
_MAX_LINES = 2_000

#: Seconds without a line after which the last epoch of a receiver is complete.
IDLE_SECONDS = 0.2

#: Seconds between attempts to store what could not be stored.
_RETRY_SECONDS = 5.0


class LineParser(Protocol):
    """Turns lines into fixes."""

    @property
    def pending(self) -> bool:
        """Whether a fix waits for further lines."""
        ...

    def push(self, line: bytes, context: Context) -> list[Fix | Unusable]:
        """Take a line, and return what it completes."""
        ...

    def finish(self, context: Context) -> list[Fix | Unusable]:
        """Return what the last lines hold."""
        ...


async def store_lines(
    lines: AsyncIterator[list[bytes]],
    parser: LineParser,
    receiver: Receiver,
    make_context: Callable[[float], Context],
) -> None:
    """Parse and store lines as they come.

    Parameters
    ----------
    lines : asynchronous iterator of list of bytes
        Lines that came together, none where nothing came for a while.
    parser : LineParser
        Turns them into fixes.
    receiver : Receiver
        Stores them; lines wait as long as that fails, as nobody could send them again.
    make_context : callable
        Returns the context of lines received at a time.
    """
    async for batch in lines:
        for first in range(0, max(len(batch), 1), _MAX_LINES):
            context = make_context(time.time())
            found: list[Fix | Unusable] = []
            for line in batch[first : first + _MAX_LINES]:
                found += parser.push(line, context)
            if not batch and parser.pending:
                found += parser.finish(context)
            await store_patiently(receiver, found)
    await store_patiently(receiver, parser.finish(make_context(time.time())))


async def store_patiently(receiver: Receiver, items: list[Fix | Unusable]) -> None:
    """Store what can't be sent again: try until it is stored."""
    while items:
        try:
            await receiver.store(items)
        except OutputError:
            # What was no fix is told of once.
            items = [item for item in items if isinstance(item, Fix)]
            await asyncio.sleep(_RETRY_SECONDS)
        else:
            return


async def read_stream_lines(
    stream: asyncio.StreamReader, max_bytes: int
) -> AsyncIterator[list[bytes]]:
    """Yield the lines of a stream, and an empty list where none comes for a while.

    Lines longer than ``max_bytes`` are cut.
    """
    # The last line may go on in the next chunk.
    rest = b""
    while True:
        try:
            async with asyncio.timeout(IDLE_SECONDS):
                chunk = await stream.read(1 << 16)
        except TimeoutError:
            yield []
            continue
        if not chunk:
            break

        # Yield the complete ones.
        *lines, rest = (rest + chunk).split(b"\n")
        rest = rest[:max_bytes]
        if lines:
            yield lines
    if rest:
        yield [rest]
