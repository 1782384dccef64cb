"""HTML of values in notebooks, which :mod:`gpszip.view` makes."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["to_html"]


def to_html(function: str, value: Any) -> str:
    """HTML of a value by a function of :mod:`gpszip.view.notebook`.

    Values lie below the package that shows them, so that it is named and not imported: only a
    notebook that asks for HTML loads it.
    """
    shown: str = getattr(import_module("gpszip.view.notebook"), function)(value)
    return shown
