"""What was read from logs: the tracks, and an account of everything that is not in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

from gpszip.model.text import count_text
from gpszip.model.track import Track

__all__ = ["LeftOut", "Loss", "ReadResult", "Repair"]


@dataclass(frozen=True)
class Repair:
    """Something that was mended while reading.

    Parameters
    ----------
    what : str
        What was wrong and what was done, such as ``rows without a position dropped``.
    count : int
        How many points (or tracks) it concerned.
    where : str
        Name of the log, with the first row concerned where that is known.
    drops : bool
        Whether the ``count`` points are in no track for it.
    value : str
        The first value concerned, with its column, such as ``lat 'undefined'``; empty where none is to be shown.
    """

    what: str
    count: int
    where: str
    drops: bool = True
    value: str = ""


@dataclass(frozen=True)
class LeftOut:
    """A whole log, or a part of one, that was not read.

    Parameters
    ----------
    name : str
        Name of what was left out.
    reason : str
        Why.
    """

    name: str
    reason: str


@dataclass(frozen=True)
class Loss:
    """A track that lost so many of its points that it must be told first.

    Rows that say the same once more are no loss.

    Parameters
    ----------
    track : str
        Name of the track; empty for rows of which it is not known whose they are.
    where : str
        Name of the log.
    lost : int
        How many of its points can't be used.
    points : int
        How many the log holds.
    shared : int
        The most points at different positions that have one time in common; 0 where there are none such.
    """

    track: str
    where: str
    lost: int
    points: int
    shared: int = 0

    def __str__(self) -> str:
        """Tell the loss in words.

        Examples
        --------
        >>> str(Loss("bike", "log.csv", 24, 30, shared=5))
        "24 of 30 points of track 'bike' of log.csv, up to 5 at one time"
        """
        whose = f"track {self.track!r} of {self.where}" if self.track else self.where
        shared = f", up to {self.shared:,} at one time" if self.shared else ""
        return f"{self.lost:,} of {self.points:,} points of {whose}{shared}"


@dataclass(frozen=True, eq=False)
class ReadResult(Sequence[Track]):
    """Tracks on one common plane with an account of how they came about.

    Every point that was read is either in a track or counted by a repair that drops: ``points == kept + lost``.

    Parameters
    ----------
    tracks : tuple of Track
        In the order in which the logs first name them.
    points : int
        Number of points (rows) found in the logs that were read.
    bytes : int
        Size of these logs as they are stored: of a gzip file, the packed size.
    geographic : bool
        Whether the logs came with latitude and longitude.
    repairs : tuple of Repair
        What was mended.
    left_out : tuple of LeftOut
        What was not read.
    dropped_columns : tuple of str
        Columns of the logs that are not kept.
    losses : tuple of Loss
        Tracks that lost more than a tenth of their points, or all, or have several points at one time.
    """

    tracks: tuple[Track, ...]
    points: int
    bytes: int
    geographic: bool
    repairs: tuple[Repair, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    dropped_columns: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()

    def __repr__(self) -> str:
        tracks, points = count_text(len(self.tracks), "track"), count_text(self.points, "point")
        return f"ReadResult({tracks}, {points}, {self.lost:,} lost)"

    def __len__(self) -> int:
        return len(self.tracks)

    @overload
    def __getitem__(self, number: int) -> Track: ...
    @overload
    def __getitem__(self, number: slice) -> tuple[Track, ...]: ...
    def __getitem__(self, number: int | slice) -> Track | tuple[Track, ...]:
        """Return a track, or some, in the order in which the logs first name them."""
        return self.tracks[number]

    @property
    def complete(self) -> bool:
        """Whether no log was left out, and no track lost more than a few points."""
        return not self.left_out and not self.losses

    @property
    def kept(self) -> int:
        """Number of points in the tracks."""
        return sum(len(track) for track in self.tracks)

    @property
    def lost(self) -> int:
        """Number of points that repairs dropped."""
        return sum(repair.count for repair in self.repairs if repair.drops)
