"""Work in threads of this process; compiled kernels release the interpreter's lock."""

from __future__ import annotations

import ctypes
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

from gpszip.errors import OptionError
from gpszip.run.executor import Executor, LocalValue, SharedValue

__all__ = ["Threads"]

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V")


@dataclass(frozen=True)
class Threads:
    """Runs items in up to ``workers`` threads.

    At most twice as many items as workers are in work or waiting to be fetched, so that a long stream of items is never
    held at once.

    Parameters
    ----------
    workers : int, default the number of cores
        Threads, at least 1.

    Raises
    ------
    OptionError
        If there is no worker.

    Examples
    --------
    >>> list(Threads(2).map(abs, [-2, 1, -3]))
    [2, 1, 3]
    """

    workers: int = field(default_factory=lambda: os.cpu_count() or 1)

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise OptionError(f"{self.workers} threads can't do any work; choose 1 or more")

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items; an item's error is raised in its turn."""
        pool, busy = ThreadPoolExecutor(self.workers), _BusyThreads()
        waiting: deque[Future[R]] = deque()
        try:
            for item in items:
                waiting.append(pool.submit(busy.run, function, item))
                if len(waiting) >= 2 * self.workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except KeyboardInterrupt:
            busy.interrupt()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def share(self, value: V, /) -> SharedValue[V]:
        """Return the value where it is: threads see the same memory."""
        return LocalValue(self, value)

    def local(self) -> Executor:
        """Return itself."""
        return self


class _BusyThreads:
    """The threads that work on an item, so that an interruption of the one that waits for them reaches them, too."""

    def __init__(self) -> None:
        self._threads: set[int] = set()
        self._lock = threading.Lock()

    def run(self, function: Callable[[T], R], item: T) -> R:
        """Work on an item."""
        thread = threading.get_ident()
        with self._lock:
            self._threads.add(thread)
        try:
            return function(item)
        finally:
            with self._lock:
                self._threads.discard(thread)

    def interrupt(self) -> None:
        """Have each thread that works on an item end it as soon as it is out of compiled code."""
        with self._lock:
            for thread in self._threads:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(
                    ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt)
                )
