"""Vehicles that speak MAVLink: over UDP, over TCP, or by a serial device.

The listener steers nothing. It says that it is there only to a server that it asks over UDP.
"""

from __future__ import annotations

import asyncio
import os
import stat
import time
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

from gpszip.errors import InputError, MissingExtraError, OptionError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.mavlink import MavlinkParser
from gpszip.live.notices import Notices
from gpszip.live.source import FixSource, Receiver
from gpszip.live.sources.connection import connected_chunks, split_url
from gpszip.live.sources.datagrams import Datagrams
from gpszip.live.sources.lines import store_patiently
from gpszip.live.sources.stdin import read_descriptor_chunks

__all__ = ["open_mavlink", "require_pymavlink"]

#: Ports of ground stations over UDP, and of simulators and routers over TCP.
_UDP_PORT = 14_550
_TCP_PORT = 5_760

#: Senders of datagrams whose packets are kept apart.
_MAX_SENDERS = 256

#: Seconds between the messages that tell a server over UDP that somebody listens.
_HEARTBEAT_SECONDS = 1.0

#: Seconds between attempts to find a server over UDP.
_RETRY_SECONDS = 5.0

#: System and component of the listener: neither a ground station, which is 255 and whose absence
#: vehicles act on, nor a vehicle.
_OWN_SYSTEM = 245
_OWN_COMPONENT = 155

#: What follows an address where positions are wanted in metres.
_LOCAL = "?frame=local"

_EXAMPLE = "udp://:14550, udpout://192.168.1.5:14550, tcp://192.168.1.5:5760 or /dev/ttyACM0"


def open_mavlink(text: str, name: str, notices: Notices) -> FixSource:
    """Open a link.

    Parameters
    ----------
    text : str
        ``udp://[HOST]:PORT`` or ``udpin://`` to listen at, ``udpout://HOST:PORT`` to ask a server,
        ``tcp://HOST:PORT`` to connect to, or a path; ``?frame=local`` behind it for positions in
        metres.
    name : str
        First part of the names of agents, ``mavlink`` where it is empty.
    notices : Notices
        Is told what happens.

    Raises
    ------
    MissingExtraError
        If pymavlink is not installed.
    OptionError
        If the address can't be used.
    InputError
        If the device can't be opened.
    """
    require_pymavlink("--mavlink")
    address, local, rest = text.partition(_LOCAL)
    parser = MavlinkParser(name or "mavlink", notices, local=bool(local))
    if "://" not in address:
        return _DeviceSource(text if rest else address, parser, notices)

    # A network.
    url = split_url(address, "--mavlink", ("udp", "udpin", "udpout", "tcp"), _EXAMPLE)
    if url.query or rest:
        raise OptionError(f"--mavlink {text}: no such choice", remedy=f"add {_LOCAL}, or nothing")
    host = url.hostname or "0.0.0.0"
    if url.scheme == "tcp":
        return _TcpSource(host, url.port or _TCP_PORT, parser, notices)
    is_server = url.scheme == "udpout"
    return _UdpSource(host, url.port or _UDP_PORT, parser, notices, is_server=is_server)


def require_pymavlink(purpose: str) -> None:
    """Raise MissingExtraError unless pymavlink is installed."""
    try:
        import pymavlink.dialects.v20.common
    except ImportError:
        raise MissingExtraError("mavlink", purpose) from None
    del pymavlink


class Packets:
    """Finds packets in the bytes of one link, and the fixes in them.

    Parameters
    ----------
    parser : MavlinkParser
        Takes the messages.
    """

    def __init__(self, parser: MavlinkParser) -> None:
        from pymavlink.dialects.v20 import common

        self._parser = parser
        self._decoder: Any = common.MAVLink(None)
        self._decoder.robust_parsing = True

    def push(self, data: bytes, received: float) -> list[Fix | Unusable]:
        """Take bytes, and return the fixes of the packets that they complete."""
        found: list[Fix | Unusable] = []
        for message in self._decoder.parse_buffer(data) or ():
            found += self._parser.parse(message, received)
        return found


