"""Datagrams of UDP, of which some are lost if they come faster than they are stored."""

from __future__ import annotations

import asyncio
from typing import Any

from gpszip.errors import OptionError
from gpszip.live.notices import Notices

__all__ = ["Datagrams"]

#: Datagrams that wait to be stored, and their bytes; of more, the oldest go, as UDP has no other
#: way.
_MAX_WAITING = 10_000
_MAX_BYTES = 16 << 20

#: A datagram, and host and port of its sender.
Datagram = tuple[bytes, tuple[str, int]]


class Datagrams(asyncio.DatagramProtocol):
    """Takes datagrams as they come.

    Parameters
    ----------
    notices : Notices
        Is told of those that are lost.
    """

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._queue: asyncio.Queue[Datagram] = asyncio.Queue()
        self._bytes = 0
        self._transport: asyncio.DatagramTransport | None = None

    @classmethod
    async def listen(cls, host: str, port: int, option: str, notices: Notices) -> Datagrams:
        """Listen at a port.

        Raises
        ------
        OptionError
            If that can't be done.
        """
        loop = asyncio.get_running_loop()
        try:
            transport, datagrams = await loop.create_datagram_endpoint(
                lambda: cls(notices), local_addr=(host, port)
            )
        except OSError as error:
            raise OptionError(
                f"can't listen at {host}:{port}: {error.strerror or error}",
                remedy=f"name another port with {option}",
            ) from error
        datagrams._transport = transport
        return datagrams

    @classmethod
    async def connect(cls, host: str, port: int, notices: Notices) -> Datagrams:
        """Exchange datagrams with a server.

        Raises
        ------
        OSError
            If its name can't be found.
        """
        loop = asyncio.get_running_loop()
        transport, datagrams = await loop.create_datagram_endpoint(
            lambda: cls(notices), remote_addr=(host, port)
        )
        datagrams._transport = transport
        return datagrams

    async def take(self) -> list[Datagram]:
        """Wait for a datagram, and return all that have come."""
        waiting = [await self._queue.get()]
        while not self._queue.empty():
            waiting.append(self._queue.get_nowait())
        self._bytes = 0
        return waiting

    def send(self, data: bytes) -> None:
        """Send a datagram to the server."""
        if self._transport is not None:
            self._transport.sendto(data)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """Take a datagram."""
        self._bytes += len(data)
        while self._queue.qsize() >= _MAX_WAITING or (
            self._bytes > _MAX_BYTES and not self._queue.empty()
        ):
            self._bytes -= len(self._queue.get_nowait()[0])
            self._notices.note("datagrams lost, as they came faster than they were stored")
        self._queue.put_nowait((data, (str(addr[0]), int(addr[1]))))
