"""Work on a Dask cluster that is there already."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from gpszip.errors import MissingExtraError, WorkerError
from gpszip.run.executor import Executor, SharedValue
from gpszip.run.in_order import results_in_order
from gpszip.run.threads import Threads

__all__ = ["Dask", "connect"]

T = TypeVar("T")
R = TypeVar("R")
V = TypeVar("V")

#: Seconds to wait for a scheduler.
_CONNECT_TIMEOUT = 10


class Dask:
    """Runs items on the workers of a cluster.

    A worker that dies is replaced by another one: items have no side effects, so that the results stay the same. At most twice
    as many items as the cluster has threads are under way.

    Parameters
    ----------
    client : distributed.Client
        Connected; it is neither made nor closed here.

    Raises
    ------
    WorkerError
        From ``map``, if no worker is left, or the same item ends one after the other.
    """

    def __init__(self, client: Any) -> None:
        self.client: Any = client

    def __repr__(self) -> str:
        return f"Dask({self.client.scheduler_info()['address']})"

    def map(self, function: Callable[[T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(item)`` for each item, in the order of the items; an item's error is raised in its turn."""
        return self._map_in_order(
            lambda item: self.client.submit(function, item, pure=False), items
        )

    def share(self, value: V, /) -> SharedValue[V]:
        """Bring the value to all workers."""
        return _ScatteredValue(self, value)

    def local(self) -> Executor:
        """Return the threads of this process."""
        return Threads()

    def unite(self, unite: Callable[[R, R], R], items: Iterable[T], leaf: Callable[[T], R]) -> R:
        """Unite what becomes of items two by two; it stays with the workers until all is one."""
        from distributed import wait

        done: list[
            tuple[int, Any]
        ] = []  # what is united so far, and of how many items each: powers of 2 that fall
        leaves: deque[Any] = deque()
        for item in items:
            leaves.append(self.client.submit(leaf, item, pure=False))
            done.append((1, leaves[-1]))
            while len(done) > 1 and done[-2][0] == done[-1][0]:
                self._reduce_last(unite, done)
            if len(leaves) >= self._max_pending():
                wait(leaves.popleft())  # type: ignore[no-untyped-call]
        while len(done) > 1:
            self._reduce_last(unite, done)
        whole: R = _fetch_result(done[0][1])
        return whole

    def _reduce_last(self, unite: Callable[[R, R], R], done: list[tuple[int, Any]]) -> None:
        (some, left), (others, right) = done[-2:]
        done[-2:] = [(some + others, self.client.submit(unite, left, right, pure=False))]

    def _max_pending(self) -> int:
        """How many items may be under way."""
        threads: int = sum(self.client.nthreads().values())
        return max(2 * threads, 4)

    def _map_in_order(self, submit: Callable[[T], Any], items: Iterable[T]) -> Iterator[Any]:
        def start(item: T) -> Any:
            return _CheckedFuture(submit(item))

        return results_in_order(start, items, self._max_pending())


class _ScatteredValue(Generic[V]):
    """A value at all workers; it is brought anew to those that come later, and where all that had it are gone."""

    def __init__(self, executor: Dask, value: V) -> None:
        self._executor, self._value = executor, value
        self._future = self._scatter()

    def map(self, function: Callable[[V, T], R], items: Iterable[T], /) -> Iterator[R]:
        """Yield ``function(value, item)`` for each item, in the order of the items."""
        return self._executor._map_in_order(
            lambda item: _RetryingFuture(self, function, item), items
        )

    def submit(self, function: Callable[[V, T], R], item: T) -> Any:
        """Begin with an item."""
        return self._executor.client.submit(function, self._future, item, pure=False)

    def renew(self, lost: Any) -> None:
        """Bring the value to the workers again, unless someone has."""
        if self._future is lost:
            self._future = self._scatter()

    def _scatter(self) -> Any:
        return self._executor.client.scatter([self._value], broadcast=True, hash=False)[0]

    @property
    def future(self) -> Any:
        """Where the value is."""
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
        """Let the workers forget the value."""
        self._future.release()


class _RetryingFuture:
    """A result that is computed again if the shared value was lost on the way."""

    def __init__(
        self, shared: _ScatteredValue[Any], function: Callable[[Any, Any], Any], item: Any
    ) -> None:
        self._shared, self._function, self._item = shared, function, item
        self._needs = shared.future
        self._future: Any = shared.submit(function, item)

    def result(self) -> Any:
        try:
            return self._future.result()
        except CancelledError:
            self._shared.renew(self._needs)
            return self._shared.submit(self._function, self._item).result()

    def cancel(self) -> None:
        self._future.cancel()


class _CheckedFuture:
    """A future whose loss is an error of ours."""

    def __init__(self, future: Any) -> None:
        self._future = future

    def result(self) -> Any:
        return _fetch_result(self._future)

    def cancel(self) -> None:
        self._future.cancel()


def _fetch_result(future: Any) -> Any:
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        raise WorkerError(
            "several workers of the cluster ended at the same piece of work; they may have too little memory"
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
        If nobody answers.
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
