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
from gpszip.geo.planes import choose_plane, plane_index, to_geographic, to_plane
from gpszip.io.networks.graphml import read_graphml_lines
from gpszip.io.networks.joining import JoinedRoads, join_roads
from gpszip.io.networks.lines import RoadLines, TextColumn, Users, line_rows
from gpszip.io.networks.near import NearGround, ground_near
from gpszip.io.networks.osm import read_osm_lines
from gpszip.io.networks.prepared_file import ROADS_MAGIC, read_roads_file
from gpszip.io.networks.vector import read_vector_lines
from gpszip.io.storage.source import Source, expand
from gpszip.model import Network, Plane, Track
from gpszip.model.read_result import Repair

__all__ = ["NETWORK_FORMATS", "NetworkReading", "is_archive", "join_sources", "network_of", "read_network", "read_network_with_account"]

#: Suffixes of what roads are read from; what a file is shows in its content.
NETWORK_FORMATS = (".osm.pbf", ".osm", ".geojson", ".gpkg", ".fgb", ".shp", ".graphml", ".gpsz")

#: Roads longer than this between two vertices, in metres, are looked at in between, too.
_LONG = 1000.0

#: Roads that begin so many degrees from near ground may lead there, and a network so far from a log may be of the same place.
_REACH = 0.2

#: A log of which one point in twenty is faster than this, in m/s, is of motor vehicles.
_MOTORS = 9.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class NetworkReading:
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


def read_network(source: Any, *, plane: Plane | None = None, near: Sequence[Track] | Track | None = None) -> Network:
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
    return read_network_with_account(source, plane=plane, near=near).network


def read_network_with_account(source: Any, *, plane: Plane | None = None, near: Sequence[Track] | Track | None = None) -> NetworkReading:
    """Read a road network as :func:`read_network` does, and tell what was mended."""
    tracks = [near] if isinstance(near, Track) else list(near or ())
    ground = ground_near(tracks) if tracks else None
    plane = plane or (tracks[0].plane if tracks else None)
    metric = None if not tracks and plane is None else plane is None
    prepared = _prepared(source)
    if prepared is not None:
        wanted = None if ground is None else _wanted_near(ground, plane)
        roads = read_roads_file(prepared, str(prepared), wanted)
    else:
        roads = join_sources(source, metric=metric)
    return network_of(roads, plane=plane, near=tracks)


def _wanted_near(ground: NearGround, plane: Plane | None) -> Callable[[Floats, bool], NDArray[np.bool_]]:
    """Which boxes touch near ground."""

    def wanted(boxes: Floats, geographic: bool) -> NDArray[np.bool_]:
        if geographic != (plane is not None):
            return np.ones(len(boxes), np.bool_)  # an error that is told where the log is compared
        low, high = _ground_boxes(ground, plane)
        touched = np.zeros(len(boxes), np.bool_)
        for first in range(0, len(low), 256):
            a, b = low[first : first + 256, None], high[first : first + 256, None]
            touched |= ((a <= boxes[None, :, 2:]) & (b >= boxes[None, :, :2])).all(axis=2).any(axis=0)
        return touched

    return wanted


def _ground_boxes(ground: NearGround, plane: Plane | None) -> tuple[Floats, Floats]:
    """Lower and upper corners of near ground in the coordinates of a network."""
    centres, halves = ground.boxes()
    if plane is None:
        return centres - halves[:, None], centres + halves[:, None]
    lat, lon = to_geographic(centres, plane)
    north = 1.1 * halves / 110_000.0
    east = north / np.maximum(np.cos(np.radians(np.minimum(np.abs(lat) + north, 89.0))), 0.01)
    middle, size = np.stack((lon, lat), axis=1), np.stack((east, north), axis=1)
    return middle - size, middle + size


def network_of(roads: JoinedRoads, *, plane: Plane | None = None, near: Sequence[Track] = ()) -> NetworkReading:
    """Put joined roads on planes, those near a log.

    Raises
    ------
    InputError
        If no road is near the log, or one is in degrees and the other in metres.
    """
    if not near and not len(roads):
        raise InputError(f"{roads.name}: holds no road")
    if near and roads.geographic != (plane is not None):
        own, other = ("degrees", "x and y") if roads.geographic else ("metres of no known place", "degrees")
        raise InputError(f"{roads.name}: is in {own}, but the log in {other}; convert one of them to the coordinates of the other")
    ground = ground_near(near) if near else None
    if not roads.geographic:
        parts, plane = [(np.arange(len(roads)), roads.coordinates)], None
    else:
        plane = plane or _own_plane(roads)
        parts = list(_on_planes(roads, plane, ground))
    repairs = list(roads.repairs)
    if ground is not None:
        parts = [_near(roads, chosen, points, ground) for chosen, points in parts]
        if not any(len(chosen) for chosen, _ in parts):
            raise InputError(_elsewhere(roads, plane, near))
        parts = _for_users(roads, parts, near, repairs)
    network = _assembled(roads, [part for part in parts if len(part[0])], plane)
    return NetworkReading(network, roads.name, len(roads), tuple(repairs))


