"""What learned maps have in common: files and graphs of other packages."""

from __future__ import annotations

import os
from typing import Any

from gpszip.model.frames import convert

__all__ = ["MapMethods"]


class MapMethods:
    """Conversions of a road map and of a clean map."""

    def to_networkx(self) -> Any:
        """Return the directed map as a ``networkx.MultiDiGraph``, which osmnx's functions take.

        Returns
        -------
        networkx.MultiDiGraph
            With ``crs``: EPSG:4326, or a local system for metres. Nodes have ``x`` and ``y`` (and
            ``z``): longitude and latitude, or metres. There is an edge for each direction that was
            travelled, with ``length`` in metres, ``traversals``, ``edge`` (the row of the map),
            ``oneway``, ``reversed``, and the columns of a clean map; with speeds also ``speed_kph``
            and ``travel_time`` in seconds. A line with a shape is ``geometry``. What is unknown is
            left out.

        Raises
        ------
        MissingExtraError
            If networkx or shapely is not installed: ``pip install 'gpszip[networkx]'``.
        """
        return convert("map_to_networkx", self)

    def to_geopandas(self) -> Any:
        """Return nodes and directed edges as GeoDataFrames, which ``osmnx.graph_from_gdfs`` takes.

        Returns
        -------
        nodes, edges : geopandas.GeoDataFrame
            Nodes by ``osmid``, their number, with ``x`` and ``y``; edges by ``u``, ``v`` and
            ``key``, with the columns of :meth:`to_networkx`.

        Raises
        ------
        MissingExtraError
            If geopandas is not installed: ``pip install 'gpszip[geopandas]'``.
        """
        return convert("map_to_geopandas", self)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the map in the format of the file's suffix, as ``gpszip map`` does.

        Parameters
        ----------
        path : path
            The file: ``.geojson``, ``.graphml``, ``.osm``, ``.gpkg``, ``.fgb``, ``.shp.zip``,
            ``.parquet``, ``.csv`` or another suffix that ``gpszip formats`` lists.
        force : bool, default False
            Replace an existing file.

        Raises
        ------
        OutputError
            If the file exists, or can't be written or hold the map.
        MissingExtraError
            If the format needs a package that is not installed.
        """
        convert("save_map", self, os.fspath(path), force=force)
