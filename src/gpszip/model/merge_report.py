"""What a merge did."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Deviation", "MergeReport"]


@dataclass(frozen=True)
class Deviation:
    """How far curves were moved, in metres.

    Parameters
    ----------
    rms : float
        Root mean square, over the time travelled or over the knots, whichever is more.
    maximum : float
        Largest at any time.
    """

    rms: float
    maximum: float


@dataclass(frozen=True, repr=False)
class MergeReport:
    """What a merge did.

    Parameters
    ----------
    archives, tracks : int
        Archives that went in, and tracks that came out.
    segments, nodes, edges : int
        Straight segments of all walks, and the map that they share.
    nodes_in, edges_in : int
        Nodes and edges of all maps that went in.
    bytes_in, bytes_out : int
        Sizes of all archives that went in, and of the merged one.
    limit : float
        Deviation that was allowed, in metres.
    limits_maximum : bool
        Whether it held for the largest deviation, rather than for the root mean square.
    deviations : tuple of Deviation
        How far the curves of each archive were moved, measured on the bytes that came out.
    seconds : float
        Time that it took.
    notes : tuple of str
        What the user should know, one sentence each.
    """

    archives: int
    tracks: int
    segments: int
    nodes: int
    edges: int
    nodes_in: int
    edges_in: int
    bytes_in: int
    bytes_out: int
    limit: float
    limits_maximum: bool
    deviations: tuple[Deviation, ...]
    seconds: float
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return (
            f"MergeReport({self.archives} archives, {self.tracks:,} tracks, "
            f"{self.bytes_in:,} to {self.bytes_out:,} bytes, moved by {self.deviation.rms:.3g} m)"
        )

    @property
    def deviation(self) -> Deviation:
        """The largest of the deviations of all archives."""
        # The largest of each kind: they may be of different archives.
        return Deviation(
            max(moved.rms for moved in self.deviations),
            max(moved.maximum for moved in self.deviations),
        )
