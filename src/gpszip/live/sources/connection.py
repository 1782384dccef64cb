"""Connections to receivers in a network, which are opened again when they end."""

from __future__ import annotations

import asyncio
import contextlib
import os
import platform
import zlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

from gpszip.errors import OptionError
from gpszip.live.notices import Notices
from gpszip.live.sources.lines import read_stream_lines

__all__ = [
    "CONNECT_SECONDS",
    "RETRY_SECONDS",
    "connected_chunks",
    "connected_lines",
    "session_name",
    "split_url",
    "without_password",
]

#: Seconds between attempts to connect, at first and at most; it doubles.
RETRY_SECONDS = (0.5, 10.0)

#: Seconds that an attempt may take.
CONNECT_SECONDS = 20.0

#: Bytes of a line; those of gpsd have 10,240 at most.
_MAX_LINE_BYTES = 1 << 16

#: Bytes that are read at once.
_CHUNK_BYTES = 1 << 16


async def connected_lines(
    host: str, port: int, name: str, notices: Notices, greeting: Callable[[], bytes] | None = None
) -> AsyncIterator[list[bytes]]:
    """Yield the lines that a server sends, and an empty list where none comes for a while.

    Parameters
    ----------
    host, port : str and int
        The server. It may be off for a while.
    name : str
        What messages call it.
    notices : Notices
        Is told when the server can't be reached, and when it is back.
    greeting : callable, optional
        Returns what is sent at the start of each connection.
    """

    def read(reader: asyncio.StreamReader) -> AsyncIterator[list[bytes]]:
        return read_stream_lines(reader, _MAX_LINE_BYTES)

    async for lines in _connected(host, port, name, notices, read, greeting):
        yield lines


async def connected_chunks(
    host: str, port: int, name: str, notices: Notices
) -> AsyncIterator[list[bytes]]:
    """Yield the bytes that a server sends, as :func:`connected_lines` does lines."""
    async for chunks in _connected(host, port, name, notices, _read_chunks, None):
        yield chunks


async def _read_chunks(reader: asyncio.StreamReader) -> AsyncIterator[list[bytes]]:
    while chunk := await reader.read(_CHUNK_BYTES):
        yield [chunk]


async def _connected(
    host: str,
    port: int,
    name: str,
    notices: Notices,
    read: Callable[[asyncio.StreamReader], AsyncIterator[list[bytes]]],
    greeting: Callable[[], bytes] | None,
) -> AsyncIterator[list[bytes]]:
    """Yield what is read from a server, and connect again whenever the connection ends."""
    pause = RETRY_SECONDS[0]
    is_away = False
    while True:
        try:
            async with asyncio.timeout(CONNECT_SECONDS):
                reader, writer = await asyncio.open_connection(host, port)
        except (OSError, TimeoutError) as error:
            # Told once until the server is back.
            if not is_away:
                reason = getattr(error, "strerror", None) or str(error) or "no answer"
                notices.note("can't be reached; will be tried again", name, reason)
            is_away = True
            await asyncio.sleep(pause)
            pause = min(2 * pause, RETRY_SECONDS[1])
            continue

        # Read until the connection ends.
        if is_away:
            notices.note("connected again", name)
        try:
            if greeting is not None:
                writer.write(greeting())
            async for items in read(reader):
                pause = RETRY_SECONDS[0]
                yield items
        except OSError as error:
            notices.note("connection broken", name, error.strerror or "")
        finally:
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()
        is_away = True
        # What came last is complete.
        yield []
        await asyncio.sleep(pause)
        pause = min(2 * pause, RETRY_SECONDS[1])


def session_name(journal: str | os.PathLike[str]) -> str:
    """Return the name by which brokers know a journal of this machine again."""
    who = f"{platform.node()}:{Path(journal).resolve()}".encode("utf-8", "surrogateescape")
    return f"gpszip-{zlib.crc32(who):08x}"


def split_url(text: str, option: str, schemes: tuple[str, ...], example: str) -> SplitResult:
    """Split a URL, and check its scheme, host and port.

    Raises
    ------
    OptionError
        If it is none of these.

    Examples
    --------
    >>> split_url("tcp://gps:10110", "--nmea", ("tcp",), "tcp://gps:10110").port
    10110
    """
    try:
        url = urlsplit(text)
        if url.scheme in schemes and (url.hostname or url.scheme in ("udp", "udpin")):
            # A port that is none raises.
            _ = url.port
            return url
    except ValueError:
        pass
    raise OptionError(
        f"{option} {without_password(text)}: is no such address",
        remedy=f"give one such as {example}",
    )


def without_password(url: str) -> str:
    """Return a URL as messages and logs may show it.

    Examples
    --------
    >>> without_password("mqtt://ann:secret@host/base")
    'mqtt://host/base'
    """
    scheme, separator, rest = url.partition("://")
    host, slash, path = rest.partition("/")
    return f"{scheme}{separator}{host.rpartition('@')[2]}{slash}{path}"
