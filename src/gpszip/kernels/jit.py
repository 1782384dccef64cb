"""The compiler's settings, in one module: every kernel of the project is decorated here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from gpszip.kernels.source_stamp import source_stamp

__all__ = ["inlined", "jit"]

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile a kernel: cached on disk, without the interpreter's lock, with IEEE division.

    Threads, not the compiler, spread work over cores: numba's parallel loops and its disk cache
    exclude each other.
    """
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    _stamp_cache(compiled, function.__module__)
    return compiled


def inlined(function: F) -> F:
    """Compile a small kernel into the kernels that call it.

    A call that takes tuples of arrays counts references to each array, which costs more than a few
    arithmetic operations.
    """
    compiled: F = numba.njit(inline="always", nogil=True, error_model="numpy")(function)
    return compiled


def _stamp_cache(compiled: Any, module: str) -> None:
    """Make the cache drop a kernel also when a kernel that it calls has changed."""
    # Numba has no public interface for this. Without the private one, only the kernel's own file
    # counts.
    file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if file is not None and hasattr(file, "_source_stamp"):
        file._source_stamp = (file._source_stamp, source_stamp(module))
