"""Reading road networks: any format becomes a graph on the plane of a log, with an account of what was mended."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError, UnknownFormatError
from gpszip.geo.planes import choose_plane, plane_indices, to_geographic, to_plane
from gpszip.io.networks.graphml import read_graphml_lines
from gpszip.io.networks.joining import RoadGraph, build_road_graph
from gpszip.io.networks.lines import RoadLines, RoadUsers, TextColumn, vertex_rows
from gpszip.io.networks.near import NearbyArea, build_nearby_area
from gpszip.io.networks.osm import read_osm_lines
from gpszip.io.networks.prepared_file import PREPARED_MAGIC, read_prepared_file
from gpszip.io.networks.vector import read_vector_lines
from gpszip.io.storage.source import Source, expand
from gpszip.model import Network, Plane, Track
from gpszip.model.read_result import Repair

__all__ = [
    "NETWORK_FORMATS",
    "NetworkReadResult",
    "build_network",
    "is_archive",
    "read_network",
    "read_network_result",
    "read_road_graph",
]

#: Suffixes of what roads are read from; what a file is shows in its content.
NETWORK_FORMATS = (".osm.pbf", ".osm", ".geojson", ".gpkg", ".fgb", ".shp", ".graphml", ".gpsz")

#: Roads longer than this between two vertices, in metres, are looked at in between, too.
_MAX_SPACING = 1000.0

#: Roads that begin so many degrees from near ground may lead there, and a network so far from a log may be of the same place.
_NEARBY_DEGREES = 0.2

#: A log of which one point in twenty is faster than this, in m/s, is of motor vehicles.
_MOTOR_SPEED = 9.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NetworkReadResult:
    """A network with an account of how it came about.

    Parameters
    ----------
    network : Network
        The roads.
    name : str
        Of the source.
    read : int
        Roads of the source after joining; those that are not in the network are too far from the log, or not for its kind.
    repairs : tuple of Repair
        What was mended.
    """

    network: Network
    name: str
    read: int
    repairs: tuple[Repair, ...] = ()


def read_network(
    source: Any, *, plane: Plane | None = None, near: Sequence[Track] | Track | None = None
) -> Network:
    """Read a road network.

    Parameters
    ----------
    source : str, Path, binary stream, or sequence of these
        OpenStreetMap (PBF, XML), GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GraphML, or what ``gpszip network`` prepared.
        Several are joined to one.
    plane : Plane, optional
        The planes to put it on; those of ``near``, or its own, where left out.
    near : sequence of Track, optional
        The log it is for: only roads near it are in the answer, on the planes where tracks are near.

    Returns
    -------
    Network

    Raises
    ------
    InputError
        If it can't be read, holds no road, or lies elsewhere than the log.
    CorruptArchiveError
        If a prepared network is damaged.

    Examples
    --------
    >>> import io
    >>> line = {"type": "LineString", "coordinates": [[0, 0], [30, 0], [30, 40]]}
    >>> file = io.BytesIO(str({"type": "Feature", "properties": {}, "geometry": line}).replace("'", '"').encode())
    >>> read_network(file, near=Track("walk", [0, 60], [[0, 0], [30, 40]])).lengths.tolist()
    [70.0]
    """
    return read_network_result(source, plane=plane, near=near).network


def read_network_result(
    source: Any, *, plane: Plane | None = None, near: Sequence[Track] | Track | None = None
) -> NetworkReadResult:
    """Read a road network as :func:`read_network` does, and tell what was mended."""
    tracks = [near] if isinstance(near, Track) else list(near or ())
    area = build_nearby_area(tracks) if tracks else None
    plane = plane or (tracks[0].plane if tracks else None)
    metric = None if not tracks and plane is None else plane is None
    prepared = _find_prepared(source)
    if prepared is not None:
        wanted = None if area is None else _make_box_filter(area, plane)
        roads = read_prepared_file(prepared, str(prepared), wanted)
    else:
        roads = read_road_graph(source, metric=metric)
    return build_network(roads, plane=plane, near=tracks)


def _make_box_filter(
    area: NearbyArea, plane: Plane | None
) -> Callable[[Floats, bool], NDArray[np.bool_]]:
    """Which boxes touch near ground."""

    def wanted(boxes: Floats, geographic: bool) -> NDArray[np.bool_]:
        if geographic != (plane is not None):
            return np.ones(len(boxes), np.bool_)  # an error that is told where the log is compared
        low, high = _area_boxes(area, plane)
        touched = np.zeros(len(boxes), np.bool_)
        for first in range(0, len(low), 256):
            a, b = low[first : first + 256, None], high[first : first + 256, None]
            touched |= (
                ((a <= boxes[None, :, 2:]) & (b >= boxes[None, :, :2])).all(axis=2).any(axis=0)
            )
        return touched

    return wanted


def _area_boxes(area: NearbyArea, plane: Plane | None) -> tuple[Floats, Floats]:
    """Lower and upper corners of near ground in the coordinates of a network."""
    centres, halves = area.boxes()
    if plane is None:
        return centres - halves[:, None], centres + halves[:, None]
    lat, lon = to_geographic(centres, plane)
    north = 1.1 * halves / 110_000.0
    east = north / np.maximum(np.cos(np.radians(np.minimum(np.abs(lat) + north, 89.0))), 0.01)
    middle, size = np.stack((lon, lat), axis=1), np.stack((east, north), axis=1)
    return middle - size, middle + size


def build_network(
    roads: RoadGraph, *, plane: Plane | None = None, near: Sequence[Track] = ()
) -> NetworkReadResult:
    """Put joined roads on planes, those near a log.

    Raises
    ------
    InputError
        If no road is near the log, or one is in degrees and the other in metres.
    """
    if not near and not len(roads):
        raise InputError(f"{roads.name}: holds no road")
    if near and roads.geographic != (plane is not None):
        own, other = (
            ("degrees", "x and y") if roads.geographic else ("metres of no known place", "degrees")
        )
        raise InputError(
            f"{roads.name}: is in {own}, but the log in {other}; convert one of them to the coordinates of the other"
        )
    area = build_nearby_area(near) if near else None
    if not roads.geographic:
        parts, plane = [(np.arange(len(roads)), roads.coordinates)], None
    else:
        plane = plane or _choose_plane(roads)
        parts = list(_project_to_planes(roads, plane, area))
    repairs = list(roads.repairs)
    if area is not None:
        parts = [_keep_nearby(roads, chosen, points, area) for chosen, points in parts]
        if not any(len(chosen) for chosen, _ in parts):
            raise InputError(_describe_mismatch(roads, plane, near))
        parts = _drop_footways(roads, parts, near, repairs)
    network = _assemble(roads, [part for part in parts if len(part[0])], plane)
    return NetworkReadResult(network, roads.name, len(roads), tuple(repairs))


def _choose_plane(roads: RoadGraph) -> Plane:
    lon, lat = roads.nodes[:: max(len(roads.nodes) // 100_000, 1)].T
    return choose_plane(lat, lon)


def _project_to_planes(
    roads: RoadGraph, plane: Plane, area: NearbyArea | None
) -> Iterator[tuple[NDArray[np.intp], Floats]]:
    """For each plane the roads that may be near tracks on it, and all their vertices in metres."""
    first = roads.coordinates[roads.offsets[:-1]]
    if area is None:
        own = plane_indices(to_plane(first[:, 1], first[:, 0], plane), plane)
    else:
        low, high = _area_boxes(area, plane)
        owner = plane_indices(area.boxes()[0], plane)
    for number, centre in enumerate(plane.centers):
        if area is None:
            chosen = np.flatnonzero(own == number)
        else:
            here = owner == number
            if not here.any():
                continue
            west_south, east_north = (
                low[here].min(axis=0) - _NEARBY_DEGREES,
                high[here].max(axis=0) + _NEARBY_DEGREES,
            )
            chosen = np.flatnonzero(((first >= west_south) & (first <= east_north)).all(axis=1))
        lon, lat = roads.coordinates[vertex_rows(roads.offsets, chosen)].T
        points = to_plane(lat, lon, Plane((centre,)))
        points[:, 0] += number * Plane.SPREAD
        yield chosen, points


def _keep_nearby(
    roads: RoadGraph, chosen: NDArray[np.intp], points: Floats, area: NearbyArea
) -> tuple[NDArray[np.intp], Floats]:
    """Those of the roads with a point on near ground."""
    counts = np.diff(roads.offsets)[chosen]
    if not len(chosen):
        return chosen, points
    owner = np.repeat(np.arange(len(chosen)), counts)
    hit = area.contains(points)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    long = np.flatnonzero((steps > _MAX_SPACING) & (np.diff(owner) == 0))
    pieces = np.ceil(steps[long] / _MAX_SPACING).astype(np.int64)
    share = (np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / np.repeat(
        pieces, pieces
    )
    at = np.repeat(long, pieces)
    between = points[at] + share[:, None] * (points[at + 1] - points[at])
    near = np.bincount(owner[hit], minlength=len(chosen)) > 0
    near[owner[at[area.contains(between)]]] = True
    return chosen[near], points[near[owner]]


def _drop_footways(
    roads: RoadGraph, parts: list[Any], near: Sequence[Track], repairs: list[Repair]
) -> list[Any]:
    """Leave out footways where the log is of cars."""
    if not (roads.users == RoadUsers.NON_MOTOR).any() or not _is_motorised(near):
        return parts
    left, dropped = [], 0
    for chosen, points in parts:
        kept = roads.users[chosen] != RoadUsers.NON_MOTOR
        dropped += int((~kept).sum())
        left.append((chosen[kept], points[np.repeat(kept, np.diff(roads.offsets)[chosen])]))
    if not sum(len(chosen) for chosen, _ in left):
        return parts
    if dropped:
        repairs.append(
            Repair(
                "ways without motor traffic left out, as the log is of motor vehicles",
                dropped,
                roads.name,
                drops=False,
            )
        )
    return left


def _is_motorised(tracks: Sequence[Track]) -> bool:
    fast = [
        np.linalg.norm(np.diff(track.positions, axis=0), axis=1) / np.diff(track.times)
        for track in tracks
        if track.timed and len(track) > 1
    ]
    return bool(fast) and bool(np.quantile(np.concatenate(fast), 0.95) > _MOTOR_SPEED)


def _assemble(roads: RoadGraph, parts: list[Any], plane: Plane | None) -> Network:
    chosen = np.concatenate([part[0] for part in parts])
    points = np.concatenate([part[1] for part in parts])
    layer = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    offsets = np.append(0, np.cumsum(np.diff(roads.offsets)[chosen]))
    ends = np.concatenate((roads.starts[chosen], roads.ends[chosen])) + np.tile(layer, 2) * len(
        roads.nodes
    )
    kept, at = np.unique(ends, return_inverse=True)
    nodes = np.empty((len(kept), 2))
    nodes[at[: len(chosen)]], nodes[at[len(chosen) :]] = (
        points[offsets[:-1]],
        points[offsets[1:] - 1],
    )
    return Network(
        nodes=nodes,
        starts=at[: len(chosen)].astype(np.int32),
        ends=at[len(chosen) :].astype(np.int32),
        offsets=offsets,
        points=points,
        forward=roads.forward[chosen],
        backward=roads.backward[chosen],
        speeds=roads.speeds[chosen],
        ids=TextColumn(roads.ids.take(pa.array(chosen))),
        names=_take_street_names(roads, chosen),
        plane=plane,
    )


def _take_street_names(roads: RoadGraph, chosen: NDArray[np.intp]) -> TextColumn | None:
    """Street names, empty where a road has none; nothing where no road of the source has one."""
    if roads.names.null_count == len(roads.names):
        return None
    return TextColumn(roads.names.take(pa.array(chosen)).fill_null(""))


def _describe_mismatch(roads: RoadGraph, plane: Plane | None, near: Sequence[Track]) -> str:
    places = np.concatenate([track.positions[:, :2] for track in near])
    if plane is not None:
        lat, lon = to_geographic(places, plane)
        places = np.stack((lon, lat), axis=1)
    log = f"{_format_extent(places)} of the log"
    if not len(roads):
        return f"{roads.name}: no road of it is near the log, which is at {_format_extent(places)}; give a network of that place"
    own = roads.coordinates
    hint = "give a network of that place"
    low, high = own.min(axis=0) - _NEARBY_DEGREES, own.max(axis=0) + _NEARBY_DEGREES
    if (
        plane is not None
        and ((places[:, ::-1] >= low) & (places[:, ::-1] <= high)).all(axis=1).any()
    ):
        hint = "latitude and longitude look swapped in one of them"
    return f"{roads.name}: lies elsewhere than the log: {_format_extent(own)} of the network against {log}; {hint}"


def _format_extent(points: Floats) -> str:
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return f"{x0:.6g}..{x1:.6g}, {y0:.6g}..{y1:.6g}"


def read_road_graph(
    source: Any, *, metric: bool | None = None, directed: bool | None = None
) -> RoadGraph:
    """Read sources that are not prepared, and join their lines.

    Parameters
    ----------
    source : str, Path, binary stream, or sequence of these
        As for :func:`read_network`.
    metric : bool, optional
        Whether the log it is for is in x and y; told from the source where left out.
    directed : bool, optional
        Whether a line without a property that tells its direction may be travelled along it only, as where a source holds one
        for each direction; told from the lines where left out.
    """
    several = list(source) if isinstance(source, (list, tuple)) else [source]
    read = [
        lines
        for item in several
        for lines in ([item] if isinstance(item, RoadLines) else _read_sources(item, metric))
    ]
    if not read:
        raise InputError("no network given; name a file")
    lines = read[0] if len(read) == 1 else _concatenate(read)
    return build_road_graph(
        replace(lines, directed=directed)
        if directed is not None and lines.directed is None
        else lines
    )


def _read_sources(source: Any, metric: bool | None) -> list[RoadLines]:
    return [_read_lines(one, metric) for one in expand(source, unzip=False)]


def _concatenate(read: list[RoadLines]) -> RoadLines:
    if len({lines.geographic for lines in read}) > 1:
        raise InputError(
            f"{read[0].name} and {read[-1].name}: one is in degrees and the other in metres; convert one of them"
        )
    counts = np.concatenate([np.diff(lines.offsets) for lines in read])
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(lines, name) for lines in read])
        for name in ("coordinates", "forward", "backward", "speeds", "users")
    }
    return replace(
        read[0],
        name=f"{read[0].name} and {len(read) - 1} more",
        offsets=np.append(0, np.cumsum(counts)),
        ids=pa.concat_arrays([lines.ids for lines in read]),
        names=pa.concat_arrays([lines.names for lines in read]),
        directed=False if any(lines.directed is False for lines in read) else None,
        repairs=tuple(repair for lines in read for repair in lines.repairs),
        **joined,
    )


def is_archive(source: Any) -> bool:
    """Whether a source of roads is the file of an archive, whose map this room can't read."""
    return _starts_with(source, b"\xa7Z")


