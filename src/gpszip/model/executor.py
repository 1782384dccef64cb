"""The one seam through which work is spread over threads, processes or machines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Generic, Protocol, Self, TypeVar

__all__ = ["Executor", "Held", "Serial", "Shared", "local", "sharing", "united"]

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

    def share(self, value: V, /) -> Shared[V]:
        """Bring a large value to the workers, once, for many items."""
        ...

    def local(self) -> Executor:
        """Return an executor for work on arrays in this process's memory: threads, or this one."""
        ...


class Shared(Protocol[V_co]):
    """A value at the workers; leaving its ``with`` block takes it away from them."""

    def map(self, function: Callable[[V_co, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
        ...

    def __enter__(self) -> Self:
        """Return itself."""
        ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /) -> None:
        """Take the value away from the workers."""
        ...


@dataclass(frozen=True, eq=False)
class Held(Generic[V]):
    """A value in the memory that workers share with the caller.

    Parameters
    ----------
    executor : Executor
        Runs the work.
    value : object
        What is shared.

    Examples
    --------
    >>> list(Held(Serial(), 10).map(divmod, [3, 4]))
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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /) -> None:
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

    def share(self, value: V, /) -> Shared[V]:
        """Return the value where it is."""
        return Held(self, value)

    def local(self) -> Executor:
        """Return itself."""
        return self


def sharing(executor: Executor | None, value: V) -> Shared[V]:
    """Share a value with an executor's workers; without an executor, or with one that only maps, it stays where it is.

    Examples
    --------
    >>> with sharing(None, 10) as ten:
    ...     list(ten.map(pow, [1, 2]))
    [10, 100]
    """
    own = Serial() if executor is None else executor
    return own.share(value) if hasattr(own, "share") else Held(own, value)


def local(executor: Executor | None) -> Executor:
    """Return where work on arrays in this process's memory runs."""
    own = Serial() if executor is None else executor
    return own.local() if hasattr(own, "local") else own


def united(executor: Executor | None, unite: Callable[[T, T], T], values: Iterable[T]) -> T:
    """Unite values two by two, as a tree whose shape depends on nothing but their number.

    Where the executor has workers with memories of their own and can unite there, what is half united doesn't come back.

    Parameters
    ----------
    executor : Executor, optional
        Where values are united.
    unite : callable
        Makes one of two.
    values : iterable
        At least one.

    Examples
    --------
    >>> united(None, "({} {})".format, "abcde")
    '(((a b) (c d)) e)'
    """
    own = Serial() if executor is None else executor
    if hasattr(own, "unite"):
        whole: T = own.unite(unite, values)
        return whole
    level = list(values)
    while len(level) > 1:
        pairs = [(level[i], level[i + 1]) for i in range(0, len(level) - 1, 2)]
        level = [*own.map(partial(_unite_pair, unite), pairs), *level[2 * len(pairs) :]]
    return level[0]


def _unite_pair(unite: Callable[[T, T], T], pair: tuple[T, T]) -> T:
    return unite(*pair)
