"""How archives are merged."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gpszip.errors import OptionError

__all__ = ["MergeOptions"]


@dataclass(frozen=True)
class MergeOptions:
    """How archives are merged.

    Parameters
    ----------
    deviation : float, optional
        Metres by which the curves of each archive may move in the root mean square.
    max_deviation : float, optional
        Metres by which they may move at any time. Without either, the smallest error bound of the
        archives.
    same_id : {"refuse", "prefix", "join"}
        What becomes of tracks of the same name in several archives. ``"prefix"`` names all tracks
        ``archive:track``; ``"join"`` takes them for one agent at different times.

    Raises
    ------
    OptionError
        If both deviations are given or one is out of range.
    """

    deviation: float | None = None
    max_deviation: float | None = None
    same_id: str = "refuse"

    def __post_init__(self) -> None:
        if self.deviation is not None and self.max_deviation is not None:
            raise OptionError("deviation and max_deviation were both given; give one")
        # Infinity and NaN fail this comparison, too.
        for name, value in (("deviation", self.deviation), ("max_deviation", self.max_deviation)):
            if value is not None and not 0 < value < math.inf:
                raise OptionError(f"{name} is {value:g}; it must be a positive number of metres")
        if self.same_id not in {"refuse", "prefix", "join"}:
            raise OptionError(f"same_id is {self.same_id!r}; choose 'refuse', 'prefix' or 'join'")
