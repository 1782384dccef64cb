"""Messages that come one by one, gathered into batches: one flush to disk serves a batch."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Generic, TypeVar

__all__ = ["batches_of"]

T = TypeVar("T")

#: Messages that wait while others are stored. While so many do, none are read, so that the sender
#: has to wait, too.
_MAX_WAITING = 2_000


class _End(Generic[T]):
    """What follows the last message: the reason why there are no more."""

    def __init__(self, error: Exception) -> None:
        self.error = error


async def batches_of(read: Callable[[], Awaitable[T]]) -> AsyncIterator[list[T]]:
    """Yield what is read, each time all that has come meanwhile.

    Parameters
    ----------
    read : callable
        Waits for the next message.

    Raises
    ------
    Exception
        What ``read`` raises, once all that came before was yielded.

    Examples
    --------
    >>> left = [2, 1]
    >>> async def read():
    ...     return left.pop()
    >>> async def run():
    ...     async for batch in batches_of(read):
    ...         print(batch)
    >>> asyncio.run(run())
    Traceback (most recent call last):
    IndexError: pop from empty list
    """
    queue: asyncio.Queue[T | _End[T]] = asyncio.Queue(_MAX_WAITING)

    async def fill() -> None:
        try:
            while True:
                await queue.put(await read())
        except Exception as error:
            await queue.put(_End(error))

    # Wait for a message, and take what else is there.
    filling = asyncio.create_task(fill())
    try:
        while True:
            batch, end = _take(await queue.get(), queue)
            if batch:
                yield batch
            if end is not None:
                raise end.error
    finally:
        filling.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await filling


def _take(first: T | _End[T], queue: asyncio.Queue[T | _End[T]]) -> tuple[list[T], _End[T] | None]:
    """Return the messages that are there, and the end if it is."""
    batch: list[T] = []
    item = first
    while True:
        if isinstance(item, _End):
            return batch, item
        batch.append(item)
        if queue.empty():
            return batch, None
        item = queue.get_nowait()
