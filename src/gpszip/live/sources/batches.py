"""Messages that come one by one, gathered into batches: one flush to disk serves a batch."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Sized
from typing import Generic, TypeVar

__all__ = ["batches_of"]

T = TypeVar("T", bound=Sized)

#: Messages that wait while others are stored, and their bytes. While so many do, none are read, so
#: that the sender has to wait, too.
_MAX_WAITING = 2_000
_MAX_BYTES = 8 << 20


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
    >>> left = ["b", "a"]
    >>> async def read():
    ...     return left.pop()
    >>> async def run():
    ...     async for batch in batches_of(read):
    ...         print(batch)
    >>> asyncio.run(run())
    Traceback (most recent call last):
    IndexError: pop from empty list
    """
    waiting = _Waiting[T]()
    filling = asyncio.create_task(waiting.fill(read))
    try:
        while True:
            batch = await waiting.take()
            if batch:
                yield batch
            elif waiting.end is not None:
                raise waiting.end
    finally:
        filling.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await filling


class _Waiting(Generic[T]):
    """Messages that wait, and why there are no more after them."""

    def __init__(self) -> None:
        self.end: Exception | None = None
        self._messages: deque[T] = deque()
        self._bytes = 0
        self._changed = asyncio.Condition()

    async def fill(self, read: Callable[[], Awaitable[T]]) -> None:
        """Read until that fails; while too many messages wait, none is read."""
        try:
            while True:
                message = await read()
                async with self._changed:
                    self._messages.append(message)
                    self._bytes += len(message)
                    self._changed.notify_all()
                    await self._changed.wait_for(self._has_space)
        except Exception as error:
            async with self._changed:
                self.end = error
                self._changed.notify_all()

    async def take(self) -> list[T]:
        """Wait for messages, and return all; none after the last."""
        async with self._changed:
            await self._changed.wait_for(lambda: self._messages or self.end is not None)
            taken = list(self._messages)
            self._messages.clear()
            self._bytes = 0
            self._changed.notify_all()
            return taken

    def _has_space(self) -> bool:
        return len(self._messages) < _MAX_WAITING and self._bytes < _MAX_BYTES
