"""Results in the order of the items, with a bounded number of items in flight."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import TypeVar

__all__ = ["PENDING_PER_WORKER", "results_in_order"]

T = TypeVar("T")
R = TypeVar("R")

#: Items in flight for each worker: one that it runs, and one that is ready when it finishes. More
#: of them would only take memory.
PENDING_PER_WORKER = 2


def results_in_order(
    submit: Callable[[T], Future[R]], items: Iterable[T], max_pending: int
) -> Iterator[R]:
    """Submit items and yield their results in order; cancel pending ones on leaving.

    Parameters
    ----------
    submit : callable
        Starts the work on an item and returns its future.
    items : iterable
        Items, drawn one by one.
    max_pending : int
        Most items that are submitted before the first of them is yielded.

    Yields
    ------
    object
        The result of each item. An item's error is raised in its turn.
    """
    pending: deque[Future[R]] = deque()
    try:
        # Keep workers busy; wait for the oldest result when enough items are in flight.
        for item in items:
            pending.append(submit(item))
            if len(pending) >= max_pending:
                yield pending.popleft().result()

        # No more items: wait for the rest.
        while pending:
            yield pending.popleft().result()
    finally:
        # An error, or the caller stopped early.
        for future in pending:
            future.cancel()
