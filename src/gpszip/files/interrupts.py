"""Signals that wait until files are in order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["defer_signals"]

#: The signals of Ctrl-C, ``kill`` and a closed terminal, as far as the system has them.
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


@contextmanager
def defer_signals() -> Iterator[None]:
    """Delay the handling of signals until the block ends.

    Python handles signals in the main thread only; in other threads this does nothing.
    """
    # Handlers that Python would call; others are the system's and stay.
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        current = {number: signal.getsignal(number) for number in _SIGNALS}
        handlers = {number: handler for number, handler in current.items() if callable(handler)}

    # Record signals during the block.
    received: list[tuple[int, FrameType | None]] = []
    try:
        for number in handlers:
            signal.signal(number, lambda *arguments: received.append(arguments))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)

    # Handle the first one now.
    for number, stack in received[:1]:
        handlers[signal.Signals(number)](number, stack)
