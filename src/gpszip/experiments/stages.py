"""CPU seconds of the stages of a computation."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["measured"]


@contextmanager
def measured(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the CPU seconds of this process within the block to those of a stage.

    Time on the clock would depend on what else the machine does.

    Examples
    --------
    >>> seconds = {}
    >>> with measured(seconds, "map"):
    ...     total = sum(range(1000))
    >>> list(seconds), seconds["map"] >= 0
    (['map'], True)
    """
    begin = time.process_time()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.process_time() - begin
