"""Frames of other packages, which :mod:`gpszip.io.frames` makes of values."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["FrameMethods", "convert"]


def convert(function: str, *arguments: Any, **selection: Any) -> Any:
    """Convert a value by a function of :mod:`gpszip.io.frames.conversions`.

    Values lie below the package that converts them, so that it is named and not imported: only who
    asks for a frame loads it.
    """
    module = import_module("gpszip.io.frames.conversions")
    return getattr(module, function)(*arguments, **selection)


class FrameMethods:
    """Conversions of tracks as they are, for a track and for a log."""

    def to_arrow(self) -> Any:
        """All samples as a table of pyarrow.

        Returns
        -------
        pyarrow.Table
            ``track_id``; ``t``, timestamps in UTC for times that count from 1970, else seconds, and
            null for tracks without times; ``lat`` and ``lon`` in degrees, or ``x, y[, z]`` in
            metres; then the attributes. Missing values are null.

        Examples
        --------
        >>> from gpszip import Track
        >>> Track("walk", [0, 1], [[0, 0], [3, 4]]).to_arrow().to_pydict()
        {'track_id': ['walk', 'walk'], 't': [0.0, 1.0], 'x': [0.0, 3.0], 'y': [0.0, 4.0]}
        """
        return convert("tracks_to_arrow", self)

    def to_pandas(self) -> Any:
        """All samples as a ``pandas.DataFrame`` with the columns of :meth:`to_arrow`.

        Raises
        ------
        MissingExtraError
            If pandas is not installed: ``pip install 'gpszip[pandas]'``.
        """
        return convert("to_pandas", self.to_arrow())

    def to_polars(self) -> Any:
        """All samples as a ``polars.DataFrame`` with the columns of :meth:`to_arrow`.

        Raises
        ------
        MissingExtraError
            If polars is not installed: ``pip install 'gpszip[polars]'``.
        """
        return convert("to_polars", self.to_arrow())

    def to_geopandas(self) -> Any:
        """All samples as a ``geopandas.GeoDataFrame`` of points.

        Degrees are in EPSG:4326, metres in a local coordinate system. The other columns are those
        of :meth:`to_arrow`.

        Raises
        ------
        MissingExtraError
            If geopandas is not installed: ``pip install 'gpszip[geopandas]'``.
        """
        return convert("to_geopandas", self.to_arrow())

    def to_movingpandas(self) -> Any:
        """All tracks as a ``movingpandas.TrajectoryCollection``.

        Times are in UTC, without a time zone, as movingpandas has them; those that don't count from
        1970 count from there. Tracks without times and tracks of one sample are left out.

        Raises
        ------
        MissingExtraError
            If movingpandas is not installed: ``pip install 'gpszip[movingpandas]'``.
        OptionError
            If no track has times and two samples.
        """
        return convert("to_movingpandas", self.to_arrow())
