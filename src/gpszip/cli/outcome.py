"""How a command ends that did not fail."""

from __future__ import annotations

from enum import Enum

__all__ = ["Outcome"]


class Outcome(Enum):
    """How a command ended."""

    DONE = "done"
    #: Done, but some inputs, or many points of a track, could not be used and were named.
    LEFT_OUT = "left out"
