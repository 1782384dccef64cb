"""The memory that a computation takes beyond what the process had before."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Memory", "measured_memory"]

#: Linux: writing 5 sets the largest size of the process so far to its present one.
_RESET = (Path("/proc/self/clear_refs"), "5")

#: Linux: sizes of this process in KiB.
_STATUS = Path("/proc/self/status")

#: Bytes of a KiB.
_KIB = 1024


@dataclass
class Memory:
    """Bytes at the peak of a computation, beyond those before; None where nothing tells them."""

    bytes: int | None = None


@contextmanager
def measured_memory() -> Iterator[Memory]:
    """Measure the peak of the resident memory within the block, on Linux.

    Memory that other threads give back within the block is missing in it.

    Examples
    --------
    >>> with measured_memory() as memory:
    ...     size = len(bytearray(200_000_000))
    >>> memory.bytes is None or memory.bytes > 100_000_000
    True
    """
    memory, before = Memory(), None
    try:
        _RESET[0].write_text(_RESET[1])
        before = _size("VmRSS")
    except OSError:
        pass
    yield memory
    peak = None if before is None else _size("VmHWM")
    if before is not None and peak is not None:
        memory.bytes = max(peak - before, 0)


def _size(name: str) -> int | None:
    """Return one of the sizes of the process in bytes."""
    for line in _STATUS.read_text().splitlines():
        key, _, value = line.partition(":")
        if key == name:
            return int(value.split()[0]) * _KIB
    return None
