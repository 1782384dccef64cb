"""Results of patching: the gaps of a log, filled or left open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model.text import count_text
from gpszip.model.track import Track

__all__ = ["Patch", "Patching"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Patch:
    """One gap of a track, filled or left open.

    Parameters
    ----------
    track : int
        Number of the track in the log.
    after : int
        Sample after which the gap lies.
    seconds : float
        Length of the gap.
    times : float64 array, shape (n,)
        Times in seconds of the samples added; empty where the gap was left open.
    positions : float64 array, shape (n, d)
        Positions in metres on the plane of the track.
    confidence : float64 array, shape (n,)
        Probability of the road under each, by the model.
    length : float
        Metres of the path; NaN where the gap was left open.
    reason : str
        Why it was left open; empty where it was filled.
    """

    track: int
    after: int
    seconds: float
    times: Floats
    positions: Floats
    confidence: Floats
    length: float = math.nan
    reason: str = ""

    def __repr__(self) -> str:
        samples = count_text(len(self.times), "sample")
        result = f"left open: {self.reason}" if self.reason else f"{samples}, {self.length:,.0f} m"
        return f"Patch(gap of {self.seconds:g} s in track {self.track}, {result})"


@dataclass(frozen=True, eq=False)
class Patching:
    """All gaps of a log.

    Parameters
    ----------
    tracks : tuple of Track
        The log.
    patches : tuple of Patch
        In the order of tracks and times.
    gap : float
        Seconds above which an interval is a gap.
    """

    tracks: tuple[Track, ...]
    patches: tuple[Patch, ...]
    gap: float

    def __repr__(self) -> str:
        gaps, samples = count_text(len(self.patches), "gap"), count_text(self.added, "sample")
        return f"Patching({gaps}, {self.filled:,} filled with {samples})"

    @property
    def added(self) -> int:
        """Number of samples added."""
        return sum(len(patch.times) for patch in self.patches)

    @property
    def filled(self) -> int:
        """Number of gaps filled."""
        return sum(not patch.reason for patch in self.patches)

    @property
    def open(self) -> tuple[Patch, ...]:
        """Gaps left open."""
        return tuple(patch for patch in self.patches if patch.reason)

    def to_tracks(self) -> list[Track]:
        """Return the tracks with the samples added.

        They have the attributes ``source`` (``log`` or ``patched``) and ``confidence`` (1 for
        samples of the log).
        """
        # Combine each track with its patches.
        patched = []
        for number, track in enumerate(self.tracks):
            # Samples of the log, and those added.
            # A gap that was left open adds nothing.
            patches = [
                patch for patch in self.patches if patch.track == number and len(patch.times)
            ]
            times = np.concatenate([track.times, *(patch.times for patch in patches)])
            positions = np.concatenate([track.positions, *(patch.positions for patch in patches)])
            confidence = np.concatenate(
                [np.ones(len(track)), *(patch.confidence for patch in patches)]
            )
            # Added samples follow those of the log in these arrays.
            is_added = np.arange(len(times)) >= len(track)

            # In order of time.
            order = np.argsort(times, kind="stable")
            attributes = {
                "source": np.where(is_added, "patched", "log")[order],
                "confidence": np.round(confidence[order], 3),
            }
            patched.append(
                Track(
                    track.id,
                    times[order],
                    positions[order],
                    attributes=attributes,
                    plane=track.plane,
                )
            )
        return patched
