"""The interface of executors: how packages spread work over threads, processes or machines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

__all__ = [
    "Executor",
    "LocalValue",
    "Serial",
    "SharedValue",
    "local_executor",
    "reduce_tree",
    "share_value",
]

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)


class Executor(Protocol):
    """Maps a function over items and yields the results in the order of the items.

    The order is part of the contract: it makes results the same for any number of workers.
    Functions are defined at the top of a module and items are frozen values, since both may be
    sent to other processes. An executor may also have a method ``reduce``, see
    :func:`reduce_tree`.
    """

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items."""
        ...

    def share(self, value: V, /) -> SharedValue[V]:
        """Send a large value to the workers once, for many items."""
        ...

    def local(self) -> Executor:
        """Return an executor that runs in this process, for work on arrays in its memory."""
        ...


class SharedValue(Protocol[V_co]):
    """A value held by the workers until its ``with`` block ends."""

    def map(self, function: Callable[[V_co, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
        ...

    def __enter__(self) -> Self:
        """Return itself."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
        /,
    ) -> None:
        """Release the value."""
        ...


@dataclass(frozen=True, eq=False)
class LocalValue(Generic[V]):
    """A shared value for workers that see the caller's memory.

    Parameters
    ----------
    executor : Executor
        Runs the items.
    value : object
        The value.

    Examples
    --------
    >>> list(LocalValue(Serial(), 10).map(divmod, [3, 4]))
    [(3, 1), (2, 2)]
    """

    executor: Executor
    value: V

    def map(self, function: Callable[[V, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
        # All workers see this memory: the value is one more argument.
        return self.executor.map(partial(function, self.value), items)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
        /,
    ) -> None:
        """Do nothing: the value was not copied."""


@dataclass(frozen=True)
class Serial:
    """Runs items one by one in the calling thread.

    Examples
    --------
    >>> list(Serial().map(abs, [-2, 1]))
    [2, 1]
    """

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items."""
        return map(function, items)

    def share(self, value: V, /) -> SharedValue[V]:
        """Return the value in place."""
        return LocalValue(self, value)

    def local(self) -> Executor:
        """Return itself."""
        return self


def share_value(executor: Executor | None, value: V) -> SharedValue[V]:
    """Share a value with an executor's workers.

    Without an executor, or with one that has only ``map``, the value stays in place.

    Examples
    --------
    >>> with share_value(None, 10) as ten:
    ...     list(ten.map(pow, [1, 2]))
    [10, 100]
    """
    if executor is None:
        executor = Serial()
    # Executors of users may have no more than ``map``.
    return executor.share(value) if hasattr(executor, "share") else LocalValue(executor, value)


def local_executor(executor: Executor | None) -> Executor:
    """Return the executor for work on arrays in this process's memory."""
    if executor is None:
        executor = Serial()
    return executor.local() if hasattr(executor, "local") else executor


def reduce_tree(
    executor: Executor | None,
    combine: Callable[[R, R], R],
    items: Iterable[T],
    leaf: Callable[[T], R],
) -> R:
    """Map items to values and combine the values pairwise, in a balanced binary tree.

    The shape of the tree depends on the number of items alone, so that results are the same for
    any number of workers. Items are drawn lazily, level by level. An executor whose workers have
    memories of their own may have a method ``reduce(combine, items, leaf)``, which keeps partial
    results at the workers.

    Parameters
    ----------
    executor : Executor, optional
        Runs ``leaf`` and ``combine``; default: the calling thread.
    combine : callable
        Returns one value for two neighbouring ones.
    items : iterable
        At least one item.
    leaf : callable
        Returns the value of an item.

    Examples
    --------
    >>> reduce_tree(None, "({} {})".format, "abcde", str.upper)
    '(((A B) (C D)) E)'
    """
    if executor is None:
        executor = Serial()
    if hasattr(executor, "reduce"):
        root: R = executor.reduce(combine, items, leaf)
        return root

    # Each level of the tree is a lazy map over the pairs of the level below.
    level = executor.map(leaf, items)
    while True:
        first = next(level)
        # The second value tells whether there is a pair; with a single one, the root is reached.
        # Values are drawn only as they are needed, so that a long stream is never held at once.
        second = next(level, None)
        if second is None:
            return first
        level = executor.map(partial(_combine_pair, combine), _pairs(chain([first, second], level)))


def _pairs(values: Iterator[T]) -> Iterator[tuple[T, ...]]:
    """Yield neighbouring values as pairs; with an odd number of values, the last one alone."""
    # An empty tuple is false: the values are used up.
    while pair := tuple(islice(values, 2)):
        yield pair


def _combine_pair(combine: Callable[[T, T], T], pair: tuple[T, ...]) -> T:
    return combine(*pair) if len(pair) > 1 else pair[0]
