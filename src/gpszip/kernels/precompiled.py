"""Compiled kernels that a wheel brings along, so that nothing is compiled at the first run.

``python scripts/compile_kernels.py`` writes them for any processor of this platform, and a wheel
holds them in the folder ``compiled`` beside this file. They have numba's format. Numba's own cache
knows kernels by the processor and its features, and by the time or content of one source file.
Here a kernel is known by all sources that it was compiled from, and by what its code depends on:
the versions of Python, numba and llvmlite, and the platform. Where one of them differs, the kernel
is compiled as ever. A kernel compiled for the very processor comes first.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import llvmlite
import llvmlite.binding
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _Cache,
)
from numba.core.runtime import rtsys

from gpszip.kernels.private_names import has_names
from gpszip.kernels.source_stamp import source_stamp

__all__ = ["KernelCache", "can_cache", "write_precompiled"]

#: What this module takes for granted, besides numba's documentation.
_PRIVATE_NAMES = {
    CompileResultCacheImpl: ("reduce",),
    FunctionCache: (
        "_cache_file",
        "_guard_against_spurious_io_errors",
        "_impl",
        "_impl_class",
        "_load_overload",
    ),
    IndexDataCacheFile: ("_load_index", "_source_stamp", "load", "save"),
    type(rtsys): ("initialize",),
}

#: The compiled kernels of an installed wheel; the folder is missing where there are none.
FOLDER = Path(__file__).with_name("compiled")

#: All caches made so far, one for each kernel that Python calls.
_CACHES: list[KernelCache] = []


class _Form(CompileResultCacheImpl):  # type: ignore[misc]
    """Compiled kernels as they are written: without the constants of functions that have none.

    Those of numba's own functions would import much of the compiler at each start.
    """

    def reduce(self, cres: Any) -> tuple[Any, ...]:
        """Return what is written of a compiled kernel."""
        *parts, environments = super().reduce(cres)
        if isinstance(environments, tuple):
            environments = tuple(one for one in environments if getattr(one, "consts", True))
        return *parts, environments


class _Files(FunctionCache):  # type: ignore[misc]
    """Numba's cache, with the form of compiled kernels changed."""

    _impl_class = _Form


def can_cache() -> bool:
    """Whether this numba has the cache that :class:`KernelCache` changes."""
    return all(has_names(kind, *names) for kind, names in _PRIVATE_NAMES.items())


class KernelCache(_Cache):  # type: ignore[misc]
    """Numba's cache of one kernel, and behind it the kernel that came with the wheel.

    Parameters
    ----------
    function : callable
        The kernel as a Python function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        _CACHES.append(self)

    @cached_property
    def numba(self) -> FunctionCache:
        """Numba's cache, opened at the first call: most kernels are never called in a process."""
        opened = _Files(self._function)
        # Drop a kernel also when a kernel that it calls has changed.
        file = opened._cache_file
        file._source_stamp = (file._source_stamp, source_stamp(self._function.__module__))
        return opened

    @property
    def cache_path(self) -> str:
        """The folder of numba's cache."""
        return cast(str, self.numba.cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the kernel compiled for these types of arguments; None if there is none.

        Numba's own method registers all that its compiler knows before it loads a kernel. That
        takes .2 s, and machine code needs only the functions that count references. The compiler
        registers the rest where it must compile.
        """
        rtsys.initialize(target_context)
        with self.numba._guard_against_spurious_io_errors():
            compiled = self.numba._load_overload(sig, target_context)
        if compiled is None and FOLDER.is_dir():
            data = self.precompiled(FOLDER).load(sig)
            if data is not None:
                compiled = self.numba._impl.rebuild(target_context, data)
        return compiled

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a compiled kernel."""
        self.numba.save_overload(sig, data)

    def precompiled(self, folder: Path) -> IndexDataCacheFile:
        """The kernel's files in a folder of compiled kernels."""
        module = self._function.__module__
        return IndexDataCacheFile(
            str(folder),
            f"{module}.{self._function.__qualname__}",
            (source_stamp(module), *_environment()),
        )

    def write(self, folder: Path) -> int:
        """Write what this cache holds to a folder of compiled kernels.

        Returns
        -------
        int
            Number of signatures.
        """
        file, written = self.numba._cache_file, 0
        for key in file._load_index():
            data = file.load(key)
            if data is not None:
                self.precompiled(folder).save(key[0], data)
                written += 1
        return written

    def enable(self) -> None:
        """Use numba's cache."""
        self.numba.enable()

    def disable(self) -> None:
        """Use numba's cache no more."""
        self.numba.disable()

    def flush(self) -> None:
        """Forget what numba's cache holds."""
        self.numba.flush()


def write_precompiled(folder: Path) -> int:
    """Write all kernels in numba's cache that modules imported so far define.

    Parameters
    ----------
    folder : Path
        Where the files go.

    Returns
    -------
    int
        Number of kernels written, each of their signatures counted.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return sum(cache.write(folder) for cache in _CACHES)


def _environment() -> tuple[str, ...]:
    """What compiled code depends on besides its source and numba, which checks its own version."""
    # macOS names its version, which does not matter to the code
    platform = re.sub(r"[\d.]+$", "", llvmlite.binding.get_process_triple())
    return sys.implementation.cache_tag, llvmlite.__version__, platform
