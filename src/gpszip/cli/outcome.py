"""How a command that did not fail has ended."""

from __future__ import annotations

from enum import Enum

__all__ = ["Outcome"]


class Outcome(Enum):
    """How a command ended."""

    DONE = "done"
    #: Done, but some inputs or many points of a track could not be used; a message names them.
    LEFT_OUT = "left out"
