"""A compiled kernel as a value, to be called from another one without being built into it."""

from __future__ import annotations

from typing import Any

import numba
from numba import typeof
from numba.core.types import CompileResultWAP

__all__ = ["pointer_to"]


def pointer_to(kernel: Any, *arguments: Any) -> Any:
    """Return a kernel, compiled for arguments like these, so that other kernels can take it as an argument.

    A large kernel that is called in the usual way is compiled again as a part of each that calls it.
    """
    if numba.config.DISABLE_JIT:
        return kernel
    types = tuple(typeof(argument) for argument in arguments)
    kernel.compile(types)
    return CompileResultWAP(kernel.overloads[types])
