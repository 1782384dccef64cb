"""Work in threads of this process; compiled kernels release the interpreter's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TypeVar

from gpszip.errors import OptionError
from gpszip.model.executor import Executor, Held, Shared

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
        pool = ThreadPoolExecutor(self.workers)
        waiting: deque[Future[R]] = deque()
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) >= 2 * self.workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def share(self, value: V, /) -> Shared[V]:
        """Return the value where it is: threads see the same memory."""
        return Held(self, value)

    def local(self) -> Executor:
        """Return itself."""
        return self
