"""Being told to end, by whatever signal, is being interrupted: temporary files go, and nothing is written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["ignore_signals", "interrupt_on_signals"]


@contextmanager
def interrupt_on_signals() -> Iterator[None]:
    """Let the signals to terminate and to hang up do what Ctrl-C does, where nobody else has a use for them."""
    names = ("SIGTERM", "SIGHUP") if threading.current_thread() is threading.main_thread() else ()
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    ours = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def ignore_signals() -> None:
    """Let no signal disturb the interpreter on its last steps: all is done, and told."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
