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
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding
from numba.core.caching import FunctionCache, IndexDataCacheFile

from gpszip.kernels.source_stamp import source_stamp

__all__ = ["KernelCache", "write_precompiled"]

#: The compiled kernels of an installed wheel; the folder is missing where there are none.
FOLDER = Path(__file__).with_name("compiled")

#: All caches made so far, one for each kernel that Python calls.
_CACHES: list[KernelCache] = []


class KernelCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache of one kernel, and behind it the kernel that came with the wheel.

    Parameters
    ----------
    function : callable
        The kernel as a Python function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._function = function
        self._stamp_sources()
        _CACHES.append(self)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the kernel compiled for these types of arguments; None if there is none."""
        compiled = super().load_overload(sig, target_context)
        if compiled is None and FOLDER.is_dir():
            data = self.precompiled(FOLDER).load(sig)
            if data is not None:
                compiled = self._impl.rebuild(target_context, data)
        return compiled

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
        file, written = self._cache_file, 0
        for key in file._load_index():
            data = file.load(key)
            if data is not None:
                self.precompiled(folder).save(key[0], data)
                written += 1
        return written

    def _stamp_sources(self) -> None:
        """Drop a kernel also when a kernel that it calls has changed."""
        file = self._cache_file
        file._source_stamp = (file._source_stamp, source_stamp(self._function.__module__))


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
