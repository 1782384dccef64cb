"""Notifications about compilation, for messages such as "compiling, this happens once"."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

__all__ = ["on_compile"]


class _CompileListener(event.Listener):  # type: ignore[misc]
    """A listener of numba's compilation events that calls a function at each start."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._callback = notify  # ``notify`` is a method of numba's listeners

    def on_start(self, _: Any) -> None:
        """Report that a compilation begins."""
        self._callback()

    def on_end(self, _: Any) -> None:
        """Do nothing: only the start of a compilation is reported."""


@contextmanager
def on_compile(notify: Callable[[], None]) -> Iterator[None]:
    """Call ``notify`` whenever a kernel is compiled rather than loaded from the cache.

    Each installation compiles a kernel once, which takes up to some seconds.

    Parameters
    ----------
    notify : callable
        Called without arguments at the start of each compilation.
    """
    listener = _CompileListener(notify)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
