"""Results in the order of the items, with a bounded number of items under way."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import TypeVar

__all__ = ["results_in_order"]

T = TypeVar("T")
R = TypeVar("R")


def results_in_order(
    submit: Callable[[T], Future[R]], items: Iterable[T], max_pending: int
) -> Iterator[R]:
    """Submit items, at most so many ahead of what is fetched, and yield their results in order; cancel what is left on leaving."""
    waiting: deque[Future[R]] = deque()
    try:
        for item in items:
            waiting.append(submit(item))
            if len(waiting) >= max_pending:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
