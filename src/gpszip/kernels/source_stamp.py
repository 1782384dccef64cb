"""Digests of the sources that a kernel was compiled from.

Numba's cache looks at a kernel's own file only. A compiled kernel holds the code of the kernels
that it calls, so after an upgrade the cache could serve one that still contains old code.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib import resources

__all__ = ["source_stamp"]

_IMPORT = re.compile(r"^from (gpszip(?:\.\w+)+) import", re.MULTILINE)


@cache
def source_stamp(module: str) -> str:
    """Digest of the sources of a module and of all project modules that it imports.

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
    for name in sorted(_modules(module, frozenset())):
        digest.update(_source(name).encode())
    return digest.hexdigest()


def _modules(module: str, seen: frozenset[str]) -> frozenset[str]:
    """Add a module and those that it imports, directly or not, to the ones seen."""
    if module in seen:
        return seen
    seen |= {module}
    for name in _IMPORT.findall(_source(module)):
        seen = _modules(name, seen)
    return seen


@cache
def _source(module: str) -> str:
    """Text of a module of the package; empty where the source is not installed."""
    package, _, name = module.rpartition(".")
    try:
        return resources.files(package).joinpath(f"{name}.py").read_text("utf-8")
    except (OSError, ValueError, ModuleNotFoundError):
        return ""
