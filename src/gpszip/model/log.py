"""A position log as the pipeline sees it: tracks whose samples can be read in slices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from gpszip.model.grid import Plane
from gpszip.model.read_result import ReadResult
from gpszip.model.track import Track

__all__ = ["Log", "LogTrack", "MemoryLog"]


class LogTrack(Protocol):
    """What is known of a track before its samples are read: a name and a number of samples."""

    @property
    def id(self) -> str: ...  # noqa: D102
    @property
    def timed(self) -> bool: ...  # noqa: D102
    def __len__(self) -> int: ...


class Log(Protocol):
    """Tracks on one plane, in memory or on disk.

    Attributes
    ----------
    tracks : sequence of LogTrack
        At least one, with different ids.
    dimension : int
        Number of coordinates d.
    plane : Plane or None
        Where the positions lie on the earth; None for a log in x and y.
    read_result : ReadResult or None
        What was read, repaired and dropped; None for tracks that came from no file.
    """

    @property
    # What ``read`` takes: a track in memory, or an entry of the table of a log on disk.
    def tracks(self) -> Sequence[Any]: ...  # noqa: D102
    @property
    def dimension(self) -> int: ...  # noqa: D102
    @property
    def plane(self) -> Plane | None: ...  # noqa: D102
    @property
    def read_result(self) -> ReadResult | None: ...  # noqa: D102

    def read(self, track: Any, first: int = 0, last: int | None = None) -> Track:
        """Read samples ``first`` to ``last - 1`` of one of the tracks; by default all."""
        ...


@dataclass(frozen=True, eq=False)
class MemoryLog:
    """A log whose samples are all in memory.

    Parameters
    ----------
    tracks : tuple of Track
        At least one, on one plane, with different ids.
    read_result : ReadResult, optional
        What was read, repaired and dropped, for a log that came from files.

    Examples
    --------
    >>> track = Track("lane", range(5), [[float(t)] for t in range(5)])
    >>> log = MemoryLog((track,))
    >>> log.read(track, 1, 3).times.tolist()
    [1.0, 2.0]
    """

    tracks: tuple[Track, ...]
    read_result: ReadResult | None = None

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        # The first track stands for all: they are on one plane.
        return self.tracks[0].dimension

    @property
    def plane(self) -> Plane | None:
        """Where the positions lie on the earth."""
        return self.tracks[0].plane

    def read(self, track: Track, first: int = 0, last: int | None = None) -> Track:
        """Read samples ``first`` to ``last - 1`` of a track; the track itself where that is all."""
        last = len(track) if last is None else last
        # A new track copies its arrays, so the full one is passed on as it is, with all it holds.
        if first == 0 and last == len(track):
            return track

        # A slice has times and positions only: attributes and weights stay with the full track.
        return Track(
            track.id,
            track.times[first:last],
            track.positions[first:last],
            plane=track.plane,
            timed=track.timed,
        )
