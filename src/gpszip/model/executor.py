"""The one seam through which work is spread over threads, processes or machines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

__all__ = ["Executor"]

T = TypeVar("T")
R = TypeVar("R")


class Executor(Protocol):
    """Anything that maps a function over items and yields the results in the items' order.

    The order is part of the contract: it is what makes results the same for any number of workers.
    """

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items."""
        ...