class _TcpSource:
    """A simulator or router that clients connect to."""

    def __init__(self, host: str, port: int, parser: MavlinkParser, notices: Notices) -> None:
        self._host, self._port, self._parser, self._notices = host, port, parser, notices

    async def run(self, receiver: Receiver) -> None:
        """Store fixes until the task is cancelled."""
        packets = Packets(self._parser)
        async for chunks in connected_chunks(self._host, self._port, self._host, self._notices):
            for chunk in chunks:
                await store_patiently(receiver, packets.push(chunk, time.time()))


class _DeviceSource:
    """A serial device, a pipe or a file with the bytes of one, to its end."""

    def __init__(self, path: str, parser: MavlinkParser, notices: Notices) -> None:
        try:
            self._descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOCTTY", 0))
        except OSError as error:
            raise InputError(
                f"can't be opened: {error.strerror}", path=path, remedy=f"give {_EXAMPLE}"
            ) from error
        self._path, self._parser, self._notices = path, parser, notices

    async def run(self, receiver: Receiver) -> None:
        """Store all fixes."""
        packets = Packets(self._parser)
        async for chunk in read_descriptor_chunks(self._descriptor):
            if chunk is not None:
                await store_patiently(receiver, packets.push(chunk, time.time()))
        if stat.S_ISCHR(os.fstat(self._descriptor).st_mode):
            self._notices.note("the device is gone", self._path)
        os.close(self._descriptor)


class _UdpSource:
    """Vehicles that send datagrams, or a server that does when it is asked."""

    def __init__(
        self, host: str, port: int, parser: MavlinkParser, notices: Notices, *, is_server: bool
    ) -> None:
        self._address, self._parser, self._notices = (host, port), parser, notices
        self._is_server = is_server
        self._packets: OrderedDict[tuple[str, int], Packets] = OrderedDict()

    async def run(self, receiver: Receiver) -> None:
        """Store fixes until the task is cancelled."""
        datagrams = await self._open()
        asking = asyncio.create_task(self._ask(datagrams))
        try:
            while True:
                await store_patiently(receiver, self._parse(await datagrams.take()))
        finally:
            asking.cancel()
            await asyncio.wait([asking])
            datagrams.close()

    async def _open(self) -> Datagrams:
        """Listen, or find the server."""
        if not self._is_server:
            return await Datagrams.listen(*self._address, "--mavlink", self._notices)
        while True:
            try:
                return await Datagrams.connect(*self._address, self._notices)
            except OSError as error:
                event = "can't be reached; will be tried again"
                self._notices.note(event, self._address[0], error.strerror or "")
                await asyncio.sleep(_RETRY_SECONDS)

    async def _ask(self, datagrams: Datagrams) -> None:
        """Tell the server each second that somebody listens."""
        while self._is_server:
            datagrams.send(heartbeat())
            await asyncio.sleep(_HEARTBEAT_SECONDS)

    def _parse(self, waiting: Sequence[tuple[bytes, tuple[str, int]]]) -> list[Fix | Unusable]:
        """Return the fixes of datagrams, each sender's bytes by themselves."""
        found: list[Fix | Unusable] = []
        for data, sender in waiting:
            if sender not in self._packets:
                self._packets[sender] = Packets(self._parser)
                if len(self._packets) > _MAX_SENDERS:
                    self._packets.popitem(last=False)
            self._packets.move_to_end(sender)
            found += self._packets[sender].push(data, time.time())
        return found


def heartbeat() -> bytes:
    """Return a packet that says that the listener is there, and is no ground station."""
    from pymavlink.dialects.v20 import common

    link: Any = common.MAVLink(None, _OWN_SYSTEM, _OWN_COMPONENT)
    message = link.heartbeat_encode(
        common.MAV_TYPE_ONBOARD_CONTROLLER,
        common.MAV_AUTOPILOT_INVALID,
        0,
        0,
        common.MAV_STATE_ACTIVE,
    )
    packed: bytes = message.pack(link)
    return packed
