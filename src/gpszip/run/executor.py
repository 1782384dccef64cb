"""The one seam through which work is spread over threads, processes or machines."""

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
    """Anything that maps a function over items and yields the results in the items' order.

    The order is part of the contract: it is what makes results the same for any number of workers. Functions lie at the top of
    a module and items are frozen values, since both may travel to other processes.
    """

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items."""
        ...

    def share(self, value: V, /) -> SharedValue[V]:
        """Bring a large value to the workers, once, for many items."""
        ...

    def local(self) -> Executor:
        """Return an executor for work on arrays in this process's memory: threads, or this one."""
        ...


class SharedValue(Protocol[V_co]):
    """A value at the workers; leaving its ``with`` block takes it away from them."""

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
        """Take the value away from the workers."""
        ...


@dataclass(frozen=True, eq=False)
class LocalValue(Generic[V]):
    """A value in the memory that workers share with the caller.

    Parameters
    ----------
    executor : Executor
        Runs the work.
    value : object
        What is shared.

    Examples
    --------
    >>> list(LocalValue(Serial(), 10).map(divmod, [3, 4]))
    [(3, 1), (2, 2)]
    """

    executor: Executor
    value: V

    def map(self, function: Callable[[V, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
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
        """Nothing was brought anywhere."""


@dataclass(frozen=True)
class Serial:
    """Runs everything in the calling thread.

    Examples
    --------
    >>> list(Serial().map(abs, [-2, 1]))
    [2, 1]
    """

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items."""
        return map(function, items)

    def share(self, value: V, /) -> SharedValue[V]:
        """Return the value where it is."""
        return LocalValue(self, value)

    def local(self) -> Executor:
        """Return itself."""
        return self


def share_value(executor: Executor | None, value: V) -> SharedValue[V]:
    """Share a value with an executor's workers; without an executor, or with one that only maps, it stays where it is.

    Examples
    --------
    >>> with share_value(None, 10) as ten:
    ...     list(ten.map(pow, [1, 2]))
    [10, 100]
    """
    own = Serial() if executor is None else executor
    return own.share(value) if hasattr(own, "share") else LocalValue(own, value)


def local_executor(executor: Executor | None) -> Executor:
    """Return where work on arrays in this process's memory runs."""
    own = Serial() if executor is None else executor
    return own.local() if hasattr(own, "local") else own


def reduce_tree(
    executor: Executor | None,
    unite: Callable[[R, R], R],
    items: Iterable[T],
    leaf: Callable[[T], R],
) -> R:
    """Unite what becomes of items two by two, as a tree whose shape depends on nothing but their number.

    Only as many items and partial results are held as workers are busy with. Where the executor has workers with memories of
    their own and can unite there, partial results stay with them.

    Parameters
    ----------
    executor : Executor, optional
        Where values are made and united.
    unite : callable
        Makes one value of two.
    items : iterable
        At least one.
    leaf : callable
        Makes a value of an item.

    Examples
    --------
    >>> reduce_tree(None, "({} {})".format, "abcde", str.upper)
    '(((A B) (C D)) E)'
    """
    own = Serial() if executor is None else executor
    if hasattr(own, "unite"):
        whole: R = own.unite(unite, items, leaf)
        return whole
    level = own.map(leaf, items)
    while True:
        first = next(level)
        second = next(level, None)
        if second is None:
            return first
        level = own.map(partial(_reduce_pair, unite), _pairs(chain([first, second], level)))


def _pairs(values: Iterator[T]) -> Iterator[tuple[T, ...]]:
    """Neighbours; the last value may be alone."""
    while pair := tuple(islice(values, 2)):
        yield pair


def _reduce_pair(unite: Callable[[T, T], T], pair: tuple[T, ...]) -> T:
    return unite(*pair) if len(pair) > 1 else pair[0]