def _own_plane(roads: JoinedRoads) -> Plane:
    lon, lat = roads.places[:: max(len(roads.places) // 100_000, 1)].T
    return choose_plane(lat, lon)


def _on_planes(roads: JoinedRoads, plane: Plane, ground: NearGround | None) -> Iterator[tuple[NDArray[np.intp], Floats]]:
    """For each plane the roads that may be near tracks on it, and all their vertices in metres."""
    first = roads.coordinates[roads.offsets[:-1]]
    if ground is None:
        own = plane_index(to_plane(first[:, 1], first[:, 0], plane), plane)
    else:
        low, high = _ground_boxes(ground, plane)
        owner = plane_index(ground.boxes()[0], plane)
    for number, centre in enumerate(plane.centers):
        if ground is None:
            chosen = np.flatnonzero(own == number)
        else:
            here = owner == number
            if not here.any():
                continue
            west_south, east_north = low[here].min(axis=0) - _REACH, high[here].max(axis=0) + _REACH
            chosen = np.flatnonzero(((first >= west_south) & (first <= east_north)).all(axis=1))
        lon, lat = roads.coordinates[line_rows(roads.offsets, chosen)].T
        points = to_plane(lat, lon, Plane((centre,)))
        points[:, 0] += number * Plane.SPREAD
        yield chosen, points


def _near(roads: JoinedRoads, chosen: NDArray[np.intp], points: Floats, ground: NearGround) -> tuple[NDArray[np.intp], Floats]:
    """Those of the roads with a point on near ground."""
    counts = np.diff(roads.offsets)[chosen]
    if not len(chosen):
        return chosen, points
    owner = np.repeat(np.arange(len(chosen)), counts)
    hit = ground.holds(points)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    long = np.flatnonzero((steps > _LONG) & (np.diff(owner) == 0))
    pieces = np.ceil(steps[long] / _LONG).astype(np.int64)
    share = (np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / np.repeat(pieces, pieces)
    at = np.repeat(long, pieces)
    between = points[at] + share[:, None] * (points[at + 1] - points[at])
    near = np.bincount(owner[hit], minlength=len(chosen)) > 0
    near[owner[at[ground.holds(between)]]] = True
    return chosen[near], points[near[owner]]


def _for_users(roads: JoinedRoads, parts: list[Any], near: Sequence[Track], repairs: list[Repair]) -> list[Any]:
    """Leave out footways where the log is of cars."""
    if not (roads.users == Users.NO_MOTORS).any() or not _of_motors(near):
        return parts
    left, dropped = [], 0
    for chosen, points in parts:
        kept = roads.users[chosen] != Users.NO_MOTORS
        dropped += int((~kept).sum())
        left.append((chosen[kept], points[np.repeat(kept, np.diff(roads.offsets)[chosen])]))
    if not sum(len(chosen) for chosen, _ in left):
        return parts
    if dropped:
        repairs.append(Repair("ways without motor traffic left out, as the log is of motor vehicles", dropped, roads.name, drops=False))
    return left


def _of_motors(tracks: Sequence[Track]) -> bool:
    fast = [
        np.linalg.norm(np.diff(track.positions, axis=0), axis=1) / np.diff(track.times)
        for track in tracks
        if track.timed and len(track) > 1
    ]
    return bool(fast) and bool(np.quantile(np.concatenate(fast), 0.95) > _MOTORS)


def _assembled(roads: JoinedRoads, parts: list[Any], plane: Plane | None) -> Network:
    chosen = np.concatenate([part[0] for part in parts])
    points = np.concatenate([part[1] for part in parts])
    layer = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    offsets = np.append(0, np.cumsum(np.diff(roads.offsets)[chosen]))
    ends = np.concatenate((roads.starts[chosen], roads.ends[chosen])) + np.tile(layer, 2) * len(roads.places)
    kept, at = np.unique(ends, return_inverse=True)
    nodes = np.empty((len(kept), 2))
    nodes[at[: len(chosen)]], nodes[at[len(chosen) :]] = points[offsets[:-1]], points[offsets[1:] - 1]
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
        names=_names(roads, chosen),
        plane=plane,
    )


def _names(roads: JoinedRoads, chosen: NDArray[np.intp]) -> TextColumn | None:
    """Street names, empty where a road has none; nothing where no road of the source has one."""
    if roads.names.null_count == len(roads.names):
        return None
    return TextColumn(roads.names.take(pa.array(chosen)).fill_null(""))


def _elsewhere(roads: JoinedRoads, plane: Plane | None, near: Sequence[Track]) -> str:
    places = np.concatenate([track.positions[:, :2] for track in near])
    if plane is not None:
        lat, lon = to_geographic(places, plane)
        places = np.stack((lon, lat), axis=1)
    log = f"{_span(places)} of the log"
    if not len(roads):
        return f"{roads.name}: no road of it is near the log, which is at {_span(places)}; give a network of that place"
    own = roads.coordinates
    hint = "give a network of that place"
    low, high = own.min(axis=0) - _REACH, own.max(axis=0) + _REACH
    if plane is not None and ((places[:, ::-1] >= low) & (places[:, ::-1] <= high)).all(axis=1).any():
        hint = "latitude and longitude look swapped in one of them"
    return f"{roads.name}: lies elsewhere than the log: {_span(own)} of the network against {log}; {hint}"


def _span(points: Floats) -> str:
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return f"{x0:.6g}..{x1:.6g}, {y0:.6g}..{y1:.6g}"


def join_sources(source: Any, *, metric: bool | None = None, directed: bool | None = None) -> JoinedRoads:
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
    read = [lines for item in several for lines in ([item] if isinstance(item, RoadLines) else _read(item, metric))]
    if not read:
        raise InputError("no network given; name a file")
    lines = read[0] if len(read) == 1 else _together(read)
    return join_roads(replace(lines, directed=directed) if directed is not None and lines.directed is None else lines)


def _read(source: Any, metric: bool | None) -> list[RoadLines]:
    return [_lines(one, metric) for one in expand(source, unzip=False)]


def _together(read: list[RoadLines]) -> RoadLines:
    if len({lines.geographic for lines in read}) > 1:
        raise InputError(f"{read[0].name} and {read[-1].name}: one is in degrees and the other in metres; convert one of them")
    counts = np.concatenate([np.diff(lines.offsets) for lines in read])
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(lines, name) for lines in read]) for name in ("coordinates", "forward", "backward", "speeds", "users")
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
    return _begins(source, b"\xa7Z")


