"""What a run has written so far, for what is said if it ends early."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["collect_outputs", "report_output"]

_written: ContextVar[list[str] | None] = ContextVar("written", default=None)


@contextmanager
def collect_outputs() -> Iterator[list[str]]:
    """Give a list that takes what is written, in words, for as long as the block lasts."""
    written: list[str] = []
    before = _written.set(written)
    try:
        yield written
    finally:
        _written.reset(before)


def report_output(what: str) -> None:
    """Tell whoever listens, see :func:`collect_outputs`, what is written."""
    listener = _written.get()
    if listener is not None:
        listener.append(what)
