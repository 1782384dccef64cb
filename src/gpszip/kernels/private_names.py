"""Private names of numba: whether the installed version has them."""

from __future__ import annotations

__all__ = ["has_names"]


def has_names(kind: type, *names: str) -> bool:
    """Whether a class has methods of these names, or sets attributes of these names at the start.

    Parameters
    ----------
    kind : type
        The class.
    *names : str
        Names of methods, or of attributes that ``__init__`` sets.

    Examples
    --------
    >>> class Point:
    ...     def __init__(self, x):
    ...         self.x = x
    >>> has_names(Point, "x", "__init__"), has_names(Point, "y")
    (True, False)
    """
    initialisers = [vars(base).get("__init__") for base in kind.__mro__]
    named = {
        name
        for initialiser in initialisers
        for name in getattr(getattr(initialiser, "__code__", None), "co_names", ())
    }
    return all(hasattr(kind, name) or name in named for name in names)
