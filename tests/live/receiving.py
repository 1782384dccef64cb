"""Sources that run in the process of a test, and servers that they connect to."""

import asyncio
import contextlib
import json

from gpszip.errors import OutputError
from gpszip.live import Fix, Notices
from gpszip.live.screening import Screen

#: Seconds after which a test has failed, also where other processes take the processor.
DEADLINE = 120


class Taken:
    """A receiver that keeps what it gets, screened as for the journal; the disk may be full."""

    def __init__(self, full=0):
        self.lines, self.items, self.fixes, self.full = [], [], [], full
        self.notices = Notices(self.lines.append)
        self._screen = Screen(self.notices)

    async def store(self, items):
        items = [self._screen.check(item) if isinstance(item, Fix) else item for item in items]
        if self.full:
            self.full -= 1
            raise OutputError("the disk is full")
        for item in filter(None, items):
            (self.fixes if isinstance(item, Fix) else self.items).append(item)

    @property
    def reasons(self):
        return [item.reason for item in self.items]


def run(test):
    """Run a coroutine that may not take forever."""
    return asyncio.run(asyncio.wait_for(test, DEADLINE))


async def until(holds):
    """Wait until something holds."""
    async with asyncio.timeout(DEADLINE):
        while not holds():
            await asyncio.sleep(0.002)


@contextlib.asynccontextmanager
async def running(source, receiver):
    """A source that runs beside the block."""
    task = asyncio.create_task(source.run(receiver))
    try:
        yield task
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@contextlib.asynccontextmanager
async def serving(answer, port=0):
    """A server over WebSocket; yields its port. ``answer(connection)`` talks to a client."""
    from websockets.asyncio.server import serve

    async with serve(answer, "127.0.0.1", port) as server:
        yield server.sockets[0].getsockname()[1]


async def send(connection, *messages):
    for message in messages:
        await connection.send(message if isinstance(message, str | bytes) else json.dumps(message))
