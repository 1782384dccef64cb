"""Compiling kernels together with all that they call, once.

Numba optimises each kernel by itself and generates its machine code, even of one that only kernels
call, and does so again within each kernel that calls it. Here the kernels that only kernels call
stay as they are until the kernel that Python calls is compiled: its module takes all of them, is
optimised once, and machine code is generated once.

Only kernels compiled by these classes may call an inner kernel: a function with plain ``njit``
does not link what the inner kernel calls, and crashes.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import CodeType
from typing import Any

from numba.core.base import BaseContext
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import PassManager
from numba.core.cpu import CPUTargetOptions
from numba.core.dispatcher import Dispatcher
from numba.core.environment import lookup_environment
from numba.core.typed_passes import NopythonRewrites
from numba.core.untyped_passes import FixupArgs, InlineClosureLikes, WithLifting

from gpszip.kernels.private_names import has_names
from gpszip.kernels.references import POINTER, TakeReferences

__all__ = ["InnerCompiler", "OuterCompiler", "can_link"]

#: What this module and :mod:`gpszip.kernels.jit` take for granted, besides numba's documentation.
_PRIVATE_NAMES = {
    JITCodeLibrary: (
        "_codegen",
        "_final_module",
        "_finalize_dynamic_globals",
        "_finalize_specific",
        "_linking_libraries",
        "_optimize_final_module",
        "_raise_if_finalized",
        "add_linking_library",
        "add_llvm_module",
        "enable_object_caching",
        "finalize",
        "get_defined_functions",
    ),
    BaseContext: ("get_abi_sizeof", "get_value_type", "target_data"),
    CompilerBase: ("compile_extra", "define_pipelines", "state"),
    Flags: ("_values", "no_compile", "nrt"),
    CPUTargetOptions: ("_nrt",),
    PassManager: ("add_pass_after", "finalize", "passes"),
    Dispatcher: ("_compile_for_args", "_insert", "get_call_template", "get_overload"),
}

#: Beginning of the name of the variable that holds a kernel's environment: its constants.
_ENVIRONMENT = "_ZN08NumbaEnv"

#: Allocations between two collections of garbage while a kernel is compiled: the compiler makes
#: millions of objects that stay. Python's 700 take 15 % of the time.
_GARBAGE_THRESHOLDS = (50_000, 20, 50)

#: Bytes of each type of LLVM by its name. Numba asks at each use of an array, and LLVM compiles a
#: module to answer.
_SIZES: dict[str, int] = {}


def can_link() -> bool:
    """Whether this numba has what the classes below change; a later version may lack it."""
    return all(has_names(kind, *names) for kind, names in _PRIVATE_NAMES.items())


class _Library(JITCodeLibrary):  # type: ignore[misc]
    """Code of one kernel before it is optimised, and the libraries of the kernels it calls."""

    def add_ir_module(self, ir_module: Any) -> None:
        """Add code; tell LLVM that nothing changes a tuple behind a reference."""
        for function in ir_module.functions:
            for argument in function.args:
                if argument.type == POINTER:
                    argument.add_attribute("noalias")
        super().add_ir_module(ir_module)

    def add_llvm_module(self, ll_module: Any) -> None:
        """Add code as it is: it is optimised with all other code, rather than by function."""
        ll_module.data_layout = self._codegen._data_layout
        self._final_module.link_in(ll_module)

    def add_linking_library(self, library: Any) -> None:
        """Link a kernel that is called, and all kernels that it calls."""
        super().add_linking_library(library)
        if isinstance(library, _InnerLibrary):
            self._linking_libraries.extend(library._linking_libraries)


class _InnerLibrary(_Library):
    """Code of a kernel that only kernels call: nothing is optimised or generated."""

    def finalize(self) -> None:
        """End the library; what it calls is linked later."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        self._finalized = True


