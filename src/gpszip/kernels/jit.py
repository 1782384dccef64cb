"""The compiler's settings, in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

__all__ = ["jit"]

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile a kernel: cached on disk, without the interpreter's lock, with IEEE division.

    Threads, not the compiler, spread work over cores: parallel loops and the disk cache don't go together.
    """
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return compiled
