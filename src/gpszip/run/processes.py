"""The executor that runs items in further processes of this machine."""

from __future__ import annotations

import os
import pickle
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import lru_cache, partial
from multiprocessing.context import SpawnContext, SpawnProcess
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from gpszip.errors import OptionError, WorkerError
from gpszip.files.os_errors import as_output_error
from gpszip.files.temporary import SCRATCH_PREFIX, temporary_folder
from gpszip.run.executor import Executor, SharedValue
from gpszip.run.in_order import PENDING_PER_WORKER, results_in_order
from gpszip.run.threads import Threads

__all__ = ["Processes"]

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V")


class Processes:
    """Runs items in up to ``workers`` processes.

    The processes start at the first item and end with the ``with`` block. At most twice as many
    items as workers are in flight. Functions must be defined at the top of a module, and a script
    that uses processes needs ``if __name__ == "__main__":``. Run ``gpszip warm`` once before:
    otherwise each process compiles all kernels for itself.

    Parameters
    ----------
    workers : int, default the number of cores
        Number of processes, at least 1.

    Raises
    ------
    OptionError
        If ``workers`` is less than 1.
    WorkerError
        From ``map``, if a process is killed or exits.

    Examples
    --------
    >>> with Processes(1) as executor:
    ...     list(executor.map(abs, [-2, 1, -3]))
    [2, 1, 3]
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = (os.cpu_count() or 1) if workers is None else workers
        if self.workers < 1:
            raise OptionError(f"{self.workers} processes can't do any work; choose 1 or more")
        self._context = _TrackedContext()
        self._pool: ProcessPoolExecutor | None = None

    def __repr__(self) -> str:
        return f"Processes(workers={self.workers})"

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the processes; at once if an error ends the block."""
        self.close(at_once=error is not None)

    def close(self, *, at_once: bool = False) -> None:
        """End the processes after the items that they are running, or at once."""
        if self._pool is None:
            return

        # The pool itself can't interrupt a running item.
        if at_once:
            for process in self._context.started:
                process.terminate()

        # No process outlives the block: wait until all have ended.
        self._pool.shutdown(wait=True, cancel_futures=True)
        # A pool that was shut down takes no more items; the next call starts another one.
        self._pool = None
        self._context.started.clear()

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in order; raise an item's error in its turn."""
        # Start the processes at the first call.
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                self.workers, mp_context=self._context, initializer=_ignore_interrupts
            )
        pool = self._pool

        # a broken or interrupted pool is ended; the next call starts a new one
        try:
            yield from results_in_order(
                lambda item: pool.submit(function, item),
                items,
                PENDING_PER_WORKER * self.workers,
            )
        except BrokenProcessPool as error:
            self.close(at_once=True)
            raise WorkerError(
                "a process was killed or ran out of memory; try again with fewer workers"
            ) from error
        except KeyboardInterrupt:
            self.close(at_once=True)
            raise

    def share(self, value: V, /) -> SharedValue[V]:
        """Write the value to a file that each process reads once."""
        return _PickledValue(self, value)

    def local(self) -> Executor:
        """Return an executor with as many threads of this process."""
        return Threads(self.workers)


class _PickledValue(Generic[V]):
    """A value in a temporary file; each process loads it once."""

    def __init__(self, executor: Processes, value: V) -> None:
        self._executor = executor
        with ExitStack() as stack, as_output_error(tempfile.gettempdir()):
            # Write the value.
            folder = temporary_folder(Path(tempfile.gettempdir()), SCRATCH_PREFIX)
            self._path = stack.enter_context(folder) / "shared"
            with self._path.open("wb") as file:
                pickle.dump(value, file, protocol=pickle.HIGHEST_PROTOCOL)

            # Keep the folder until the with block ends.
            self._cleanup = stack.pop_all()

    def map(self, function: Callable[[V, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
        return self._executor.map(partial(_call_with_shared, function, str(self._path)), items)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the file."""
        self._cleanup.close()


class _TrackedContext(SpawnContext):
    """Starts fresh interpreters and lists their processes, so that they can be terminated."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    def Process(  # type: ignore[override]  # noqa: N802
        self, *arguments: Any, **options: Any
    ) -> SpawnProcess:
        # Spawned, not forked: a fork while threads run may copy a lock that nobody releases.
        process = SpawnProcess(*arguments, **options)
        self.started.append(process)
        return process


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C: the parent process handles it and terminates this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@lru_cache(maxsize=2)
def _load_shared(path: str) -> Any:
    """Load a shared value; the last two stay in memory."""
    with Path(path).open("rb") as file:
        return pickle.load(file)


def _call_with_shared(function: Callable[[Any, T], R], path: str, item: T) -> R:
    """Return ``function(value, item)`` with the shared value of a file."""
    return function(_load_shared(path), item)
