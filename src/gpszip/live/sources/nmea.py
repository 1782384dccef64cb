"""Receivers that write NMEA 0183: over TCP, over UDP, or to a file, a pipe or a serial device."""

from __future__ import annotations

import asyncio
import os
import stat
import time
from collections import OrderedDict

from gpszip.errors import InputError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.nmea import NmeaParser
from gpszip.live.formats.values import Context
from gpszip.live.notices import Notices
from gpszip.live.source import FixSource, Receiver
from gpszip.live.sources.connection import connected_lines, split_url
from gpszip.live.sources.datagrams import Datagrams
from gpszip.live.sources.lines import IDLE_SECONDS, store_lines, store_patiently
from gpszip.live.sources.stdin import read_descriptor_lines

__all__ = ["open_nmea"]

#: The port on which ships send NMEA.
_PORT = 10_110

#: Senders of datagrams whose epochs are kept apart.
_MAX_SENDERS = 256

_EXAMPLE = "tcp://192.168.1.5:10110, udp://:10110 or /dev/ttyUSB0"


def open_nmea(text: str, name: str, notices: Notices) -> FixSource:
    """Open a receiver.

    Parameters
    ----------
    text : str
        ``tcp://HOST:PORT`` to connect to, ``udp://[HOST]:PORT`` to listen at, or a path.
    name : str
        Name of the agent; where it is empty, that of the host or of the path.
    notices : Notices
        Is told what happens.

    Raises
    ------
    OptionError
        If the address can't be used.
    InputError
        If the file can't be opened.
    """
    if "://" not in text:
        return _FileSource(text, name or os.path.basename(text), notices)  # noqa: PTH119
    url = split_url(text, "--nmea", ("tcp", "udp"), _EXAMPLE)
    host, port = url.hostname or "0.0.0.0", url.port or _PORT
    if url.scheme == "tcp":
        return _TcpSource(host, port, name or host, notices)
    return _UdpSource(host, port, name, notices)


def _context(received: float) -> Context:
    return Context(received, "nmea")


class _FileSource:
    """A file, pipe or device, to its end."""

    def __init__(self, path: str, name: str, notices: Notices) -> None:
        if os.path.isdir(path):  # noqa: PTH112
            raise InputError("is a folder", path=path, remedy=f"give {_EXAMPLE}")
        try:
            self._descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOCTTY", 0))
        except OSError as error:
            raise InputError(
                f"can't be opened: {error.strerror}", path=path, remedy=f"give {_EXAMPLE}"
            ) from error
        self._name, self._notices = name, notices

    async def run(self, receiver: Receiver) -> None:
        """Store all fixes."""
        lines = read_descriptor_lines(self._descriptor)
        await store_lines(lines, NmeaParser(self._name), receiver, _context)
        # Files end, devices don't.
        if stat.S_ISCHR(os.fstat(self._descriptor).st_mode):
            self._notices.note("the device is gone", self._name)
        # A file that is still read can't be closed: another one might get its number.
        os.close(self._descriptor)


class _TcpSource:
    """A receiver that clients connect to."""

    def __init__(self, host: str, port: int, name: str, notices: Notices) -> None:
        self._host, self._port, self._name, self._notices = host, port, name, notices

    async def run(self, receiver: Receiver) -> None:
        """Store fixes until the task is cancelled."""
        lines = connected_lines(self._host, self._port, self._name, self._notices)
        await store_lines(lines, NmeaParser(self._name), receiver, _context)


class _UdpSource:
    """Receivers that send datagrams, each with whole sentences."""

    def __init__(self, host: str, port: int, name: str, notices: Notices) -> None:
        self._address, self._name, self._notices = (host, port), name, notices
        self._parsers: OrderedDict[str, NmeaParser] = OrderedDict()

    async def run(self, receiver: Receiver) -> None:
        """Store fixes until the task is cancelled."""
        datagrams = await Datagrams.listen(*self._address, "--nmea", self._notices)

        # Store what comes.
        try:
            while True:
                await store_patiently(receiver, await self._next(datagrams))
        finally:
            datagrams.close()

    async def _next(self, datagrams: Datagrams) -> list[Fix | Unusable]:
        """Return what the next datagrams hold, or what is complete as none comes."""
        found: list[Fix | Unusable] = []
        try:
            async with asyncio.timeout(IDLE_SECONDS):
                waiting = await datagrams.take()
        except TimeoutError:
            for parser in self._parsers.values():
                found += parser.finish(_context(time.time()))
            return found
        for data, (sender, _) in waiting:
            parser = self._parser(sender)
            for line in data.splitlines():
                found += parser.push(line, _context(time.time()))
        return found

    def _parser(self, sender: str) -> NmeaParser:
        """The parser of a sender, whose epochs are no others'."""
        if sender not in self._parsers:
            self._parsers[sender] = NmeaParser(self._name or sender)
            if len(self._parsers) > _MAX_SENDERS:
                self._parsers.popitem(last=False)
        self._parsers.move_to_end(sender)
        return self._parsers[sender]
