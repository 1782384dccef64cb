"""Listening: sources run side by side until they end, or until the program is told to stop."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from gpszip.files.os_errors import explain_os_error
from gpszip.live.follow import Follower
from gpszip.live.journal import Journal
from gpszip.live.notices import Notices
from gpszip.live.outbox import Outbox
from gpszip.live.page.server import PageServer
from gpszip.live.recorder import Recorder
from gpszip.live.source import FixSource

__all__ = ["Rolling", "listen"]

#: Seconds in which sources end after they are cancelled.
_END_SECONDS = 10.0


class Rolling:
    """Appends the journal to an archive from time to time, in a process of its own.

    The process takes the time and memory that compression takes; the listener goes on meanwhile.

    Parameters
    ----------
    every : float
        Seconds from one start to the next.
    command : sequence of str
        Arguments of Python for the process.
    """

    def __init__(self, every: float, command: Sequence[str]) -> None:
        self.every = every
        self._command = tuple(command)

    async def run(
        self, journal: Journal, notices: Notices, follower: Follower | None = None
    ) -> None:
        """Roll again and again, until the task is cancelled."""
        while True:
            await asyncio.sleep(self.every)
            try:
                if not await asyncio.to_thread(journal.advance):
                    continue
                if follower is not None:
                    # What is archived is deleted, so its events must have been found.
                    await follower.pass_segments()
                error = await self._roll()
            except OSError as failed:
                # Without memory for another process, the listener goes on.
                error = explain_os_error(failed)
            if error is None:
                notices.count("times that the journal was archived")
            else:
                notices.note("journal not archived", value=error)

    async def _roll(self) -> str | None:
        """Archive the journal; return the error of the process, None if it had none."""
        # Start the process; in a session of its own, Ctrl-C does not reach it.
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *self._command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
        )

        # Wait for it; it ends with the listener.
        try:
            _, told = await process.communicate()
        except asyncio.CancelledError:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            await process.wait()
            raise

        # The last line that it wrote says what is wrong.
        if process.returncode == 0:
            return None
        lines = told.decode("utf-8", "replace").strip().splitlines()
        return lines[-1] if lines else f"exit code {process.returncode}"


async def listen(
    sources: Sequence[FixSource],
    journal: Journal,
    recorder: Recorder,
    notices: Notices,
    rolling: Rolling | None = None,
    events: tuple[Follower, Outbox] | None = None,
    page: PageServer | None = None,
) -> None:
    """Run all sources; return when they have ended, or at SIGINT or SIGTERM.

    Parameters
    ----------
    sources : sequence of FixSource
        Where fixes come from.
    journal : Journal
        Where they go.
    recorder : Recorder
        Takes them there.
    notices : Notices
        Is told what happens.
    rolling : Rolling, optional
        Appends the journal to an archive from time to time.
    events : tuple of Follower and Outbox, optional
        Find the events of the journal, and send them.
    page : PageServer, optional
        Shows what happens in browsers.

    Raises
    ------
    GPSZipError
        If a source can't go on.
    """
    stop = asyncio.Event()
    with _stop_at_signals(stop):
        running = [asyncio.create_task(source.run(recorder)) for source in sources]
        beside: list[asyncio.Task[Any]] = [asyncio.create_task(stop.wait())]
        if events is not None:
            recorder.observer = events[0]
            beside += [asyncio.create_task(events[0].run()), *events[1].start()]
        if page is not None:
            recorder.watcher = page.board.take
            beside.append(asyncio.create_task(page.run()))
        if rolling is not None:
            follower = None if events is None else events[0]
            beside.append(asyncio.create_task(rolling.run(journal, notices, follower)))

        # Wait until all sources have ended, one has failed, or a signal comes.
        everything = asyncio.ensure_future(asyncio.gather(*running))
        try:
            await asyncio.wait([everything, *beside], return_when=asyncio.FIRST_COMPLETED)
            failed = next(
                (task.exception() for task in [*running, *beside] if _has_failed(task)), None
            )
        finally:
            is_over = everything.done()
            for task in [*running, *beside]:
                task.cancel()
            await asyncio.wait([*running, *beside], timeout=_END_SECONDS)
            # Errors are raised below; asyncio would report again those that nobody asked for.
            everything.cancel()
            await asyncio.wait([everything], timeout=_END_SECONDS)
            _has_failed(everything)
            await recorder.finish()
            if events is not None:
                await _finish(*events, is_over=is_over)
    if failed is not None:
        raise failed


async def _finish(follower: Follower, outbox: Outbox, *, is_over: bool) -> None:
    """Find the events of what was stored last, and send what is left."""
    sending = outbox.start()
    await follower.finish(is_over=is_over)
    await outbox.finish()
    for task in sending:
        task.cancel()
    await asyncio.wait(sending, timeout=_END_SECONDS)
    await follower.save()
    await outbox.close()


def _has_failed(task: asyncio.Future[Any]) -> bool:
    return task.done() and not task.cancelled() and task.exception() is not None


@contextlib.contextmanager
def _stop_at_signals(stop: asyncio.Event) -> Iterator[None]:
    """Set an event at SIGINT, SIGTERM and SIGHUP: the normal end of a listener."""
    # Signals that are not ignored, as by nohup.
    loop = asyncio.get_running_loop()
    numbers = [
        getattr(signal, name)
        for name in ("SIGINT", "SIGTERM", "SIGHUP")
        if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) != signal.SIG_IGN
    ]

    # Handle them during the block.
    added = []
    for number in numbers:
        # Windows, and threads other than the main one, have no such handlers.
        with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
            loop.add_signal_handler(number, stop.set)
            added.append(number)
    try:
        yield
    finally:
        for number in added:
            loop.remove_signal_handler(number)
