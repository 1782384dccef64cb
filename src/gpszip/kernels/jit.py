"""The compiler's settings, in one module: every kernel of the project is decorated here.

Kernels are linked (:mod:`gpszip.kernels.linking`) and cached (:mod:`gpszip.kernels.precompiled`) by
changes of numba's private classes. Where a version of numba lacks one of them, kernels are compiled
as plain numba compiles them, which takes longer, or are not cached.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NoReturn, TypeVar, cast

import numba
from numba.core.types.misc import unliteral

try:
    from gpszip.kernels.linking import InnerCompiler, OuterCompiler, can_link

    LINKS = can_link()
except ImportError:
    LINKS = False
try:
    from gpszip.kernels.precompiled import KernelCache, can_cache

    CACHES = can_cache()
except ImportError:
    CACHES = False

__all__ = ["CACHES", "LINKS", "inner", "inner_uncounted", "jit", "jit_uncounted"]

F = TypeVar("F", bound=Callable[..., Any])


def jit(function: F) -> F:
    """Compile a kernel that Python calls: cached, without the interpreter's lock, IEEE division.

    Threads, not the compiler, spread work over cores: numba's parallel loops and its disk cache
    exclude each other.
    """
    return _compile_outer(function, nrt=True)


def jit_uncounted(function: F) -> F:
    """Compile a kernel that Python calls, without reference counts: see :func:`inner_uncounted`."""
    return _compile_outer(function, nrt=False)


def inner(function: F) -> F:
    """Compile a kernel that only kernels call: it is a part of each kernel that Python calls."""
    return _compile_inner(function, nrt=True)


def inner_uncounted(function: F) -> F:
    """Compile a kernel that only kernels call, without reference counts of arrays.

    The kernel may take arrays, write to them and slice them. It neither makes nor returns any, nor
    calls what returns one: the compiler refuses the first, and the others leak memory. Counts of a
    tuple of twenty arrays, for each use of one of them, take longer to compile and to run than
    most kernels.
    """
    return _compile_inner(function, nrt=False)


def _compile_outer(function: F, *, nrt: bool) -> F:
    """Compile a kernel that Python calls; ``nrt`` tells whether it counts references."""
    linking = {"_nrt": nrt, "pipeline_class": OuterCompiler} if LINKS else {}
    compiled: Any = numba.njit(nogil=True, error_model="numpy", **linking)(function)

    # Without the compiler, this is the Python function.
    if not numba.config.DISABLE_JIT:
        if CACHES:
            compiled._cache = KernelCache(function)
        if LINKS:
            # Kernels call it as an inner one: they take it apart from what Python calls.
            twin: Callable[[], Any] = cache(partial(_compile_inner, function, nrt=nrt))
            compiled.get_call_template = lambda kinds, names: twin().get_call_template(kinds, names)
            compiled.get_overload = lambda signature: twin().get_overload(signature)
    return cast(F, compiled)


def _compile_inner(function: F, *, nrt: bool) -> F:
    """Compile a kernel that only kernels call; ``nrt`` tells whether it counts references."""
    if not LINKS:
        return cast(F, numba.njit(nogil=True, error_model="numpy")(function))
    compiled: Any = numba.njit(
        nogil=True,
        error_model="numpy",
        no_cpython_wrapper=True,
        no_cfunc_wrapper=True,
        _nrt=nrt,
        pipeline_class=InnerCompiler,
    )(function)

    # Without the compiler, this is the Python function.
    if not numba.config.DISABLE_JIT:
        _take_constants_as_numbers(compiled)
        # Python finds nothing to call, and is told so.
        compiled._insert = lambda *_, **__: None
        compiled._compile_for_args = partial(_refuse_call, function.__qualname__)
    return cast(F, compiled)


def _take_constants_as_numbers(compiled: Any) -> None:
    """Compile a kernel once for all values of an argument, rather than again for each constant."""
    compiled.get_call_template = partial(_find_template, compiled.get_call_template)


def _find_template(find: Callable[..., Any], types: Any, names: Any) -> Any:
    """Find the compiled kernel for arguments of these types, by place and by name."""
    return find(
        tuple(unliteral(kind) for kind in types),
        {name: unliteral(kind) for name, kind in names.items()},
    )


def _refuse_call(name: str, *_: Any, **__: Any) -> NoReturn:
    raise TypeError(f"{name} is an inner kernel: only kernels call it")
