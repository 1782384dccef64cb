"""Digests of the sources that a kernel was compiled from.

Numba's cache checks a kernel's own file only. But a compiled kernel contains the code of the
kernels that it calls, so after an upgrade the cache could return a kernel with old code in it.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib import resources

__all__ = ["source_stamp"]

#: An import of names from a module of the project, at the start of a line.
_IMPORT = re.compile(r"^from (gpszip(?:\.\w+)+) import", re.MULTILINE)


@cache
def source_stamp(module: str) -> str:
    """Digest of the sources of a module and of all project modules that it imports, in any depth.

    Parameters
    ----------
    module : str
        Full name, such as ``"gpszip.kernels.heap"``.

    Returns
    -------
    str
        SHA-256 in hexadecimal digits.

    Examples
    --------
    >>> source_stamp("gpszip.kernels.heap") == source_stamp("gpszip.kernels.jit")
    False
    """
    digest = hashlib.sha256()
    for name in sorted(_collect_modules(module, frozenset())):
        digest.update(_read_source(name).encode())
    return digest.hexdigest()


def _collect_modules(module: str, seen: frozenset[str]) -> frozenset[str]:
    """Modules seen so far, with one module and all that it imports, directly or indirectly."""
    if module in seen:
        return seen
    seen |= {module}
    for name in _imported_modules(module):
        seen = _collect_modules(name, seen)
    return seen


@cache
def _imported_modules(module: str) -> tuple[str, ...]:
    """Project modules that a module imports."""
    return tuple(dict.fromkeys(_IMPORT.findall(_read_source(module))))


@cache
def _read_source(module: str) -> str:
    """Source text of a module; empty if the source is not installed."""
    package, _, name = module.rpartition(".")
    try:
        return resources.files(package).joinpath(f"{name}.py").read_text("utf-8")
    except (OSError, ValueError, ModuleNotFoundError):
        return ""
