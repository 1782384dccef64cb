"""Work in this thread, item by item."""

from __future__ import annotations

from gpszip.run.executor import Serial

__all__ = ["Serial"]
