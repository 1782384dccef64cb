"""Tracks of an archive as frames of other packages."""

from __future__ import annotations

from typing import Any

from gpszip.model.frames import convert
from gpszip.model.timestamps import Times

__all__ = ["ArchiveFrames", "TrackFrames"]


class ArchiveFrames:
    """Conversions of the tracks of an archive."""

    def to_arrow(
        self,
        every: float | None = None,
        *,
        at: Times | None = None,
        samples: bool = False,
        track: str | None = None,
    ) -> Any:
        """Tracks as a table of pyarrow, with the rows that ``gpszip decompress`` writes.

        Parameters
        ----------
        every : float, optional
            Positions at the multiples of this many seconds.
        at : array_like, optional
            Positions at these times, given as for :meth:`Archive.position`.
        samples : bool, default False
            Positions at the times of the samples, with the columns that were kept. Without
            ``every``, ``at`` and ``samples``, rows are knots: between them a piece is linear in
            time. In degrees, rows are added where a straight line would leave the error bound.
        track : str, optional
            Only this track.

        Returns
        -------
        pyarrow.Table
            ``track_id``; ``piece``, the number of the piece between two gaps, from 0, unless
            ``samples``; ``t``, timestamps in UTC for times that count from 1970, else seconds, and
            null for tracks without times; ``lat`` and ``lon`` in degrees, or ``x, y[, z]`` in
            metres; then the columns that were kept. Missing values are null.

        Raises
        ------
        UnknownTrackError
            If there is no such track.
        OptionError
            If several of ``every``, ``at`` and ``samples`` are given, or as :meth:`Archive.sample`
            and :meth:`Archive.samples` raise it.

        Examples
        --------
        >>> from gpszip import Track, compress
        >>> lane = Track("lane", [0, 4, 8], [[0.0], [4.0], [8.0]])
        >>> compress(lane, max_error=0.1).to_arrow(every=4.0).to_pydict()["t"]
        [0.0, 4.0, 8.0]
        """
        return convert("archive_to_arrow", self, every=every, at=at, samples=samples, track=track)

    def to_pandas(
        self,
        every: float | None = None,
        *,
        at: Times | None = None,
        samples: bool = False,
        track: str | None = None,
    ) -> Any:
        """Tracks as a ``pandas.DataFrame``; columns and parameters are those of :meth:`to_arrow`.

        Raises
        ------
        MissingExtraError
            If pandas is not installed: ``pip install 'gpszip[pandas]'``.
        """
        return convert("to_pandas", self.to_arrow(every, at=at, samples=samples, track=track))

    def to_polars(
        self,
        every: float | None = None,
        *,
        at: Times | None = None,
        samples: bool = False,
        track: str | None = None,
    ) -> Any:
        """Tracks as a ``polars.DataFrame``; columns and parameters are those of :meth:`to_arrow`.

        Raises
        ------
        MissingExtraError
            If polars is not installed: ``pip install 'gpszip[polars]'``.
        """
        return convert("to_polars", self.to_arrow(every, at=at, samples=samples, track=track))

    def to_geopandas(
        self,
        every: float | None = None,
        *,
        at: Times | None = None,
        samples: bool = False,
        track: str | None = None,
    ) -> Any:
        """Tracks as a ``geopandas.GeoDataFrame`` of points; parameters as for :meth:`to_arrow`.

        Degrees are in EPSG:4326, metres in a local coordinate system.

        Raises
        ------
        MissingExtraError
            If geopandas is not installed: ``pip install 'gpszip[geopandas]'``.
        """
        return convert("to_geopandas", self.to_arrow(every, at=at, samples=samples, track=track))

    def to_movingpandas(
        self,
        every: float | None = None,
        *,
        at: Times | None = None,
        samples: bool = False,
        track: str | None = None,
    ) -> Any:
        """Pieces of tracks as a ``movingpandas.TrajectoryCollection``.

        Parameters are those of :meth:`to_arrow`. Each piece between gaps is a trajectory, named
        ``id/0``, ``id/1`` and so on; a track without gaps keeps its id. Times are in UTC, without a
        time zone, as movingpandas has them; those that don't count from 1970 count from there.
        Tracks without times and pieces of one row are left out.

        Raises
        ------
        MissingExtraError
            If movingpandas is not installed: ``pip install 'gpszip[movingpandas]'``.
        OptionError
            If no piece has times and two rows.
        """
        return convert("to_movingpandas", self.to_arrow(every, at=at, samples=samples, track=track))


class TrackFrames:
    """Conversions of one track of an archive, see :class:`ArchiveFrames`."""

    archive: Any
    id: str

    def to_arrow(
        self, every: float | None = None, *, at: Times | None = None, samples: bool = False
    ) -> Any:
        """The track as a table of pyarrow, see :meth:`Archive.to_arrow`."""
        return self.archive.to_arrow(every, at=at, samples=samples, track=self.id)

    def to_pandas(
        self, every: float | None = None, *, at: Times | None = None, samples: bool = False
    ) -> Any:
        """The track as a ``pandas.DataFrame``, see :meth:`Archive.to_pandas`."""
        return self.archive.to_pandas(every, at=at, samples=samples, track=self.id)

    def to_polars(
        self, every: float | None = None, *, at: Times | None = None, samples: bool = False
    ) -> Any:
        """The track as a ``polars.DataFrame``, see :meth:`Archive.to_polars`."""
        return self.archive.to_polars(every, at=at, samples=samples, track=self.id)

    def to_geopandas(
        self, every: float | None = None, *, at: Times | None = None, samples: bool = False
    ) -> Any:
        """The track as a ``geopandas.GeoDataFrame``, see :meth:`Archive.to_geopandas`."""
        return self.archive.to_geopandas(every, at=at, samples=samples, track=self.id)

    def to_movingpandas(
        self, every: float | None = None, *, at: Times | None = None, samples: bool = False
    ) -> Any:
        """The track as trajectories of movingpandas, see :meth:`Archive.to_movingpandas`."""
        return self.archive.to_movingpandas(every, at=at, samples=samples, track=self.id)
