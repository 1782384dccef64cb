"""What a picture shows: archives, and the log that they were made from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.drawing.map_lines import main_plane, on_plane
from gpszip.errors import OptionError
from gpszip.model import Plane, Track

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gpszip.archive import Archive

__all__ = ["Area", "Subject", "require_times"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Subject:
    """Archives, their names, and the tracks of the log.

    Parameters
    ----------
    archives : tuple of Archive
        One; several for the kind ``rate``.
    names : tuple of str
        A name for each archive; empty for one that was not read from a file.
    tracks : tuple of Track
        The log on the planes of the first archive; empty where it is not given.
    """

    archives: tuple[Archive, ...]
    names: tuple[str, ...]
    tracks: tuple[Track, ...] = ()

    @property
    def archive(self) -> Archive:
        """The first archive."""
        return self.archives[0]

    @property
    def samples(self) -> list[Floats]:
        """Positions of the samples of each track in metres."""
        return [track.positions for track in self.tracks]


@dataclass(frozen=True)
class Area:
    """What one picture shows of a log on several planes: the plane with the most positions.

    Parameters
    ----------
    plane : Plane or None
        The planes of the log.
    index : int or None
        The plane that is shown; None where there is only one.
    """

    plane: Plane | None
    index: int | None

    @classmethod
    def of(cls, subject: Subject, vertices: Sequence[Floats]) -> Area:
        """Choose the plane with the most samples, or vertices where there is no log."""
        plane = subject.archive.grid.plane
        return cls(plane, main_plane(subject.samples or vertices, plane))

    def samples(self, subject: Subject) -> list[Floats]:
        """Return the samples that are shown."""
        return [each[on_plane(each, self.plane, self.index)] for each in subject.samples]

    def holds(self, line: Floats) -> bool:
        """Whether a line is shown; no line leads from one plane to another."""
        return bool(on_plane(line[:1], self.plane, self.index).all())


def require_times(subject: Subject, kind: str) -> None:
    """Refuse an archive without times.

    Raises
    ------
    OptionError
        If no track has times.
    """
    if not subject.archive.timed:
        raise OptionError(
            f"the archive has no times, so no picture of the kind {kind}",
            remedy="compress without --no-times, or draw another kind",
        )
