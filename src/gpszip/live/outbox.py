"""The outbox: events on disk until each sink has them, each once.

The file ``events`` in the folder of the journal has the number of the last event that it no longer
holds in its first line, and then events as lines of JSON, in the order of their numbers. Events
that a monitor finds again after the process was killed are known by their ids. ``delivered`` has
the number of the last event that each sink took.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import zlib
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

from gpszip.errors import GPSZipError, InputError
from gpszip.files.os_errors import as_output_error, explain_os_error
from gpszip.live.events import ClosableSink, Event, EventSink
from gpszip.live.notices import Notices

__all__ = ["Outbox"]

#: Names of the files.
_EVENTS = "events"
_DELIVERED = "delivered"

#: Events that wait for a sink; of more, the oldest are left out, and counted.
_MAX_WAITING = 10_000

#: Events that are sent at once.
_MAX_BATCH = 200

#: Seconds between attempts to send, at first and at most; it doubles.
_RETRY_SECONDS = (0.5, 60.0)

#: Seconds in which sinks take what is left at the end.
_END_SECONDS = 10.0


class Outbox:
    """Numbers events, and brings them to all sinks.

    Parameters
    ----------
    folder : path
        That of the journal.
    sinks : mapping of str to EventSink
        By names that stay the same when the process is started again.
    notices : Notices
        Is told what was not sent.

    Raises
    ------
    OutputError
        If the outbox can't be written.
    """

    def __init__(self, folder: Path, sinks: Mapping[str, EventSink], notices: Notices) -> None:
        self._path, self._notices = folder / _EVENTS, notices
        with as_output_error(self._path):
            self._last, kept = _read(self._path)
            self._file = self._path.open("ab")
        if not kept and not self._file.tell():
            self._write_anew([])
        self._known = {event.id for event in kept}

        # What each sink does not have yet.
        delivered = _Delivered(folder / _DELIVERED)
        self._deliveries = [
            _Delivery(name, sink, delivered, notices) for name, sink in sinks.items()
        ]
        for each in self._deliveries:
            each.add([event for event in kept if event.seq > delivered.of(each.name)])
        self._kept: deque[Event] = deque(kept)

    async def put(self, events: Sequence[Event]) -> None:
        """Keep events that are not known, and return once they are on disk.

        Raises
        ------
        OutputError
            If they can't be written.
        """
        # Number them.
        unknown = {event.id: event for event in events if event.id not in self._known}
        new = [replace(each, seq=n) for n, each in enumerate(unknown.values(), self._last + 1)]
        if not new:
            return

        # Have them on disk before anybody is told.
        await asyncio.to_thread(self._append, new)
        self._known.update(unknown)
        self._last += len(new)
        self._kept.extend(new)
        for each in self._deliveries:
            each.add(new)

    def checkpoint(self) -> None:
        """Forget events that all sinks have: the monitor will not find them again."""
        first = min((each.first for each in self._deliveries), default=self._last + 1)
        while self._kept and (self._kept[0].seq < first or len(self._kept) > _MAX_WAITING):
            self._kept.popleft()
        self._known = {event.id for event in self._kept}
        self._write_anew(self._kept)

    def start(self) -> list[asyncio.Task[None]]:
        """Begin to send; return the tasks that do."""
        return [asyncio.create_task(each.run()) for each in self._deliveries]

    async def finish(self) -> None:
        """Wait until all sinks have all events, or some seconds have passed."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_END_SECONDS):
                for each in self._deliveries:
                    await each.wait()

    async def close(self) -> None:
        """Close the sinks."""
        self._file.close()
        for each in self._deliveries:
            await each.close()

    def _append(self, events: Sequence[Event]) -> None:
        with as_output_error(self._path):
            end = self._file.tell()
            try:
                self._file.write(_encode(events))
                self._file.flush()
                os.fsync(self._file.fileno())
            except OSError:
                with contextlib.suppress(OSError):
                    self._file.truncate(end)
                raise

    def _write_anew(self, events: Sequence[Event] | deque[Event]) -> None:
        """Write the file again with some of its events."""
        first = events[0].seq if events else self._last + 1
        beside = self._path.with_suffix(".new")
        with as_output_error(self._path):
            with beside.open("wb") as file:
                file.write(b'{"before":%d}\n' % (first - 1) + _encode(events))
                file.flush()
                os.fsync(file.fileno())
            self._file.close()
            beside.replace(self._path)
            self._file = self._path.open("ab")


