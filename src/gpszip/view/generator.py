"""The program that makes a page, with its version."""

from __future__ import annotations

import sys

__all__ = ["generator_name"]


def generator_name() -> str:
    """Name and version, such as ``GPSZip 0.1.0``.

    The version stands at the top of all packages, which none of them imports.
    """
    return f"GPSZip {sys.modules['gpszip'].__version__}"
