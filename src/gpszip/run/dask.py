"""The executor that runs items on a running Dask cluster."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from types import TracebackType
from typing import Any, Generic, NamedTuple, Self, TypeVar

from gpszip.errors import MissingExtraError, WorkerError
from gpszip.run.executor import Executor, SharedValue
from gpszip.run.in_order import PENDING_PER_WORKER, results_in_order
from gpszip.run.threads import Threads

__all__ = ["Dask", "connect"]

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V")

#: Seconds until a scheduler that doesn't answer is reported.
_CONNECT_TIMEOUT = 10

#: Items in flight at least, so that a cluster that is still growing gets work at once.
_MIN_PENDING = 4


class Dask:
    """Runs items on the workers of a cluster.

    Items of a worker that dies are run again by another one: they have no side effects, so that
    the results stay the same. At most twice as many items as the cluster has threads are in
    flight.

    Parameters
    ----------
    client : distributed.Client
        A connected client. It is not closed.

    Raises
    ------
    WorkerError
        From ``map``, if no worker is left, or if several workers die while they run the same item.
    """

    def __init__(self, client: Any) -> None:
        self.client: Any = client

    def __repr__(self) -> str:
        return f"Dask({self.client.scheduler_info()['address']})"

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in order; raise an item's error in its turn."""
        # By default Dask takes equal calls for one task and computes its result once; pure=False
        # makes each item a task of its own, and saves hashing large arguments.
        return self._map_in_order(
            lambda item: self.client.submit(function, item, pure=False), items
        )

    def share(self, value: V, /) -> SharedValue[V]:
        """Send the value to all workers."""
        return _ScatteredValue(self, value)

    def local(self) -> Executor:
        """Return an executor with the threads of this process."""
        return Threads()

    def reduce(self, combine: Callable[[R, R], R], items: Iterable[T], leaf: Callable[[T], R]) -> R:
        """Combine the values of items in the tree of :func:`gpszip.run.executor.reduce_tree`.

        Partial results stay at the workers; only the root comes back.
        """
        from distributed import wait

        # Complete subtrees from left to right: their sizes are falling powers of 2, as the ones
        # of the binary number of the items so far.
        subtrees: list[_Subtree] = []
        leaves: deque[Any] = deque()
        for item in items:
            leaves.append(self.client.submit(leaf, item, pure=False))
            subtrees.append(_Subtree(1, leaves[-1]))
            while len(subtrees) > 1 and subtrees[-2].size == subtrees[-1].size:
                self._combine_last_two(combine, subtrees)

            # Draw no more items than the workers keep up with.
            if len(leaves) >= self._max_pending():
                wait(leaves.popleft())  # type: ignore[no-untyped-call]

        # The unequal ones that remain, from right to left.
        while len(subtrees) > 1:
            self._combine_last_two(combine, subtrees)
        root: R = _fetch_result(subtrees[0].future)
        return root

    def _combine_last_two(self, combine: Callable[[R, R], R], subtrees: list[_Subtree]) -> None:
        left, right = subtrees[-2:]
        future = self.client.submit(combine, left.future, right.future, pure=False)
        # Two of equal size become one of twice the size, like a carry in a binary number.
        subtrees[-2:] = [_Subtree(left.size + right.size, future)]

    def _max_pending(self) -> int:
        """Return the number of items that may be in flight: enough to keep all threads busy."""
        # Asked anew each time, since a cluster may grow or shrink.
        threads: int = sum(self.client.nthreads().values())
        return max(PENDING_PER_WORKER * threads, _MIN_PENDING)

    def _map_in_order(self, submit: Callable[[T], Any], items: Iterable[T]) -> Iterator[Any]:
        def start(item: T) -> Any:
            return _CheckedFuture(submit(item))

        return results_in_order(start, items, self._max_pending())


class _Subtree(NamedTuple):
    """A combined value at the workers.

    Parameters
    ----------
    size : int
        Number of items below it.
    future : distributed.Future
        The value.
    """

    size: int
    future: Any


class _ScatteredValue(Generic[V]):
    """A value at all workers; if all workers that had it died, it is sent again."""

    def __init__(self, executor: Dask, value: V) -> None:
        self._executor, self._value = executor, value
        self._future = self._scatter()

    def map(self, function: Callable[[V, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
        return self._executor._map_in_order(
            lambda item: _RetryingFuture(self, function, item), items
        )

    def submit(self, function: Callable[[V, T], R], item: T) -> Any:
        """Start the work on an item; return its future."""
        return self._executor.client.submit(function, self._future, item, pure=False)

    def send_again(self, lost: Any) -> None:
        """Send the value to the workers again, unless this was done since ``lost`` was current."""
        if self._future is lost:
            self._future = self._scatter()

    def _scatter(self) -> Any:
        # Every worker gets a copy at once. hash=False spares hashing a large value; it has a new
        # name whenever it is sent.
        return self._executor.client.scatter([self._value], broadcast=True, hash=False)[0]

    @property
    def future(self) -> Any:
        """The current future of the value."""
        return self._future

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Release the value at the workers."""
        self._future.release()


class _RetryingFuture:
    """A result that is computed again if the shared value was lost meanwhile."""

    def __init__(
        self, shared: _ScatteredValue[Any], function: Callable[[Any, Any], Any], item: Any
    ) -> None:
        self._shared, self._function, self._item = shared, function, item
        self._value_future = shared.future
        self._future: Any = shared.submit(function, item)

    def result(self) -> Any:
        """Return the result; try a second time with a value that is sent again."""
        try:
            return self._future.result()
        # Dask cancels what depends on a value that is lost with its workers.
        except CancelledError:
            self._shared.send_again(self._value_future)
            return self._shared.submit(self._function, self._item).result()

    def cancel(self) -> None:
        """Cancel the work."""
        self._future.cancel()


class _CheckedFuture:
    """A future that raises WorkerError when its workers are lost."""

    def __init__(self, future: Any) -> None:
        self._future = future

    def result(self) -> Any:
        """Return the result."""
        return _fetch_result(self._future)

    def cancel(self) -> None:
        """Cancel the work."""
        self._future.cancel()


def _fetch_result(future: Any) -> Any:
    """Return a future's result; raise WorkerError for errors of the cluster itself."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        raise WorkerError(
            "several workers of the cluster ended at the same piece of work; "
            "they may have too little memory"
        ) from error
    except CancelledError as error:
        raise WorkerError("the cluster lost a piece of work; are any workers left?") from error


def connect(address: str) -> Any:
    """Connect to a running scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    WorkerError
        If no scheduler answers within 10 s.
    """
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError("dask", "a Dask cluster") from error
    client: Any = distributed.Client
    try:
        return client(address, timeout=_CONNECT_TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        raise WorkerError(f"no scheduler answers at {address}: {error}") from error
