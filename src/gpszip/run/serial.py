"""The executor that runs items one by one in the calling thread."""

from __future__ import annotations

from gpszip.run.executor import Serial

__all__ = ["Serial"]