class _OuterLibrary(_Library):
    """Code of a kernel that Python calls, and of all kernels that it calls."""

    def _optimize_final_module(self) -> None:
        """Hide the inner kernels, so that they may be changed freely, and optimise all."""
        inner = {
            function.name
            for library in self._linking_libraries
            if isinstance(library, _InnerLibrary)
            for function in library.get_defined_functions()
        }
        for function in self._final_module.functions:
            if function.name in inner and not function.is_declaration:
                function.linkage = "internal"
        super()._optimize_final_module()

    def _finalize_specific(self) -> None:
        """Generate machine code, and set the environments of the inner kernels."""
        super()._finalize_specific()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self._codegen.set_env(variable.name, environment)


class _Flags(Flags):  # type: ignore[misc]
    """Numba's flags, compared by what is set.

    Numba compares flags for each call that it types, by a dictionary of all settings: a tenth of
    the time to compile.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        return _HASH_OF_FLAGS

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Flags):
            return NotImplemented
        mine, others = self._values, other._values
        return mine == others or all(
            getattr(self, name) == getattr(other, name) for name in mine.keys() | others.keys()
        )


#: Numba's hash of any flags.
_HASH_OF_FLAGS = hash(Flags())


class _Compiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler, with flags that are compared faster, and sizes that are kept."""

    def __init__(
        self,
        typingctx: Any,
        targetctx: Any,
        library: Any,
        args: Any,
        return_type: Any,
        flags: Flags,
        locals: Any,
    ) -> None:
        super().__init__(typingctx, targetctx, library, args, return_type, _Flags(flags), locals)
        # Remember the sizes of types.
        context = self.state.targetctx
        context.get_abi_sizeof = partial(_size_of, context.target_data)


def _size_of(target: Any, kind: Any) -> int:
    """Bytes of a type of LLVM."""
    name = str(kind)
    if name not in _SIZES:
        _SIZES[name] = kind.get_abi_size(target)
    return _SIZES[name]


class OuterCompiler(_Compiler):
    """Numba's compiler for kernels that Python calls."""

    def define_pipelines(self) -> list[Any]:
        """Numba's steps, with another library and references to tuples."""
        _use_library(self.state, _OuterLibrary)
        steps = _needed_steps(self.state)
        steps.add_pass_after(TakeReferences, FixupArgs)
        steps.finalize()
        return [steps]

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a kernel, and before that the inner kernels that it calls."""
        with _collect_garbage_rarely():
            return super().compile_extra(func)


class InnerCompiler(_Compiler):
    """Numba's compiler for kernels that only kernels call."""

    def define_pipelines(self) -> list[Any]:
        """Numba's steps, without the last one: no machine code."""
        _use_library(self.state, _InnerLibrary)
        self.state.flags.no_compile = True
        return [_needed_steps(self.state)]

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a kernel, and let other kernels find it."""
        # There is no compiled function by which numba could know it; its description stands for it.
        result = super().compile_extra(func)
        result = result._replace(entry_point=result.fndesc)
        result.target_context.insert_user_function(
            result.entry_point, result.fndesc, [result.library]
        )
        return result


def _needed_steps(state: Any) -> Any:
    """Numba's steps, without those that would find nothing to change in a kernel."""
    # No kernel has a `with` statement; most have neither functions within nor lists of numbers.
    needless: set[Any] = {WithLifting}
    code = state.func_id.func.__code__
    if "array" not in code.co_names and not any(isinstance(c, CodeType) for c in code.co_consts):
        needless.add(InlineClosureLikes)

    # Without reference counts, there are no expressions of whole arrays.
    if not state.flags.nrt:
        needless.add(NopythonRewrites)
    steps = DefaultPassBuilder.define_nopython_pipeline(state)
    steps.passes = [step for step in steps.passes if step[0] not in needless]
    steps.finalize()
    return steps


def _use_library(state: Any, kind: type[_Library]) -> None:
    """Compile into a library of this kind; numba's pipeline makes one if there is none."""
    state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
    state.library.enable_object_caching()


@contextmanager
def _collect_garbage_rarely() -> Iterator[None]:
    """Raise the thresholds of the garbage collector, unless it is off."""
    thresholds = gc.get_threshold()
    if thresholds[0] > 0:
        gc.set_threshold(*_GARBAGE_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
