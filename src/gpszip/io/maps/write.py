"""Write road maps in any format that can hold them.

To add a format here, write its writer in one module and add it to :data:`MAP_FORMATS`. Another
package adds a :class:`MapFormat` as an entry point of the group ``gpszip.map_formats``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gpszip.errors import OutputError
from gpszip.io.deferred import deferred
from gpszip.io.plugins import Guard, load_plugins
from gpszip.io.storage.sink import atomic_write, to_stdout
from gpszip.model import CleanMap, RoadMap

if TYPE_CHECKING:
    from gpszip.io.maps.table import MapTable

__all__ = [
    "MAP_FORMATS",
    "MapFormat",
    "find_map_format",
    "map_formats",
    "map_suffixes",
    "write_map",
]

#: Group of entry points by which other packages add formats.
_PLUGIN_GROUP = "gpszip.map_formats"


@dataclass(frozen=True)
class MapFormat:
    """One format of maps.

    Parameters
    ----------
    name : str
        Name by which users choose it.
    suffixes : tuple of str
        Suffixes of its files, in lower case.
    write : callable
        Writes a table to a path, which doesn't exist yet.
    write_with_nodes : callable, optional
        Writes the nodes, too. Leave it out for a format that always or never holds nodes.
    is_binary : bool
        Whether its files are not for a terminal.
    degrees_only : bool
        Whether its files can't hold maps in x and y.
    """

    name: str
    suffixes: tuple[str, ...]
    write: Callable[[MapTable, Path], None]
    write_with_nodes: Callable[[MapTable, Path], None] | None = None
    is_binary: bool = False
    degrees_only: bool = False


_write_geojson = deferred("gpszip.io.maps.geojson", "write_map_geojson")
_write_vector = deferred("gpszip.io.maps.vector", "write_map_vector")
_write_picture = deferred("gpszip.io.maps.picture", "write_map_picture")

#: Formats in the order in which help texts name them; the first is that of standard output.
MAP_FORMATS: tuple[MapFormat, ...] = (
    MapFormat(
        "geojson",
        (".geojson", ".json"),
        _write_geojson,
        write_with_nodes=partial(_write_geojson, points=True),
    ),
    MapFormat("graphml", (".graphml",), deferred("gpszip.io.maps.graphml", "write_map_graphml")),
    MapFormat("osm", (".osm",), deferred("gpszip.io.maps.osm", "write_map_osm"), degrees_only=True),
    MapFormat("gpkg", (".gpkg",), partial(_write_vector, driver="GPKG"), is_binary=True),
    MapFormat("flatgeobuf", (".fgb",), partial(_write_vector, driver="FlatGeobuf"), is_binary=True),
    MapFormat(
        "shapefile",
        (".shp.zip", ".shz"),
        deferred("gpszip.io.maps.vector", "write_map_shapefile"),
        is_binary=True,
    ),
    MapFormat(
        "parquet",
        (".parquet", ".geoparquet"),
        deferred("gpszip.io.maps.geoparquet", "write_map_geoparquet"),
        is_binary=True,
    ),
    MapFormat("csv", (".csv",), deferred("gpszip.io.maps.csv", "write_map_csv")),
    MapFormat("kml", (".kml",), deferred("gpszip.io.maps.kml", "write_map_kml"), degrees_only=True),
    MapFormat("png", (".png",), partial(_write_picture, kind="png"), is_binary=True),
    MapFormat("svg", (".svg",), partial(_write_picture, kind="svg")),
    MapFormat("pdf", (".pdf",), partial(_write_picture, kind="pdf"), is_binary=True),
)


def map_formats() -> tuple[MapFormat, ...]:
    """Return all formats: those of this package, then those of other packages.

    Raises
    ------
    InputError
        If a format of another package can't be loaded.
    """
    return tuple(_built_in_first())


def _built_in_first() -> Iterator[MapFormat]:
    """Yield the formats of this package, then those of others, which are loaded only then."""
    yield from MAP_FORMATS
    yield from load_plugins(_PLUGIN_GROUP, MapFormat, _guarded)


def _guarded(plugin: MapFormat, guard: Guard) -> MapFormat:
    """Return a format of another package with guarded functions."""
    guarded = replace(plugin, write=guard.wrap(plugin.write, OutputError))
    if plugin.write_with_nodes is None:
        return guarded
    return replace(guarded, write_with_nodes=guard.wrap(plugin.write_with_nodes, OutputError))


def map_suffixes() -> tuple[str, ...]:
    """Return the suffixes of all formats.

    Examples
    --------
    >>> map_suffixes()[:3]
    ('.geojson', '.json', '.graphml')
    """
    return tuple(suffix for map_format in map_formats() for suffix in map_format.suffixes)


def find_map_format(path: str | Path, name: str | None = None) -> MapFormat:
    """Find the format in which a map is written.

    Built-in formats are found even if a format of another package can't be loaded.

    Parameters
    ----------
    path : str or Path
        The file; ``-`` for standard output.
    name : str, optional
        Name of the format; found from the suffix of the file if left out.

    Raises
    ------
    OutputError
        If there is no such format.
    InputError
        If it is none of this package, and a format of another one can't be loaded.

    Examples
    --------
    >>> find_map_format("city.GPKG").name, find_map_format("-").name
    ('gpkg', 'geojson')
    """
    # Standard output has no suffix to tell the format: it is the first format.
    if name is None and str(path) == "-":
        return MAP_FORMATS[0]

    # Find it by its name or by a suffix.
    end = Path(path).name.lower() if name is None else f".{name.lower()}"
    for map_format in _built_in_first():
        is_named = name is not None and name.lower() == map_format.name
        if is_named or end.endswith(map_format.suffixes):
            return map_format

    # There is none: say which there are.
    if end.endswith(".shp"):
        raise OutputError(
            "a Shapefile is several files, which are written as one zip archive",
            path=path,
            remedy="end the name with .shp.zip",
        )
    if name is not None:
        names = ", ".join(map_format.name for map_format in map_formats())
        raise OutputError(f"no format {name!r} for maps", path=path, remedy=f"there are {names}")
    raise OutputError(
        "can't tell the format from this name",
        path=path,
        remedy=f"end it with one of {', '.join(map_suffixes())}",
    )


def write_map(
    road_map: RoadMap | CleanMap,
    path: str | Path,
    min_traversals: int = 0,
    *,
    format: str | None = None,
    nodes: bool = False,
    force: bool = True,
) -> None:
    """Write a map; positions on the earth as longitude and latitude.

    Parameters
    ----------
    road_map : RoadMap or CleanMap
        Nodes and edges as they were learned, or junctions and the streets between them.
    path : str or Path
        The file, which appears once it is complete; ``-`` for standard output.
    min_traversals : int
        Leave out edges with fewer traversals in both directions together. A clean map has its own
        minimum.
    format : str, optional
        Name of a format, one of :func:`map_formats`. Found from the file's suffix if left out;
        GeoJSON for ``-``.
    nodes : bool
        Write the nodes to GeoJSON, too.
    force : bool, default True
        Replace another file of this name.

    Raises
    ------
    OutputError
        If the format is unknown, it can't hold x and y, or the file can't be written.
    """
    from gpszip.io.maps.table import learned_table

    # Find the writer.
    map_format = find_map_format(path, format)
    _check_coordinates(map_format, road_map, path)
    write = map_format.write
    if nodes and map_format.write_with_nodes is not None:
        write = map_format.write_with_nodes

    # Write the columns of the map.
    table = learned_table(road_map, min_traversals)
    # Writers take a path, so that standard output gets a copy of a temporary file.
    is_stdout, suffix = str(path) == "-", map_format.suffixes[0]
    with to_stdout(suffix) if is_stdout else atomic_write(path, force=force) as file:
        write(table, file)


def _check_coordinates(
    map_format: MapFormat, road_map: RoadMap | CleanMap, path: str | Path
) -> None:
    """Refuse a map in x and y for a format that holds degrees only."""
    if road_map.plane is None and map_format.degrees_only:
        others = [other.name for other in map_formats() if not other.degrees_only]
        raise OutputError(
            f"this map is in x and y, but the format {map_format.name} holds latitudes and "
            "longitudes",
            path=path,
            remedy=f"write another format: {', '.join(others)}",
        )
