"""Notice when a kernel is compiled, which happens once for each installation and takes a while."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

__all__ = ["on_compile"]


class _CompileListener(event.Listener):  # type: ignore[misc]
    def __init__(self, notify: Callable[[], None]) -> None:
        self.tell = notify

    def on_start(self, _: Any) -> None:
        self.tell()

    def on_end(self, _: Any) -> None:
        """Nothing: the next event says what goes on."""


@contextmanager
def on_compile(notify: Callable[[], None]) -> Iterator[None]:
    """Call ``notify`` whenever a kernel is compiled rather than loaded from the cache."""
    listener = _CompileListener(notify)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
