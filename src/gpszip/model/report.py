"""What a compression did, and how far it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

__all__ = ["Listener", "Progress", "Report"]


@dataclass(frozen=True)
class Progress:
    """One step of a long computation, handed to whoever listens.

    Parameters
    ----------
    stage : str
        What is being done, as a word for a person, such as ``"learn"``.
    done : float
        Share of the stage that is done, from 0 to 1.
    """

    stage: str
    done: float


#: Whoever wants to see :class:`Progress`: any function of one event.
Listener: TypeAlias = Callable[[Progress], None]


@dataclass(frozen=True)
class Report:
    """What a compression did.

    Parameters
    ----------
    points, tracks : int
        Samples and tracks that went in.
    segments, nodes, edges : int
        Straight parts of all walks, and the road map that they share.
    bytes_out : int
        Size of the archive.
    rmse, max_error : float
        Root mean square and largest synchronised distance in metres, of every sample to what the archive's bytes decode to.
    seconds : float
        Time that it took.
    gap : float
        Silences longer than this, in seconds, are gaps, during which no travel is claimed; infinite where there are none.
    bound : str
        The bound that was held, such as ``"RMSE <= 5 m"`` or ``"size <= 900 bytes"``; empty where there was none.
    notes : tuple of str
        What the user should know, one sentence each.
    """

    points: int
    tracks: int
    segments: int
    nodes: int
    edges: int
    bytes_out: int
    rmse: float
    max_error: float
    seconds: float
    gap: float
    bound: str
    notes: tuple[str, ...] = ()
