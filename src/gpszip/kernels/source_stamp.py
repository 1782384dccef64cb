"""What a kernel was compiled from: its own source and that of the kernels built into it.

The compiler's cache looks at a kernel's own file only. A kernel holds the code of those it calls, so that after an upgrade
it might go on with an old one of them.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from importlib import resources

__all__ = ["source_stamp"]

_IMPORT = re.compile(r"^from gpszip\.kernels\.(\w+) import", re.MULTILINE)


@cache
def source_stamp(module: str) -> str:
    """Digest of the sources of a kernels' module and of all those that it imports, directly or not.

    Examples
    --------
    >>> source_stamp("heap") == source_stamp("heap"), source_stamp("heap") == source_stamp("jit")
    (True, False)
    """
    whole = hashlib.sha256()
    for name in sorted(_sources(module, frozenset())):
        whole.update(_source(name).encode())
    return whole.hexdigest()


def _sources(module: str, seen: frozenset[str]) -> frozenset[str]:
    if module in seen:
        return seen
    seen |= {module}
    for name in _IMPORT.findall(_source(module)):
        seen = _sources(name, seen)
    return seen


@cache
def _source(module: str) -> str:
    try:
        return resources.files("gpszip.kernels").joinpath(f"{module}.py").read_text("utf-8")
    except OSError:
        return ""
