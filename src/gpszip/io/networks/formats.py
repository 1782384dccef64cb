"""The formats that road networks come in.

To add a format here, write its reader in one module and add it to :data:`NETWORK_FORMATS`. Another
package adds a :class:`NetworkFormat` as an entry point of the group ``gpszip.network_formats``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.plugins import Guard, load_plugins

if TYPE_CHECKING:
    from gpszip.io.networks.lines import RoadLines
    from gpszip.io.storage.source import Source

__all__ = [
    "NETWORK_FORMATS",
    "NetworkFormat",
    "describe_network_formats",
    "find_network_format",
    "network_formats",
]

#: Group of entry points by which other packages add formats.
_PLUGIN_GROUP = "gpszip.network_formats"

#: Bytes of a file within which its root element or its members name its format.
_HEADER_BYTES = 4096

#: Blanks and the byte order mark, which may come before text.
_BLANKS = b"\xef\xbb\xbf \t\r\n"


@dataclass(frozen=True)
class NetworkFormat:
    """One format of road networks.

    Parameters
    ----------
    name : str
        Name in messages and help texts.
    suffixes : tuple of str
        Suffixes of its files, in lower case, for help texts; the content decides.
    sniff : callable
        Gets the first bytes of a file and its name. It returns whether the file is of this format.
    read : callable
        Gets the file, and whether the log is in x and y (None if no log is given). It returns the
        roads as lines.
    """

    name: str
    suffixes: tuple[str, ...]
    sniff: Callable[[bytes, str], bool]
    read: Callable[[Source, bool | None], RoadLines]


def network_formats() -> tuple[NetworkFormat, ...]:
    """Return all formats in the order in which they are asked.

    Formats of other packages come first, so that they can claim a kind of JSON or zip file that
    would be read as another format.

    Raises
    ------
    InputError
        If a format of another package can't be loaded.
    """
    return (*load_plugins(_PLUGIN_GROUP, NetworkFormat, _guarded), *NETWORK_FORMATS)


def _guarded(plugin: NetworkFormat, guard: Guard) -> NetworkFormat:
    """Return a format of another package with guarded functions."""
    from gpszip.io.networks.lines import RoadLines

    return replace(
        plugin,
        sniff=guard.wrap(plugin.sniff, InputError),
        read=guard.wrap(plugin.read, InputError, RoadLines),
    )


def find_network_format(source: Source) -> NetworkFormat:
    """Find the format of a file from its content.

    Raises
    ------
    InputError
        If it is empty, or a format of another package can't be loaded or fails.
    UnknownFormatError
        If no format knows it.
    """
    head = source.head()
    if not head.strip(b" \t\r\n\0"):
        raise InputError("empty file", path=source.name, remedy="name one that holds a network")
    for network_format in network_formats():
        if network_format.sniff(head, source.name):
            return network_format

    # No format knows it: say what it is.
    if _is_xml(head) and b"<!ENTITY" in head:
        raise _entity_error(source)
    if _is_xml(head):
        raise UnknownFormatError(
            "is XML, but neither OpenStreetMap's nor GraphML", path=source.name
        )
    raise UnknownFormatError(
        "no network", path=source.name, remedy=f"known are {describe_network_formats()}"
    )


def describe_network_formats() -> str:
    """Return the names of all formats, for messages and help texts.

    Examples
    --------
    >>> "GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GraphML" in describe_network_formats()
    True
    """
    return ", ".join(network_format.name for network_format in network_formats())


def _is_xml(head: bytes) -> bool:
    return head.lstrip(_BLANKS).startswith(b"<")


def _entity_error(source: Source) -> InputError:
    return InputError(
        "declares XML entities, which are not expanded",
        path=source.name,
        remedy="write it without them",
    )


# OpenStreetMap.


def _is_osm(head: bytes, name: str) -> bool:
    # A bzip2 file does not show its content, so that its name decides.
    is_bzip2 = head.startswith(b"BZh") and name.lower().endswith(".osm.bz2")
    is_pbf = b"OSMHeader" in head[:64]
    return is_bzip2 or is_pbf or (_is_xml(head) and b"<osm" in head.lstrip(_BLANKS)[:_HEADER_BYTES])


def _read_osm(source: Source, _metric: bool | None) -> RoadLines:
    from gpszip.io.networks.osm import read_osm_lines

    if source.path is None:
        raise InputError(
            "OpenStreetMap data is read only from files whose names are UTF-8",
            path=source.name,
            remedy="save or rename it first",
        )
    return read_osm_lines(str(source.path), source.name)


# GraphML.


def _is_graphml(head: bytes, _name: str) -> bool:
    return _is_xml(head) and b"<graphml" in head.lstrip(_BLANKS)[:_HEADER_BYTES]


def _read_graphml(source: Source, metric: bool | None) -> RoadLines:
    from gpszip.io.networks.graphml import read_graphml_lines

    if b"<!ENTITY" in source.head():
        raise _entity_error(source)
    with source.open() as stream:
        return read_graphml_lines(stream, source.name, metric=metric)


# Vector formats.


def _is_geojson(head: bytes, _name: str) -> bool:
    return head.lstrip(_BLANKS).startswith(b"{")


def _read_geojson(source: Source, metric: bool | None) -> RoadLines:
    from gpszip.io.networks.geojson import read_geojson_lines

    return read_geojson_lines(source, metric=metric)


def _starts_with(*magic: bytes) -> Callable[[bytes, str], bool]:
    """Return a sniffer of files that start with one of these bytes."""
    return lambda head, _name: head.startswith(magic)


def _read_vector(source: Source, metric: bool | None) -> RoadLines:
    from gpszip.io.networks.vector import read_vector_lines

    return read_vector_lines(_gdal_source(source), source.name, metric=metric)


def _gdal_source(source: Source) -> str | bytes:
    """Return what GDAL reads: a path, a path into a zip file, or the unpacked bytes."""
    if source.path is None or source.is_gzip:
        return source.read()
    is_zip = source.path.suffix.lower() == ".zip"
    return f"/vsizip/{source.path}" if is_zip else str(source.path)


# Tables.


def _read_parquet(source: Source, metric: bool | None) -> RoadLines:
    from gpszip.io.networks.tables import read_parquet_lines

    return read_parquet_lines(source, metric=metric)


def _is_csv(head: bytes, _name: str) -> bool:
    from gpszip.io.networks.tables import is_road_table

    return is_road_table(head)


def _read_csv(source: Source, metric: bool | None) -> RoadLines:
    from gpszip.io.networks.tables import read_csv_lines

    return read_csv_lines(source, metric=metric)


# Prepared networks.


def _is_prepared(head: bytes, _name: str) -> bool:
    from gpszip.io.networks.prepared_file import PREPARED_MAGIC

    return head.startswith(PREPARED_MAGIC)


def _refuse_prepared(source: Source, _metric: bool | None) -> RoadLines:
    """Refuse a prepared network among several sources; a single one is not read as lines."""
    raise InputError(
        "prepared networks can't be joined", path=source.name, remedy="prepare one of all sources"
    )


#: Formats in the order in which they are asked.
NETWORK_FORMATS: tuple[NetworkFormat, ...] = (
    NetworkFormat("OpenStreetMap (PBF, XML)", (".osm.pbf", ".osm"), _is_osm, _read_osm),
    NetworkFormat("GeoJSON", (".geojson",), _is_geojson, _read_geojson),
    NetworkFormat("GeoPackage", (".gpkg",), _starts_with(b"SQLite format 3"), _read_vector),
    NetworkFormat("FlatGeobuf", (".fgb",), _starts_with(b"fgb\x03"), _read_vector),
    NetworkFormat(
        "Shapefile", (".shp",), _starts_with(b"\x00\x00\x27\x0a", b"PK\x03\x04"), _read_vector
    ),
    NetworkFormat("GraphML", (".graphml",), _is_graphml, _read_graphml),
    NetworkFormat("GeoParquet", (".parquet",), _starts_with(b"PAR1"), _read_parquet),
    NetworkFormat(
        "archives and networks that 'gpszip network' prepared",
        (".gpsz",),
        _is_prepared,
        _refuse_prepared,
    ),
    # Last, as text of any kind is looked at.
    NetworkFormat("CSV with lines", (".csv",), _is_csv, _read_csv),
)
