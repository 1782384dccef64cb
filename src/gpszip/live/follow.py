"""From the journal to events: each fix is on disk before its events are found.

The follower reads the journal behind its writer, so that fixes which wait for the monitor take no
memory. What the monitor knows is saved in the folder of the journal, with the place in the journal
up to which it read: when the process was killed, it reads on from there, finds the same events with
the same ids again, and the outbox knows those that it has.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import time
from collections.abc import Coroutine, Iterable
from pathlib import Path
from typing import IO, Any

from gpszip.errors import OutputError
from gpszip.files.os_errors import as_output_error
from gpszip.live.events import Event
from gpszip.live.fix import Fix
from gpszip.live.journal import Journal, decode_record, segments
from gpszip.live.monitor.monitor import Monitor
from gpszip.live.monitor.sources import MAX_AHEAD
from gpszip.live.notices import Notices
from gpszip.live.outbox import Outbox
from gpszip.live.place_read import PlaceRead, read_place, state_error, state_path

__all__ = ["Follower"]

#: First line of a segment.
_HEADER = b"gpszip journal 1\n"

#: Fixes that are read at once; at 1 ms each, others are answered meanwhile.
_MAX_READ = 200

#: Bytes of a line that are read.
_MAX_LINE_BYTES = 1 << 16

#: Seconds between two looks at the journal.
_PERIOD = 1.0

#: Seconds between two savings of the state, at least, and as a multiple of what one takes.
_SAVE_SECONDS = 30.0
_SAVE_FACTOR = 50.0

#: Seconds by which time passes later for the monitor: fixes that were received before are in the
#: journal by then. So it finds the same when it reads the journal again.
_TICK_LAG = 2.0

#: Seconds until events are tried again that the disk did not take.
_RETRY_SECONDS = 1.0


class Follower:
    """Reads a journal while it is written, and brings its events to the outbox.

    Parameters
    ----------
    journal : Journal
        Where fixes are.
    monitor : Monitor
        Finds events; takes over the state that was saved.
    outbox : Outbox
        Takes them.
    notices : Notices
        Is told what happens.
    """

    def __init__(
        self, journal: Journal, monitor: Monitor, outbox: Outbox, notices: Notices
    ) -> None:
        self._folder, self._monitor = journal.folder, monitor
        self._outbox, self._notices = outbox, notices
        self._reader = _JournalReader(self._folder)
        self._new = asyncio.Event()
        self._passed = asyncio.Condition()
        self._turn = asyncio.Lock()
        self._work: asyncio.Future[bool] | None = None
        self._next_save = time.monotonic() + _SAVE_SECONDS
        self._refused: list[tuple[str, float, float]] = []
        self._counted: dict[str, int] = {}
        self._restore()

    def wake(self) -> None:
        """Say that the journal has new fixes."""
        self._new.set()

    def refuse(self, fix: Fix) -> None:
        """Say that a fix was refused, and is not in the journal: its time may tell something."""
        if fix.time - fix.received <= MAX_AHEAD:
            return
        self._refused.append((fix.agent, fix.time, fix.received))
        del self._refused[:-_MAX_READ]

    async def run(self) -> None:
        """Follow the journal until the task is cancelled."""
        # What the last process stored; then no agent was heard of as long as nobody listened.
        while await self._whole(self._step()):
            pass
        self._monitor.resume(time.time())
        while True:
            while await self._whole(self._step()):
                pass
            await self._whole(self._tick())
            if time.monotonic() >= self._next_save:
                await self.save()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_PERIOD):
                    await self._new.wait()
            self._new.clear()

    async def pass_segments(self) -> None:
        """Return once all segments but the last are read, and need not be read again."""
        complete = segments(self._folder)[:-1]
        if not complete:
            return
        last = int(complete[-1].stem)
        async with self._passed:
            await self._passed.wait_for(lambda: self._reader.segment > last)
        await self.save()

    async def finish(self, *, is_over: bool) -> None:
        """Read what is left, and save the state.

        Parameters
        ----------
        is_over : bool
            Whether no source goes on: then fixes don't wait for earlier ones.
        """
        while await self._whole(self._step()):
            pass
        if is_over:
            await self._put(await asyncio.to_thread(self._monitor.close))
        await self.save()
        self._reader.close()

    async def save(self) -> None:
        """Save what the monitor knows, so that older fixes need not be read again."""
        await self._whole(self._save())

    async def _whole(self, work: Coroutine[Any, Any, bool]) -> bool:
        """Do some work to its end, also if the task is cancelled: threads can't be stopped.

        Only one piece of work is done at a time.
        """
        async with self._turn:
            if self._work is not None and not self._work.done():
                await self._work
            self._work = asyncio.ensure_future(work)
            return await asyncio.shield(self._work)

    async def _tick(self) -> bool:
        """Let time pass."""
        await self._put(await asyncio.to_thread(self._monitor.tick, time.time() - _TICK_LAG))
        return True

    async def _save(self) -> bool:
        begin = time.monotonic()
        try:
            await asyncio.to_thread(self._write_state)
            await asyncio.to_thread(self._outbox.checkpoint)
        except (OutputError, OSError) as error:
            # On a full disk, more is read again after a restart.
            reason = error.detail if isinstance(error, OutputError) else str(error)
            self._notices.note("state of the monitor not saved", value=reason)
        taken = time.monotonic() - begin
        self._next_save = time.monotonic() + max(_SAVE_SECONDS, _SAVE_FACTOR * taken)
        return True

    async def _step(self) -> bool:
        """Read some fixes, and bring their events to the outbox; return whether there were any."""
        refused, self._refused = self._refused, []
        for item in refused:
            await self._put(self._monitor.refuse(*item))
        before = self._reader.segment
        fixes = self._reader.read(_MAX_READ)
        if self._reader.segment != before:
            async with self._passed:
                self._passed.notify_all()
        if fixes:
            await self._put(await asyncio.to_thread(self._find, fixes))
            self._count()
        return bool(fixes)

    def _find(self, fixes: Iterable[Fix]) -> list[Event]:
        events: list[Event] = []
        for fix in fixes:
            try:
                events += self._monitor.push(fix)
            except Exception as error:
                # A fix that nobody foresaw must not end the listener.
                self._notices.note("no events found", fix.agent, f"{type(error).__name__}: {error}")
        return events

    async def _put(self, events: list[Event]) -> None:
        """Bring events to the outbox, again and again while the disk is full."""
        while events:
            try:
                await self._outbox.put(events)
            except OutputError as error:
                self._notices.note("events not stored yet", value=error.reason)
                await asyncio.sleep(_RETRY_SECONDS)
                continue
            self._notices.count("events", len(events))
            return

    def _count(self) -> None:
        """Count what the monitor left out."""
        for what, number in self._monitor.counts.items():
            self._notices.count(what, number - self._counted.get(what, 0))
            self._counted[what] = number

    def _write_state(self) -> None:
        path = state_path(self._folder)
        beside = path.with_suffix(".new")
        with as_output_error(path):
            with beside.open("w", encoding="ascii") as file:
                file.write(PlaceRead(self._reader.segment, self._reader.offset).to_json() + "\n")
                for row in self._monitor.states():
                    file.write(json.dumps(row, separators=(",", ":")) + "\n")
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)

    def _restore(self) -> None:
        """Take over the state that was saved; without one, the journal is read from its start."""
        # From now on, no segment is archived before it is read.
        place = read_place(self._folder)
        if place is None:
            self._write_state()
            return
        try:
            with state_path(self._folder).open(encoding="ascii") as file:
                next(file)
                self._monitor.restore(json.loads(line) for line in file)
        except (OSError, ValueError, KeyError, TypeError, StopIteration, RuntimeError) as error:
            raise state_error(self._folder) from error
        self._reader.segment, self._reader.offset = place


class _JournalReader:
    """Reads the segments of a journal one after the other, as far as they are written."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._opened = 0
        self.segment = 0
        self.offset = 0

    def read(self, count: int) -> list[Fix]:
        """Return the next fixes, as many as there are up to a number."""
        found: list[Fix] = []
        while len(found) < count:
            if not self._open():
                break

            # A whole line.
            assert self._file is not None
            line = self._file.readline(_MAX_LINE_BYTES)
            if line.endswith(b"\n"):
                self.offset += len(line)
                fix = decode_record(line) if line != _HEADER else None
                if fix is not None:
                    found.append(fix)
                continue

            # The end of what is written, or of the segment.
            self._file.seek(self.offset)
            if not self._next():
                break
        return found

    def close(self) -> None:
        """Close the segment; it is opened again when it is read."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _open(self) -> bool:
        """Open the segment that is read; return whether there is one."""
        if self._file is not None and self._opened == self.segment:
            return True
        numbers = [int(path.stem) for path in segments(self._folder)]
        later = [number for number in numbers if number >= self.segment]
        if not later:
            return False

        # Segments before it may have been archived and deleted.
        if later[0] != self.segment:
            self.segment, self.offset = later[0], 0
        self.close()
        with contextlib.suppress(FileNotFoundError):
            path = next(p for p in segments(self._folder) if int(p.stem) == self.segment)
            self._file = path.open("rb")
            self._file.seek(self.offset)
            self._opened = self.segment
            return True
        return False

    def _next(self) -> bool:
        """Go on to the next segment, if there is one; then this one is complete."""
        later = [int(path.stem) for path in segments(self._folder)]
        later = [number for number in later if number > self.segment]
        if not later or self._file is None:
            return False
        # What was written before the next one began.
        line = self._file.readline(_MAX_LINE_BYTES)
        if line.endswith(b"\n"):
            self._file.seek(self.offset)
            return True
        self.close()
        self.segment, self.offset = later[0], 0
        return True
