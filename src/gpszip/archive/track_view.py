"""One track of an archive, and the questions that it answers without the other tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.frames import TrackFrames
from gpszip.archive.pieces import clip_to_time_range, time_range_of_piece
from gpszip.errors import OptionError
from gpszip.model.text import count_text
from gpszip.model.timestamps import Times, format_span
from gpszip.model.track import Track, time_bounds
from gpszip.model.walk import Walk, cut_at_gaps

if TYPE_CHECKING:
    from gpszip.archive.archive import Archive
    from gpszip.codec.waypoints import Waypoints

__all__ = ["TrackView"]


@dataclass(frozen=True, eq=False, repr=False)
class TrackView(TrackFrames):
    """One track of an archive: ``archive["walk-3"]``.

    It decodes the group of the track and no other, save for ``walk`` and ``waypoints``, which are
    over the nodes of the whole map.

    Parameters
    ----------
    archive : Archive
        The archive.
    id : str
        Name of the track.

    Examples
    --------
    >>> from gpszip import compress
    >>> lane = Track("lane", range(20), [[abs(t % 8 - 4.0), 0.0] for t in range(20)])
    >>> view = compress(lane, max_error=0.1)["lane"]
    >>> view
    TrackView('lane', 1 piece, 0 s to 19 s)
    >>> view.position(5.5).round(1).tolist()
    [1.5, 0.0]
    >>> [piece.times.tolist() for piece in view[5:11]]
    [[5.0, 8.0, 11.0]]
    """

    archive: Archive
    id: str

    def __repr__(self) -> str:
        pieces = count_text(len(cut_at_gaps(self._knots[0])), "piece")
        start, end = self.start, self.end
        span = "no times" if start is None or end is None else format_span(start, end)
        return f"TrackView({self.id!r}, {pieces}, {span})"

    def __getitem__(self, span: slice) -> list[Track]:
        """Pieces in a time range, ``view[begin:end]``, cut where it begins and ends.

        Parameters
        ----------
        span : slice of times
            Seconds, ``datetime``, ``numpy.datetime64`` or ISO 8601 text; no step.

        Returns
        -------
        list of Track
            Knots, between which each piece is linear in time; empty where no travel is claimed.

        Raises
        ------
        OptionError
            If the track has no times, or the range looks like another unit than the log's.
        """
        # Refuse a time range of a shape, which has no times.
        begin, end = time_bounds(span)
        if not self.timed:
            raise OptionError("has no times, so no time range", location=f"track {self.id!r}")

        # Pieces that the range touches, with knots where it begins and ends.
        cut = [
            Track(piece.id, *clipped, plane=piece.plane)
            for piece in self.pieces
            if begin <= piece.times[-1] and end >= piece.times[0]
            for clipped in [_clip(piece, begin, end)]
        ]

        # Without any, the range may be in a wrong unit.
        if not cut:
            self.archive._check_unit(np.array([begin, end]))
        return cut

    @property
    def timed(self) -> bool:
        """Whether the track has times."""
        return self._knots[0].times is not None

    @property
    def start(self) -> float | None:
        """Time of the first sample in seconds; None for a track without times."""
        walk = self._knots[0]
        return None if walk.times is None else time_range_of_piece(walk, 0, cut_at_gaps(walk)[0])[0]

    @property
    def end(self) -> float | None:
        """Time of the last sample in seconds; None for a track without times."""
        walk = self._knots[0]
        return (
            None if walk.times is None else time_range_of_piece(walk, -1, cut_at_gaps(walk)[-1])[1]
        )

    @property
    def pieces(self) -> list[Track]:
        """Tracks of the knots between gaps, as :meth:`Archive.decompress` gives them."""
        return self.archive.decompress(self.id)

    @property
    def walk(self) -> Walk:
        """The walk over the nodes of :attr:`Archive.road_map`."""
        return self.archive.walk(self.id)

    @property
    def waypoints(self) -> Waypoints:
        """The fewest nodes that give the walk back, see :meth:`Archive.waypoints`."""
        return self.archive.waypoints(self.id)

    @property
    def sample_times(self) -> NDArray[np.float64]:
        """Times of the samples in seconds, if they were kept: :meth:`Archive.sample_times`."""
        return self.archive.sample_times(self.id)

    @property
    def attributes(self) -> Mapping[str, NDArray[np.generic]]:
        """Further columns of the log, if they were kept: :meth:`Archive.attributes`."""
        return self.archive.attributes(self.id)

    def position(self, when: Times, *, metres: bool = False) -> NDArray[np.float64]:
        """Where the track was at given times, see :meth:`Archive.position`."""
        return self.archive.position(self.id, when, metres=metres)

    def sample(self, every: float | None = None, *, at: Times | None = None) -> list[Track]:
        """Pieces sampled anew, see :meth:`Archive.sample`."""
        return self.archive.sample(every, at=at, track=self.id)

    def samples(self) -> Track:
        """The track at the times of its samples, if they were kept: :meth:`Archive.samples`."""
        return self.archive.samples(self.id)[0]

    @property
    def _knots(self) -> tuple[Walk, NDArray[np.float64]]:
        return self.archive._knots(self.id)


def _clip(
    piece: Track, begin: float, end: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first, last = max(begin, float(piece.times[0])), min(end, float(piece.times[-1]))
    return clip_to_time_range(piece.times, piece.positions, first, last)
