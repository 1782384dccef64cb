"""The result of reading logs: the tracks, and a record of every point and file that is not in them.

:func:`gpszip.io.logs.read.read_logs` returns a :class:`ReadResult`. Its repairs, losses and files
left out tell a user what changed between the logs and the tracks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

from gpszip.model.frames import FrameMethods
from gpszip.model.html import to_html
from gpszip.model.text import count_text
from gpszip.model.track import Track

__all__ = ["LeftOut", "Loss", "OtherFiles", "ReadResult", "Repair"]

#: Suffixes of files that are shown.
_MAX_KINDS = 8


@dataclass(frozen=True)
class Repair:
    """One kind of change that a reader made to a log.

    Parameters
    ----------
    what : str
        The problem and what was done about it, such as ``rows without a position dropped``.
    count : int
        Number of points (or tracks) concerned.
    where : str
        Name of the log, with the first row concerned if that is known.
    drops : bool
        Whether the ``count`` points were dropped, so that no track has them.
    value : str
        The first value concerned, with its column, such as ``lat 'undefined'``; empty if there is
        no value to show.
    """

    what: str
    count: int
    where: str
    drops: bool = True
    value: str = ""


@dataclass(frozen=True)
class LeftOut:
    """A log, or an item in one, that was not read.

    Parameters
    ----------
    name : str
        Name of the log, with the item in it.
    reason : str
        Why it was left out.
    """

    name: str
    reason: str


@dataclass(frozen=True)
class OtherFiles:
    """Files of a folder or zip archive that were left out for one reason, with nothing wrong.

    They hold no positions, or those that another file holds, too.

    Parameters
    ----------
    where : str
        The folder or archive.
    what : str
        Which files, such as ``without positions``.
    count : int
        How many.
    kinds : tuple of (str, int)
        Suffixes and how many files have each, the most frequent ones first.
    """

    where: str
    what: str
    count: int
    kinds: tuple[tuple[str, int], ...]

    def __str__(self) -> str:
        """Describe them in words.

        Examples
        --------
        >>> str(OtherFiles("export.zip", "without positions", 5, ((".jpg", 3), (".csv", 2))))
        '5 files without positions: 3 .jpg, 2 .csv'
        """
        kinds = ", ".join(f"{count:,} {suffix}" for suffix, count in self.kinds[:_MAX_KINDS])
        kinds += ", ..." if len(self.kinds) > _MAX_KINDS else ""
        return f"{count_text(self.count, 'file')} {self.what}: {kinds}"


@dataclass(frozen=True)
class Loss:
    """A track that lost many of its points. Commands report losses before all other results.

    Rows that repeat an earlier row don't count as lost.

    Parameters
    ----------
    track : str
        Name of the track; empty for rows that can't be assigned to a track.
    where : str
        Name of the log.
    lost : int
        Number of its points that can't be used.
    points : int
        Number of its points in the log.
    shared : int
        The largest number of points that share one timestamp, of which those at the position of
        the first one count once; 0 if no two positions share one.
    """

    track: str
    where: str
    lost: int
    points: int
    shared: int = 0

    def __str__(self) -> str:
        """Describe the loss in words.

        Examples
        --------
        >>> str(Loss("bike", "log.csv", 24, 30, shared=5))
        "24 of 30 points of track 'bike' of log.csv, up to 5 at one time"
        """
        whose = f"track {self.track!r} of {self.where}" if self.track else self.where
        shared = f", up to {self.shared:,} at one time" if self.shared else ""
        return f"{self.lost:,} of {self.points:,} points of {whose}{shared}"


@dataclass(frozen=True, eq=False)
class ReadResult(Sequence[Track], FrameMethods):
    """Tracks on one common plane, and a record of how they were made from the logs.

    Every point read is either in a track or counted by a repair that drops points:
    ``points == kept + lost``.

    Parameters
    ----------
    tracks : tuple of Track
        In the order in which the logs first name them.
    points : int
        Number of points (rows) in the logs that were read.
    bytes : int
        Size of these logs as stored; for a gzip file, the compressed size.
    geographic : bool
        Whether the logs hold latitude and longitude.
    repairs : tuple of Repair
        Changes that the readers made.
    left_out : tuple of LeftOut
        Logs, and items in logs, that were not read.
    dropped_columns : tuple of str
        Columns of the logs that no attribute keeps.
    losses : tuple of Loss
        Tracks that lost more than a tenth of their points, or that have several points at one
        timestamp.
    not_selected : int
        Number of points that were left out because a selection leaves them out; they are not among
        ``points``.
    other_files : tuple of OtherFiles
        Files of folders and zip archives that hold no log, or one that another file holds, too.
    """

    tracks: tuple[Track, ...]
    points: int
    bytes: int
    geographic: bool
    repairs: tuple[Repair, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    dropped_columns: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()
    other_files: tuple[OtherFiles, ...] = ()
    not_selected: int = 0

    def __repr__(self) -> str:
        tracks, points = count_text(len(self.tracks), "track"), count_text(self.points, "point")
        return f"ReadResult({tracks}, {points}, {self.lost:,} lost)"

    def _repr_html_(self) -> str:
        return to_html("show_tracks", list(self))

    # With this and the next method, Sequence can iterate, search and count.
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
        """Number of points that were dropped."""
        # Other repairs change points, such as their order, and lose none.
        return sum(repair.count for repair in self.repairs if repair.drops)
