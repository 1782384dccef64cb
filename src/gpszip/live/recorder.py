"""The recorder: it takes fixes of all sources, and has them on disk before it returns.

Fixes that come while others are written wait, and are written together: one flush to disk serves
them all.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from gpszip.errors import OutputError
from gpszip.live.fix import Fix, Marks, Unusable
from gpszip.live.journal import Journal
from gpszip.live.notices import Notices
from gpszip.live.screening import Screen
from gpszip.live.seen import Seen, Verdict

__all__ = ["Observer", "Recorder"]

#: Fixes that are written at once, at most.
_MAX_BATCH = 20_000

#: Items that are screened without a break, which takes 17 ms.
_MAX_SCREENED = 10_000

#: What each verdict on a fix that is left out is counted as.
_LEFT_OUT = {
    Verdict.REPEAT: "repeated fixes left out",
    Verdict.WORSE: "fixes at the time of another one, elsewhere and no more accurate, left out",
}


class Observer(Protocol):
    """Follows what a recorder does."""

    def wake(self) -> None:
        """Note that the journal has new fixes."""
        ...

    def refuse(self, fix: Fix) -> None:
        """Note that a fix was refused, and is not in the journal."""
        ...


class Recorder:
    """Screens fixes, leaves out repeats, and writes the others to a journal.

    Parameters
    ----------
    journal : Journal
        Where fixes go. Those that it holds already are known.
    notices : Notices
        Is told what happens.

    Attributes
    ----------
    observer : Observer or None
        Is told when the journal has new fixes.
    watcher : callable or None
        Gets the fixes that were stored, such as those that a page shows.
    """

    def __init__(self, journal: Journal, notices: Notices) -> None:
        self._journal, self._notices = journal, notices
        self.observer: Observer | None = None
        self.watcher: Callable[[Sequence[Fix]], None] | None = None
        self._seen = Seen()
        self._waiting: list[tuple[list[Fix], asyncio.Future[None]]] = []
        self._writer: asyncio.Task[None] | None = None
        self.last_received: float | None = None
        self.last_error: str | None = None

        # What was stored before the process was killed is known again.
        self._screen = Screen(notices)
        for fix in journal.recent():
            self._seen.add(fix)
            self._screen.remember(fix)
        if journal.torn:
            notices.note("record cut off when the process was killed; removed")
        for _ in range(journal.damaged):
            notices.note("damaged records of the journal passed over")

    async def store(self, items: Sequence[Fix | Unusable]) -> None:
        """Return once all fixes that can be used are on disk.

        Raises
        ------
        OutputError
            If they can't be written.
        """
        # Tell of what is none.
        fixes: list[Fix] = []
        for number, item in enumerate(items, 1):
            if number % _MAX_SCREENED == 0:
                # Others are answered between the parts of a day's log.
                await asyncio.sleep(0)
            if isinstance(item, Unusable):
                self._notices.note(item.reason, item.agent, item.value)
                continue
            screened = self._screen.check(item)
            if screened is not None:
                fixes.append(screened)
            elif self.observer is not None:
                self.observer.refuse(item)
        if not fixes:
            return

        # Wait for the writer, even if the sender goes away meanwhile.
        done = asyncio.get_running_loop().create_future()
        self._waiting.append((fixes, done))
        if self._writer is None:
            self._writer = asyncio.create_task(self._write())
        await asyncio.shield(done)

    async def finish(self) -> None:
        """Wait until all that was taken is on disk."""
        if self._writer is not None:
            await self._writer

    async def _write(self) -> None:
        """Write what waits, batch by batch."""
        try:
            while self._waiting:
                await self._write_batch()
        finally:
            self._writer = None

    async def _write_batch(self) -> None:
        """Write a batch, and answer its senders: none must wait for an answer in vain."""
        # Take as many as go into one batch.
        taken: list[tuple[list[Fix], asyncio.Future[None]]] = []
        size = 0
        while self._waiting and size < _MAX_BATCH:
            taken.append(self._waiting.pop(0))
            size += len(taken[-1][0])
        fixes = self._new_fixes([fix for group, _ in taken for fix in group])

        # Write them beside the event loop, which answers others meanwhile.
        error: OutputError | None = None
        try:
            await asyncio.to_thread(self._journal.append, fixes)
        except OutputError as failed:
            error = failed
        except Exception as failed:
            error = OutputError(str(failed), location=type(failed).__name__)

        # Count them, and answer.
        try:
            self._conclude(fixes, error)
        finally:
            for _, done in taken:
                if not done.cancelled():
                    _answer(done, error)

    def _new_fixes(self, fixes: Sequence[Fix]) -> list[Fix]:
        """Return fixes without repeats of stored ones and of each other."""
        new: dict[tuple[str, float], Fix] = {}
        for fix in fixes:
            verdict = self._seen.judge(fix)
            other = new.get((fix.agent, fix.time))
            if other is not None:
                verdict = _compare(other, fix)
            if verdict in _LEFT_OUT:
                self._notices.count(_LEFT_OUT[verdict])
                continue
            if verdict is Verdict.BETTER:
                self._notices.count("fixes replaced by a more accurate one at the same time")
            new[fix.agent, fix.time] = fix
        return list(new.values())

    def _conclude(self, fixes: Sequence[Fix], error: OutputError | None) -> None:
        """Keep in mind what was stored, or tell that nothing was."""
        # Nothing.
        if error is not None:
            # Monitors need no token, so that they see no paths.
            self.last_error = f"not stored: {error.reason}"
            self._notices.note(f"not stored: {error.detail}")
            return

        # What was stored is known, and others hear of it.
        self.last_error = None
        for fix in fixes:
            self._seen.add(fix)
        if fixes:
            self.last_received = time.time()
            if self.observer is not None:
                self.observer.wake()
            if self.watcher is not None:
                self.watcher(fixes)
            self._notices.count("stored", len(fixes))
            stale = sum(Marks.STALE in fix.quality for fix in fixes)
            if stale:
                self._notices.count("fixes older than an hour when they came", stale)


def _answer(done: asyncio.Future[None], error: OutputError | None) -> None:
    if error is None:
        done.set_result(None)
        return
    # A sender that is gone doesn't look at its error.
    done.set_exception(error)
    done.exception()


def _compare(known: Fix, fix: Fix) -> Verdict:
    """Compare two fixes of one agent and time that come together."""
    if known.position == fix.position:
        return Verdict.REPEAT
    if fix.accuracy is None or (known.accuracy is not None and known.accuracy <= fix.accuracy):
        return Verdict.WORSE
    return Verdict.BETTER