def _find_prepared(source: Any) -> Path | None:
    """The path of a prepared network, if it is one."""
    if isinstance(source, (list, tuple)) and len(source) == 1:
        return _find_prepared(source[0])
    return Path(source) if _starts_with(source, PREPARED_MAGIC) else None


def _starts_with(source: Any, magic: bytes) -> bool:
    if not isinstance(source, (str, Path)) or not Path(source).is_file():
        return False
    with Path(source).open("rb") as file:
        return file.read(len(magic)) == magic


def _read_lines(source: Source | InputError, metric: bool | None) -> RoadLines:
    if isinstance(source, InputError):
        raise source
    head = source.head()
    if not head.strip(b" \t\r\n\0"):
        raise InputError(f"{source.name}: empty file; name one that holds a network")
    if head.startswith(PREPARED_MAGIC):
        raise InputError(
            f"{source.name}: prepared networks can't be joined; prepare one of all sources"
        )
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    packed = head.startswith(b"BZh") and source.name.lower().endswith(".osm.bz2")
    if packed or b"OSMHeader" in head[:64] or (text[:1] == b"<" and b"<osm" in text[:4096]):
        return read_osm_lines(_require_path(source), source.name)
    if text[:1] == b"<" and b"<!ENTITY" in text:
        raise InputError(
            f"{source.name}: declares XML entities, which are not expanded; write it without them"
        )
    if text[:1] == b"<" and b"<graphml" in text[:4096]:
        with source.open() as stream:
            return read_graphml_lines(stream, source.name, metric=metric)
    if text[:1] == b"<":
        raise UnknownFormatError(f"{source.name}: is XML, but neither OpenStreetMap's nor GraphML")
    if text[:1] == b"{":
        metres = b'"gpszip"' in text[:4096] and b'"metres"' in text[:4096]
        return read_vector_lines(
            _gdal_source(source), source.name, metric=metric, metres=metres, is_geojson=True
        )
    if head.startswith((b"SQLite format 3", b"fgb\x03", b"\x00\x00\x27\x0a", b"PK\x03\x04")):
        return read_vector_lines(_gdal_source(source), source.name, metric=metric)
    raise UnknownFormatError(
        f"{source.name}: no network; known are OpenStreetMap (.osm.pbf, .osm), GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GraphML, "
        "archives, and what 'gpszip network' prepares"
    )


def _require_path(source: Source) -> str:
    if source.path is None:
        raise InputError(
            f"{source.name}: OpenStreetMap data is read only from files whose names are UTF-8; save or rename it first"
        )
    return str(source.path)


def _gdal_source(source: Source) -> Any:
    if source.path is None or source.is_gzip:
        return source.read()
    zipped = source.path.suffix.lower() == ".zip"
    return f"/vsizip/{source.path}" if zipped else str(source.path)
