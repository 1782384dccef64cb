"""Keep Arrow from importing pandas, which the command line doesn't need."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType

__all__ = ["hide_pandas", "show_pandas"]


class _HiddenPandas:
    """Finder of modules that finds no pandas."""

    @staticmethod
    def find_spec(
        name: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> None:
        """Raise if the module is pandas, so that no other finder is asked."""
        if name == "pandas":
            raise ModuleNotFoundError("pandas is not used by the command line", name=name)


def hide_pandas() -> None:
    """Let imports of pandas fail in this process, unless it is imported already.

    Where pandas is installed, Arrow imports it for its first scalar, which takes 0.3 s of CPU.

    Examples
    --------
    >>> hide_pandas()
    >>> show_pandas()
    """
    if _HiddenPandas not in sys.meta_path:
        sys.meta_path.insert(0, _HiddenPandas)


def show_pandas() -> None:
    """Let pandas be imported again after :func:`hide_pandas`."""
    if _HiddenPandas in sys.meta_path:
        sys.meta_path.remove(_HiddenPandas)
