"""The executor that runs items in threads of this process.

Compiled kernels release the interpreter's lock, so that threads use several cores.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

from gpszip.errors import OptionError
from gpszip.run.executor import Executor, LocalValue, SharedValue
from gpszip.run.in_order import PENDING_PER_WORKER, results_in_order

__all__ = ["Threads"]

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V")


@dataclass(frozen=True)
class Threads:
    """Runs items in up to ``workers`` threads.

    At most twice as many items as workers are in flight, so that a long stream of items is never
    held at once.

    Parameters
    ----------
    workers : int, default the number of cores
        Number of threads, at least 1.

    Raises
    ------
    OptionError
        If ``workers`` is less than 1.

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
        """Yield ``function(item)`` for each item, in order; raise an item's error in its turn."""
        # A pool for each call: nothing has to be closed by the caller.
        pool = ThreadPoolExecutor(self.workers)
        busy = _BusyThreads()
        try:
            yield from results_in_order(
                lambda item: pool.submit(busy.run, function, item),
                items,
                PENDING_PER_WORKER * self.workers,
            )
        except KeyboardInterrupt:
            # Otherwise the shutdown would wait until the threads have finished their items.
            busy.interrupt()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def share(self, value: V, /) -> SharedValue[V]:
        """Return the value in place: threads see the same memory."""
        return LocalValue(self, value)

    def local(self) -> Executor:
        """Return itself."""
        return self


class _BusyThreads:
    """The threads that are running an item, so that Ctrl-C can interrupt them.

    Python raises KeyboardInterrupt in the main thread only.
    """

    def __init__(self) -> None:
        self._threads: set[int] = set()
        self._lock = threading.Lock()

    def run(self, function: Callable[[T], R], item: T) -> R:
        """Return ``function(item)``; the calling thread counts as busy meanwhile."""
        thread = threading.get_ident()
        with self._lock:
            self._threads.add(thread)
        try:
            return function(item)
        finally:
            with self._lock:
                self._threads.discard(thread)

    def interrupt(self) -> None:
        """Raise KeyboardInterrupt in each busy thread as soon as it leaves compiled code."""
        with self._lock:
            for thread in self._threads:
                # Python has no other way to interrupt a thread from outside.
                ctypes.pythonapi.PyThreadState_SetAsyncExc(
                    ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt)
                )
