"""Writing road maps in any format that can hold them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from gpszip.errors import OutputError
from gpszip.io.maps.csv import write_map_csv
from gpszip.io.maps.geojson import write_map_geojson
from gpszip.io.maps.gpkg import write_map_gpkg
from gpszip.io.maps.graphml import write_map_graphml
from gpszip.io.maps.table import MapTable, clean_map_table, map_table
from gpszip.io.storage.sink import atomic_write, to_stdout
from gpszip.model import CleanMap, RoadMap

__all__ = ["MAP_FORMATS", "write_map"]

#: Writers by suffix.
MAP_FORMATS: dict[str, Callable[[MapTable, Path], None]] = {
    ".geojson": write_map_geojson,
    ".json": write_map_geojson,
    ".graphml": write_map_graphml,
    ".gpkg": write_map_gpkg,
    ".csv": write_map_csv,
}


def write_map(
    road_map: RoadMap | CleanMap,
    path: str | Path,
    min_traversals: int = 0,
    *,
    format: str | None = None,
    nodes: bool = False,
) -> None:
    """Write a map; places on the earth as longitude and latitude.

    Parameters
    ----------
    road_map : RoadMap or WayMap
        Nodes and edges as they were learned, or junctions and ways.
    path : str or Path
        The file, which appears whole or not at all and replaces another of its name; ``-`` for standard output.
    min_traversals : int
        Leave out edges that were travelled less often, both directions together; a clean map was made with its own minimum.
    format : str, optional
        ``geojson``, ``graphml``, ``gpkg`` or ``csv``; told from the name where left out, GeoJSON for ``-``.
    nodes : bool
        Write the nodes to GeoJSON, too.

    Raises
    ------
    OutputError
        If the format is not known or the file can't be written.
    """
    suffix = f".{format}" if format else ".geojson" if str(path) == "-" else Path(path).suffix
    write = MAP_FORMATS.get(suffix.lower())
    if write is None:
        raise OutputError(
            f"{path}: can't tell the format from this name; end it with one of {', '.join(MAP_FORMATS)}"
        )
    if nodes and write is write_map_geojson:
        write = partial(write_map_geojson, points=True)
    table = (
        clean_map_table(road_map)
        if isinstance(road_map, CleanMap)
        else map_table(road_map, min_traversals)
    )
    with to_stdout(suffix) if str(path) == "-" else atomic_write(path) as file:
        write(table, file)
