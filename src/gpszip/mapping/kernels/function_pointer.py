"""Pointers to compiled kernels: a kernel calls a large one without compiling it again."""

from __future__ import annotations

from typing import Any

import numba
import numba.experimental.function_type  # lets numba know the types of pointers
from numba import typeof
from numba.core.types import CompileResultWAP

__all__ = ["pointer_to"]


def pointer_to(kernel: Any, *arguments: Any) -> Any:
    """Return a pointer to a kernel, compiled for the types of these arguments.

    Other kernels take the pointer as an argument. A direct call would compile a large kernel
    again within each kernel that calls it.
    """
    # Without the compiler, a Python function is its own pointer.
    if numba.config.DISABLE_JIT:
        return kernel

    types = tuple(typeof(argument) for argument in arguments)
    kernel.compile(types)
    return CompileResultWAP(kernel.overloads[types])
