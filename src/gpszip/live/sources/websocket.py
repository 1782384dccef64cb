"""Connections over WebSocket, which are opened again when they end."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from gpszip.errors import MissingExtraError
from gpszip.live.notices import Notices
from gpszip.live.sources.connection import CONNECT_SECONDS, RETRY_SECONDS

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

__all__ = ["MAX_MESSAGE_BYTES", "keep_connected", "require_websockets"]

#: Bytes of a message; positions have less than 4 kB, lists of all topics of a robot 100 kB.
MAX_MESSAGE_BYTES = 1 << 20

#: Messages that the connection reads ahead.
_READ_AHEAD = 64


async def keep_connected(
    find_url: Callable[[], Awaitable[str]],
    name: str,
    notices: Notices,
    talk: Callable[[ClientConnection], Awaitable[None]],
) -> None:
    """Connect, talk, and connect again when the connection ends, until the task is cancelled.

    Parameters
    ----------
    find_url : callable
        Returns the address, before each attempt to connect.
    name : str
        What messages call the server.
    notices : Notices
        Is told when the server can't be reached, and when it is back.
    talk : callable
        Sends and receives until the connection ends.
    """
    pause = RETRY_SECONDS[0]
    is_away = False
    while True:
        begin = time.monotonic()
        reason = ""
        try:
            connection = await _connect(await find_url())
            if is_away:
                notices.note("connected again", name)
            is_away = False
            try:
                await talk(connection)
            finally:
                await connection.close()
        except Exception as error:
            # A connection that was there and broke is told, as is a server that is off.
            if not _is_of_network(error):
                raise
            reason = str(error) or type(error).__name__
        if not is_away:
            event = "can't be reached or went away; will be tried again"
            notices.note(event, name, reason)
        is_away = True

        # A connection that lasted is tried again at once.
        if time.monotonic() - begin > RETRY_SECONDS[1]:
            pause = RETRY_SECONDS[0]
        await asyncio.sleep(pause)
        pause = min(2 * pause, RETRY_SECONDS[1])


async def _connect(url: str) -> ClientConnection:
    from websockets.asyncio.client import connect

    # Robots and boats are near: the proxy of the environment is for the web.
    return await connect(
        url,
        proxy=None,
        open_timeout=CONNECT_SECONDS,
        max_size=MAX_MESSAGE_BYTES,
        max_queue=_READ_AHEAD,
    )


def _is_of_network(error: Exception) -> bool:
    """Whether an error may pass: a server that is off, goes away, or answers nonsense."""
    from websockets.exceptions import WebSocketException

    return isinstance(error, OSError | TimeoutError | WebSocketException)


def require_websockets(purpose: str) -> None:
    """Raise MissingExtraError unless websockets is installed."""
    try:
        import websockets.asyncio.client
    except ImportError:
        raise MissingExtraError("live", purpose) from None
    del websockets
