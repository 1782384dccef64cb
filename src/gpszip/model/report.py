"""What a compression did, and the progress of a long computation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

__all__ = ["Listener", "Progress", "Report"]


@dataclass(frozen=True)
class Progress:
    """One step of a long computation, passed to the ``progress`` function of the caller.

    Parameters
    ----------
    stage : str
        Name of the stage for a person, such as ``"learn"``.
    done : float
        Share of the stage that is done, from 0 to 1.
    points : int, default 0
        Samples that the stage works on; 0 if that is unknown.
    """

    stage: str
    done: float
    points: int = 0


#: What ``progress=`` takes: any function of one :class:`Progress`.
Listener: TypeAlias = Callable[[Progress], None]


@dataclass(frozen=True, repr=False)
class Report:
    """What a compression did.

    Parameters
    ----------
    points, tracks : int
        Samples and tracks that went in.
    segments, nodes, edges : int
        Straight segments of all walks, and the road map that they share.
    bytes_out : int
        Size of the archive.
    rmse, max_error : float
        Root mean square and largest synchronised distance in metres, between every sample and what
        the archive's bytes decode to.
    seconds : float
        Time that it took.
    gap : float
        Intervals longer than this, in seconds, are gaps, in which no travel is claimed; infinite
        where there are none.
    bound : str
        The bound that was held, such as ``"RMSE <= 5 m"`` or ``"size <= 900 bytes"``; empty where
        there was none.
    notes : tuple of str
        What the user should know, one sentence each.
    """

    points: int
    tracks: int
    segments: int
    nodes: int
    edges: int
    bytes_out: int
    # Measured on the bytes of the archive, not on what was learned: rounding to the grid counts.
    rmse: float
    max_error: float
    seconds: float
    gap: float
    bound: str
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        maximum = "" if math.isinf(self.max_error) else f"maximum {self.max_error:.3g} m, "
        return (
            f"Report({self.points:,} points to {self.bytes_out:,} bytes, RMSE {self.rmse:.3g} m, "
            f"{maximum}{self.seconds:.3g} s)"
        )
