"""Record of the outputs that a run has written, for messages if it ends early."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["collect_outputs", "report_output"]

# Each thread has a context of its own, so that runs in several threads keep apart.
_written: ContextVar[list[str] | None] = ContextVar("written", default=None)


@contextmanager
def collect_outputs() -> Iterator[list[str]]:
    """Yield a list to which :func:`report_output` appends while the block runs.

    A block inside another one shares its list.
    """
    enclosing = _written.get()
    written: list[str] = [] if enclosing is None else enclosing
    token = _written.set(written)
    try:
        yield written
    finally:
        _written.reset(token)


def report_output(message: str) -> None:
    """Append a message such as "walks.gpz is written" to the list of :func:`collect_outputs`."""
    written = _written.get()
    if written is not None:
        written.append(message)
