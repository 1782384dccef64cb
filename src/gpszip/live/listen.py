"""Listening: sources run side by side until they end, or until the program is told to stop."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from gpszip.files.os_errors import explain_os_error
from gpszip.live.journal import Journal
from gpszip.live.notices import Notices
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

    async def run(self, journal: Journal, notices: Notices) -> None:
        """Roll again and again, until the task is cancelled."""
        while True:
            await asyncio.sleep(self.every)
            try:
                if not await asyncio.to_thread(journal.advance):
                    continue
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
        # In a session of its own, Ctrl-C does not reach it.
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *self._command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,
        )
        try:
            _, told = await process.communicate()
        except asyncio.CancelledError:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            await process.wait()
            raise
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

    Raises
    ------
    GPSZipError
        If a source can't go on.
    """
    stop = asyncio.Event()
    with _stop_at_signals(stop):
        running = [asyncio.create_task(source.run(recorder)) for source in sources]
        beside: list[asyncio.Task[Any]] = [asyncio.create_task(stop.wait())]
        if rolling is not None:
            beside.append(asyncio.create_task(rolling.run(journal, notices)))

        # Wait until all sources have ended, one has failed, or a signal comes.
        everything = asyncio.ensure_future(asyncio.gather(*running))
        try:
            await asyncio.wait([everything, *beside], return_when=asyncio.FIRST_COMPLETED)
            failed = next(
                (task.exception() for task in [*running, *beside] if _has_failed(task)), None
            )
        finally:
            for task in [*running, *beside]:
                task.cancel()
            await asyncio.wait([*running, *beside], timeout=_END_SECONDS)
            # Errors are raised below; asyncio would report again those that nobody asked for.
            everything.cancel()
            await asyncio.wait([everything], timeout=_END_SECONDS)
            _has_failed(everything)
            await recorder.finish()
    if failed is not None:
        raise failed


def _has_failed(task: asyncio.Future[Any]) -> bool:
    return task.done() and not task.cancelled() and task.exception() is not None


@contextlib.contextmanager
def _stop_at_signals(stop: asyncio.Event) -> Iterator[None]:
    """Set an event at SIGINT, SIGTERM and SIGHUP: the normal end of a listener."""
    loop = asyncio.get_running_loop()
    numbers = [
        getattr(signal, name)
        for name in ("SIGINT", "SIGTERM", "SIGHUP")
        if hasattr(signal, name) and signal.getsignal(getattr(signal, name)) != signal.SIG_IGN
    ]
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
