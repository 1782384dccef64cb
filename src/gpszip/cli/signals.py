"""Treat every signal that ends a process as an interrupt: temporary files are removed."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["ignore_signals", "interrupt_on_signals"]

#: Seconds after which an interrupt is raised again that a callback has swallowed.
_RETRY_SECONDS = 0.1


@contextmanager
def interrupt_on_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt at SIGTERM and SIGHUP, as Ctrl-C does.

    Signals that the caller handles or ignores stay as they are. Python sets signals in the main
    thread only. An interrupt while the compiler calls Python back, which can raise nothing there,
    is raised again after the callback.
    """
    names = ("SIGTERM", "SIGHUP") if threading.current_thread() is threading.main_thread() else ()
    # Windows has no SIGHUP. A signal that is ignored stays so: nohup ignores SIGHUP on purpose.
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    unhandled = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    for number in unhandled:
        signal.signal(number, signal.default_int_handler)
    hook = sys.unraisablehook
    again = unhandled[0] if unhandled else signal.SIGINT

    def interrupt_again(unraisable: sys.UnraisableHookArgs) -> None:
        is_main = threading.current_thread() is threading.main_thread()
        if is_main and issubclass(unraisable.exc_type, KeyboardInterrupt):
            threading.Timer(_RETRY_SECONDS, _interrupt_main, [again]).start()
        else:
            hook(unraisable)

    sys.unraisablehook = interrupt_again
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number in unhandled:
            signal.signal(number, signal.SIG_DFL)


def _interrupt_main(number: signal.Signals) -> None:
    """Send a signal to the main thread, so that it stops waiting, too."""
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)
    else:
        _thread.interrupt_main(number)


def ignore_signals() -> None:
    """Ignore signals while the interpreter shuts down: everything is done and reported."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