def _encode(events: Sequence[Event] | deque[Event]) -> bytes:
    return "".join(f"{event.to_json()}\n" for event in events).encode("ascii")


def _read(path: Path) -> tuple[int, list[Event]]:
    """Return the number of the last event, and the events of a file; cut off what is torn."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return 0, []
    end = data.rfind(b"\n") + 1
    if end < len(data):
        os.truncate(path, end)

    # A line that can't be read is a matter of one event.
    head, *lines = data[:end].splitlines() or [b""]
    last, events = 0, []
    with contextlib.suppress(ValueError, KeyError, TypeError):
        last = int(json.loads(head)["before"])
    for line in lines:
        with contextlib.suppress(InputError):
            events.append(Event.from_json(line))
    return max([last, *(event.seq for event in events)]), events


class _Delivered:
    """The number of the last event that each sink took, on disk."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._numbers: dict[str, int] = {}
        with contextlib.suppress(OSError, ValueError):
            found = json.loads(path.read_bytes())
            self._numbers = {str(name): int(number) for name, number in found.items()}

    def of(self, name: str) -> int:
        return self._numbers.get(_short(name), 0)

    def set(self, name: str, number: int) -> None:
        """Note it; if the disk is full, the events are sent again after a restart."""
        self._numbers[_short(name)] = number
        beside = self._path.with_suffix(".new")
        with contextlib.suppress(OSError):
            beside.write_text(json.dumps(self._numbers))
            beside.replace(self._path)


def _short(name: str) -> str:
    # Addresses may hold passwords.
    return f"{zlib.crc32(name.encode('utf-8', 'surrogateescape')):08x}"


def _describe(name: str) -> str:
    """Say which sink it is, without passwords and paths, which may be secret, too."""
    if name == "-":
        return "standard output"
    url = urlsplit(name)
    return f"{url.scheme}://{url.netloc.rpartition('@')[2]}" if "://" in name else name


class _Delivery:
    """Sends events to one sink, in their order, again and again until it takes them."""

    def __init__(self, name: str, sink: EventSink, delivered: _Delivered, notices: Notices) -> None:
        self.name = name
        self._sink, self._delivered, self._notices = sink, delivered, notices
        self._waiting: deque[Event] = deque()
        self._sending: list[Event] = []
        self._wake, self._idle = asyncio.Event(), asyncio.Event()
        self._idle.set()

    @property
    def first(self) -> int:
        """Number of the first event that the sink does not have; a large one if it has all."""
        queue = self._sending or self._waiting
        return queue[0].seq if queue else 1 << 62

    def add(self, events: Sequence[Event]) -> None:
        """Let events wait; of too many, the oldest are left out."""
        self._waiting.extend(events)
        excess = len(self._waiting) - _MAX_WAITING
        for _ in range(max(excess, 0)):
            self._waiting.popleft()
        if excess > 0:
            self._notices.count("events left out, as they could not be sent", excess)
        if self._waiting:
            self._idle.clear()
            self._wake.set()

    async def run(self) -> None:
        """Send what waits, until the task is cancelled."""
        while True:
            await self._wake.wait()
            while self._waiting or self._sending:
                # What was being sent when the task was cancelled is sent again.
                count = 0 if self._sending else min(len(self._waiting), _MAX_BATCH)
                self._sending += [self._waiting.popleft() for _ in range(count)]
                await self._send()
                self._delivered.set(self.name, self._sending[-1].seq)
                self._sending = []
            self._wake.clear()
            self._idle.set()

    async def wait(self) -> None:
        """Wait until nothing is left to send."""
        await self._idle.wait()

    async def close(self) -> None:
        """Close the sink."""
        if isinstance(self._sink, ClosableSink):
            with contextlib.suppress(OSError):
                await self._sink.close()

    async def _send(self) -> None:
        """Send a batch until the sink takes or refuses it."""
        pause = _RETRY_SECONDS[0]
        while True:
            # An OSError may pass; another error is a refusal for good.
            try:
                await self._sink.send(self._sending)
            except OSError as error:
                reason = error.strerror and explain_os_error(error)
                where = _describe(self.name)
                self._notices.note("events not sent yet", where, reason or str(error))
                await asyncio.sleep(pause)
                pause = min(2 * pause, _RETRY_SECONDS[1])
                continue
            except GPSZipError as error:
                self._notices.note("events refused", _describe(self.name), error.detail)
                self._notices.count("events left out, as they were refused", len(self._sending))
            else:
                self._notices.count("events sent", len(self._sending))
            return
