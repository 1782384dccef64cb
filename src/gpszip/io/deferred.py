"""Functions whose modules are imported when they are called.

The tables of formats hold them, since help texts read the tables and must not wait for imports.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

__all__ = ["deferred"]


def deferred(module: str, name: str) -> Callable[..., Any]:
    """Return a function of a module, which is imported at the first call.

    Parameters
    ----------
    module : str
        Name of the module.
    name : str
        Name of the function.

    Examples
    --------
    >>> deferred("math", "hypot")(3, 4)
    5.0
    """

    def call(*arguments: Any, **keywords: Any) -> Any:
        # Python keeps imported modules, so that later calls only look the module up.
        return getattr(import_module(module), name)(*arguments, **keywords)

    return call
