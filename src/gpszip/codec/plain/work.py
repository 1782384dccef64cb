"""How much a plain decoder may do before the compiled one is faster."""

from __future__ import annotations

__all__ = ["TooMuchWorkError", "WorkLimit"]


class TooMuchWorkError(Exception):
    """The work limit is reached: the compiled decoder has to decode the payload."""


class WorkLimit:
    """Counts the work that is left.

    Parameters
    ----------
    units : int
        Work in units: distributions evaluated, candidates weighed, entries searched.
    """

    __slots__ = ("_left",)

    def __init__(self, units: int) -> None:
        self._left = units

    def check(self, units: int) -> None:
        """Refuse work that is more than what is left, before any of it is done.

        Raises
        ------
        TooMuchWorkError
            If there is less left.
        """
        if units > self._left:
            raise TooMuchWorkError

    def spend(self, units: int) -> None:
        """Count some work.

        Raises
        ------
        TooMuchWorkError
            If more is spent than there was; from then on, all work is refused.
        """
        # The count stays below zero, so that a process that has reached the limit never tries
        # again.
        self._left -= units
        if self._left < 0:
            raise TooMuchWorkError
