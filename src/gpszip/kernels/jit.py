"""The compiler's settings, in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from gpszip.kernels.source_stamp import source_stamp

__all__ = ["inlined", "jit"]

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile a kernel: cached on disk, without the interpreter's lock, with IEEE division.

    Threads, not the compiler, spread work over cores: parallel loops and the disk cache don't go together.
    """
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    _stamp_cache(compiled, function.__module__)
    return compiled


def inlined(function: F) -> F:
    """Compile a small kernel into those that call it.

    A call that takes tuples of arrays counts references to each, which costs more than a few numbers' work.
    """
    compiled: F = numba.njit(inline="always", nogil=True, error_model="numpy")(function)
    return compiled


def _stamp_cache(compiled: Any, module: str) -> None:
    """Have the cache forget a kernel when one that it calls has changed, too."""
    # the compiler has no public way to say so; without it, only its own file counts
    file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if file is not None and hasattr(file, "_source_stamp"):
        file._source_stamp = (file._source_stamp, source_stamp(module))