def _prepared(source: Any) -> Path | None:
    """The path of a prepared network, if it is one."""
    if isinstance(source, (list, tuple)) and len(source) == 1:
        return _prepared(source[0])
    return Path(source) if _begins(source, ROADS_MAGIC) else None


def _begins(source: Any, magic: bytes) -> bool:
    if not isinstance(source, (str, Path)) or not Path(source).is_file():
        return False
    with Path(source).open("rb") as file:
        return file.read(len(magic)) == magic


def _lines(source: Source | InputError, metric: bool | None) -> RoadLines:
    if isinstance(source, InputError):
        raise source
    head = source.head()
    if not head.strip(b" \t\r\n\0"):
        raise InputError(f"{source.name}: empty file; name one that holds a network")
    if head.startswith(ROADS_MAGIC):
        raise InputError(f"{source.name}: prepared networks can't be joined; prepare one of all sources")
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    packed = head.startswith(b"BZh") and source.name.lower().endswith(".osm.bz2")
    if packed or b"OSMHeader" in head[:64] or (text[:1] == b"<" and b"<osm" in text[:4096]):
        return read_osm_lines(_path(source), source.name)
    if text[:1] == b"<" and b"<!ENTITY" in text:
        raise InputError(f"{source.name}: declares XML entities, which are not expanded; write it without them")
    if text[:1] == b"<" and b"<graphml" in text[:4096]:
        with source.open() as stream:
            return read_graphml_lines(stream, source.name, metric=metric)
    if text[:1] == b"<":
        raise UnknownFormatError(f"{source.name}: is XML, but neither OpenStreetMap's nor GraphML")
    if text[:1] == b"{":
        metres = b'"gpszip"' in text[:4096] and b'"metres"' in text[:4096]
        return read_vector_lines(_gdal(source), source.name, metric=metric, metres=metres, loose=True)
    if head.startswith((b"SQLite format 3", b"fgb\x03", b"\x00\x00\x27\x0a", b"PK\x03\x04")):
        return read_vector_lines(_gdal(source), source.name, metric=metric)
    raise UnknownFormatError(
        f"{source.name}: no network; known are OpenStreetMap (.osm.pbf, .osm), GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GraphML, "
        "archives, and what 'gpszip network' prepares"
    )


def _path(source: Source) -> str:
    if source.path is None:
        raise InputError(f"{source.name}: OpenStreetMap data is read only from files whose names are UTF-8; save or rename it first")
    return str(source.path)


def _gdal(source: Source) -> Any:
    if source.path is None or source.packed:
        return source.read()
    zipped = source.path.suffix.lower() == ".zip"
    return f"/vsizip/{source.path}" if zipped else str(source.path)
