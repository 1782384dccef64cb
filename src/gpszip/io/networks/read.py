"""Read road networks: lines of any format become a graph on the plane of a log."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.geo.planes import choose_plane, plane_indices, to_geographic, to_plane
from gpszip.io.networks.formats import find_network_format
from gpszip.io.networks.joining import RoadGraph, build_road_graph
from gpszip.io.networks.lines import RoadLines, RoadUsers, TextColumn, vertex_rows
from gpszip.io.networks.near import NearbyArea, build_nearby_area
from gpszip.io.networks.prepared_file import PREPARED_MAGIC, BoxFilter, read_prepared_file
from gpszip.io.storage.source import Source, expand
from gpszip.model import Network, Plane, Track
from gpszip.model.read_result import Repair

__all__ = [
    "NetworkReadResult",
    "build_network",
    "is_archive",
    "read_network",
    "read_network_result",
    "read_road_graph",
]

#: Steps of a road longer than this in metres are tested between their vertices, too, for whether
#: they cross the area near a log.
_MAX_SPACING = 1000.0

#: Roads that start this many degrees outside the nearby area may lead into it. A log this far from
#: a network may still be of the same region.
_NEARBY_DEGREES = 0.2

#: If one step in twenty of a log is faster than this in m/s, it is of motor vehicles.
_MOTOR_SPEED = 9.0

#: The quantile of speeds that is compared with it.
_MOTOR_QUANTILE = 0.95

#: Metres of a degree of latitude at least: a box in degrees is not too small.
_MIN_DEGREE_METRES = 110_000.0

#: Boxes in degrees are this much wider than those on the plane, since planes distort.
_BOX_MARGIN = 1.1

#: Latitude up to which a box is widened by the cosine; beyond, by its minimum.
_MAX_BOX_LATITUDE = 89.0

#: The minimum of that cosine.
_MIN_COSINE = 0.01

#: Cells that are compared with all blocks at a time.
_CELLS_AT_A_TIME = 256

#: Nodes from which the plane of a network is chosen.
_PLANE_SAMPLE = 100_000

#: First bytes of an archive.
_ARCHIVE_MAGIC = b"\xa7Z"

Floats = NDArray[np.float64]
RoadSource: TypeAlias = "str | Path | BinaryIO | RoadLines"
Bounds: TypeAlias = tuple[Floats, Floats]


class _PlaneRoads(NamedTuple):
    """Roads on one plane.

    Parameters
    ----------
    chosen : int array, shape (e,)
        Indices of the roads.
    points : float64 array, shape (n, 2)
        Their vertices in metres.
    """

    chosen: NDArray[np.intp]
    points: Floats


@dataclass(frozen=True, eq=False)
class NetworkReadResult:
    """A network, and what was done to it.

    Parameters
    ----------
    network : Network
        The roads.
    name : str
        Name of the source.
    read : int
        Number of roads of the source after joining. Those that are not in the network are too far
        from the log, or not for its vehicles.
    repairs : tuple of Repair
        What was repaired.
    """

    network: Network
    name: str
    read: int
    repairs: tuple[Repair, ...] = ()


def read_network(
    source: RoadSource | Sequence[RoadSource],
    *,
    plane: Plane | None = None,
    near: Sequence[Track] | Track | None = None,
) -> Network:
    """Read a road network.

    Parameters
    ----------
    source : str, Path, binary stream, or sequence of these
        Files of a format of :mod:`gpszip.io.networks.formats`, or one that ``gpszip network``
        prepared. Several are joined to one.
    plane : Plane, optional
        The planes of the network; those of ``near``, or chosen for it, if left out.
    near : sequence of Track, optional
        The log. Only roads near it are read, on the planes where tracks are near.

    Returns
    -------
    Network

    Raises
    ------
    InputError
        If it can't be read, holds no road, or is far from the log.
    CorruptArchiveError
        If a prepared network is damaged.

    Examples
    --------
    >>> import io, json
    >>> line = {"type": "LineString", "coordinates": [[0, 0], [30, 0], [30, 40]]}
    >>> feature = {"type": "Feature", "properties": {}, "geometry": line}
    >>> file = io.BytesIO(json.dumps(feature).encode())
    >>> read_network(file, near=Track("walk", [0, 60], [[0, 0], [30, 40]])).lengths.tolist()
    [70.0]
    """
    return read_network_result(source, plane=plane, near=near).network


def read_network_result(
    source: RoadSource | Sequence[RoadSource],
    *,
    plane: Plane | None = None,
    near: Sequence[Track] | Track | None = None,
) -> NetworkReadResult:
    """Read a road network as :func:`read_network` does, and return what was repaired, too."""
    tracks = [near] if isinstance(near, Track) else list(near or ())
    plane = plane or (tracks[0].plane if tracks else None)

    # Of a prepared network, only blocks near the log are read.
    prepared_path = _find_prepared(source)
    if prepared_path is not None:
        area = build_nearby_area(tracks) if tracks else None
        box_filter = None if area is None else _make_box_filter(area, plane)
        roads = read_prepared_file(prepared_path, str(prepared_path), box_filter)
    else:
        metric = None if not tracks and plane is None else plane is None
        roads = read_road_graph(source, metric=metric)
    return build_network(roads, plane=plane, near=tracks)


def _make_box_filter(area: NearbyArea, plane: Plane | None) -> BoxFilter:
    """Return a filter of boxes that touch the area near a log."""

    def touches_area(boxes: Floats, geographic: bool) -> NDArray[np.bool_]:
        # Other coordinates than those of the log are an error, which building the network raises.
        if geographic != (plane is not None):
            return np.ones(len(boxes), np.bool_)
        low, high = _area_boxes(area, plane)
        touched = np.zeros(len(boxes), np.bool_)
        # Compare some cells with all blocks at a time, to bound the memory for the pairs.
        for first in range(0, len(low), _CELLS_AT_A_TIME):
            cell_low = low[first : first + _CELLS_AT_A_TIME, None]
            cell_high = high[first : first + _CELLS_AT_A_TIME, None]
            overlaps = (cell_low <= boxes[None, :, 2:]) & (cell_high >= boxes[None, :, :2])
            touched |= overlaps.all(axis=2).any(axis=0)
        return touched

    return touches_area


def _area_boxes(area: NearbyArea, plane: Plane | None) -> Bounds:
    """Return lower and upper corners of the cells of an area in the coordinates of a network."""
    centres, half_widths = area.boxes()
    if plane is None:
        return centres - half_widths[:, None], centres + half_widths[:, None]

    # Half sizes in degrees: a degree of longitude shrinks with the cosine of the latitude.
    lat, lon = to_geographic(centres, plane)
    half_height = _BOX_MARGIN * half_widths / _MIN_DEGREE_METRES
    outer_lat = np.minimum(np.abs(lat) + half_height, _MAX_BOX_LATITUDE)
    half_width = half_height / np.maximum(np.cos(np.radians(outer_lat)), _MIN_COSINE)
    middle, half_size = np.stack((lon, lat), axis=1), np.stack((half_width, half_height), axis=1)
    return middle - half_size, middle + half_size


def build_network(
    roads: RoadGraph, *, plane: Plane | None = None, near: Sequence[Track] = ()
) -> NetworkReadResult:
    """Project a road graph to planes, and keep the roads near a log.

    Parameters
    ----------
    roads : RoadGraph
        The graph.
    plane : Plane, optional
        The planes; chosen for the graph if left out.
    near : sequence of Track
        The log; all roads are kept if it is empty.

    Raises
    ------
    InputError
        If no road is near the log, or roads and log are not both in degrees or both in metres.
    """
    # Refuse an empty network, and one whose coordinates are of another kind than the log's.
    if not near and not len(roads):
        raise InputError("holds no road", path=roads.name)
    if near and roads.geographic != (plane is not None):
        kind, log_kind = (
            ("degrees", "x and y")
            if roads.geographic
            else ("metres of an unknown origin", "degrees")
        )
        raise InputError(
            f"is in {kind}, but the log in {log_kind}",
            path=roads.name,
            remedy="convert one of them to the coordinates of the other",
        )

    # Project.
    area = build_nearby_area(near) if near else None
    if not roads.geographic:
        plane = None
        plane_roads = [_PlaneRoads(np.arange(len(roads)), roads.coordinates)]
    else:
        plane = plane or _choose_plane(roads)
        plane_roads = list(_project_to_planes(roads, plane, area))

    # Keep roads near the log.
    repairs = list(roads.repairs)
    if area is not None:
        plane_roads = [_keep_nearby(roads, candidates, area) for candidates in plane_roads]
        if not any(len(kept.chosen) for kept in plane_roads):
            raise _mismatch_error(roads, plane, near)
        plane_roads = _drop_footways(roads, plane_roads, near, repairs)
    network = _assemble(roads, [kept for kept in plane_roads if len(kept.chosen)], plane)
    return NetworkReadResult(network, roads.name, len(roads), tuple(repairs))


def _choose_plane(roads: RoadGraph) -> Plane:
    # Every k-th node is enough to find the median, and regions far from it.
    lon, lat = roads.nodes[:: max(len(roads.nodes) // _PLANE_SAMPLE, 1)].T
    return choose_plane(lat, lon)


def _project_to_planes(
    roads: RoadGraph, plane: Plane, area: NearbyArea | None
) -> Iterator[_PlaneRoads]:
    """Yield for each plane its roads.

    Without an area, a road is on the plane of its first vertex. With an area, it is on every plane
    on which a part of the area is near its first vertex: the graph may have tracks on several
    planes near it.
    """
    # Find the plane of each road, or of each cell of the area, by its position.
    first = roads.coordinates[roads.offsets[:-1]]
    if area is None:
        road_plane = plane_indices(to_plane(first[:, 1], first[:, 0], plane), plane)
    else:
        low, high = _area_boxes(area, plane)
        cell_plane = plane_indices(area.boxes()[0], plane)
    for number, centre in enumerate(plane.centers):
        # Choose the roads.
        if area is None:
            chosen = np.flatnonzero(road_plane == number)
        else:
            on_plane = cell_plane == number
            if not on_plane.any():
                continue
            south_west = low[on_plane].min(axis=0) - _NEARBY_DEGREES
            north_east = high[on_plane].max(axis=0) + _NEARBY_DEGREES
            chosen = np.flatnonzero(((first >= south_west) & (first <= north_east)).all(axis=1))

        # Project them; planes lie side by side.
        lon, lat = roads.coordinates[vertex_rows(roads.offsets, chosen)].T
        points = to_plane(lat, lon, Plane((centre,)))
        points[:, 0] += number * Plane.SPREAD
        yield _PlaneRoads(chosen, points)


def _keep_nearby(roads: RoadGraph, candidates: _PlaneRoads, area: NearbyArea) -> _PlaneRoads:
    """Keep the roads that have a point in an area."""
    # A road is near if one of its vertices is.
    chosen, points = candidates
    if not len(chosen):
        return candidates
    owner = np.repeat(np.arange(len(chosen)), np.diff(roads.offsets)[chosen])
    is_near = np.bincount(owner[area.contains(points)], minlength=len(chosen)) > 0

    # Put points on long steps between two vertices of a road.
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    is_long = np.flatnonzero((steps > _MAX_SPACING) & (np.diff(owner) == 0))
    pieces = np.ceil(steps[is_long] / _MAX_SPACING).astype(np.int64)
    rank = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = rank / np.repeat(pieces, pieces)
    vertex = np.repeat(is_long, pieces)
    between = points[vertex] + share[:, None] * (points[vertex + 1] - points[vertex])
    is_near[owner[vertex[area.contains(between)]]] = True
    return _PlaneRoads(chosen[is_near], points[is_near[owner]])


def _drop_footways(
    roads: RoadGraph,
    plane_roads: list[_PlaneRoads],
    near: Sequence[Track],
    repairs: list[Repair],
) -> list[_PlaneRoads]:
    """Leave out footways for a log of motor vehicles, unless nothing else is near it."""
    # Footways matter only if there are any and the log is of motor vehicles.
    if not (roads.users == RoadUsers.NON_MOTOR).any() or not _is_motorised(near):
        return plane_roads

    # Drop them on each plane.
    remaining, dropped = [], 0
    for chosen, points in plane_roads:
        keep = roads.users[chosen] != RoadUsers.NON_MOTOR
        dropped += int((~keep).sum())
        keep_points = np.repeat(keep, np.diff(roads.offsets)[chosen])
        remaining.append(_PlaneRoads(chosen[keep], points[keep_points]))

    # Without them, is any road near the log?
    if not any(len(kept.chosen) for kept in remaining):
        return plane_roads
    if dropped:
        what = "ways without motor traffic left out, as the log is of motor vehicles"
        repairs.append(Repair(what, dropped, roads.name, drops=False))
    return remaining


def _is_motorised(tracks: Sequence[Track]) -> bool:
    """Whether a log is of motor vehicles, by its speeds."""
    speeds = [
        np.linalg.norm(np.diff(track.positions, axis=0), axis=1) / np.diff(track.times)
        for track in tracks
        if track.timed and len(track) > 1
    ]
    if not speeds:
        return False
    return bool(np.quantile(np.concatenate(speeds), _MOTOR_QUANTILE) > _MOTOR_SPEED)


def _assemble(roads: RoadGraph, plane_roads: Sequence[_PlaneRoads], plane: Plane | None) -> Network:
    """Build the network of roads on all planes."""
    # Put the roads of all planes after each other, in the order of the graph.
    chosen = np.concatenate([kept.chosen for kept in plane_roads])
    points = np.concatenate([kept.points for kept in plane_roads])
    offsets = np.append(0, np.cumsum(np.diff(roads.offsets)[chosen]))
    order = np.argsort(chosen, kind="stable")
    points, chosen = points[vertex_rows(offsets, order)], chosen[order]
    offsets = np.append(0, np.cumsum(np.diff(roads.offsets)[chosen]))
    count = len(chosen)

    # A node of the graph is another node on each plane.
    plane_number = np.repeat(
        np.arange(len(plane_roads)), [len(kept.chosen) for kept in plane_roads]
    )[order]
    graph_nodes = np.concatenate((roads.starts[chosen], roads.ends[chosen]))
    keys = graph_nodes + np.tile(plane_number, 2) * len(roads.nodes)
    distinct, ends = np.unique(keys, return_inverse=True)
    nodes = np.empty((len(distinct), 2))
    nodes[ends[:count]] = points[offsets[:-1]]
    nodes[ends[count:]] = points[offsets[1:] - 1]
    return Network(
        nodes=nodes,
        starts=ends[:count].astype(np.int32),
        ends=ends[count:].astype(np.int32),
        offsets=offsets,
        points=points,
        forward=roads.forward[chosen],
        backward=roads.backward[chosen],
        speeds=roads.speeds[chosen],
        ids=TextColumn(roads.ids.take(pa.array(chosen))),
        names=_take_street_names(roads, chosen),
        plane=plane,
        error=roads.error,
    )


def _take_street_names(roads: RoadGraph, chosen: NDArray[np.intp]) -> TextColumn | None:
    """Return street names, empty for a road without one; None if no road of the source has one."""
    if roads.names.null_count == len(roads.names):
        return None
    return TextColumn(roads.names.take(pa.array(chosen)).fill_null(""))


def _mismatch_error(roads: RoadGraph, plane: Plane | None, near: Sequence[Track]) -> InputError:
    """Return the error for a network that is far from the log."""
    # Bring the log to the coordinates of the network, to name both extents in the same ones.
    log = np.concatenate([track.positions[:, :2] for track in near])
    if plane is not None:
        lat, lon = to_geographic(log, plane)
        log = np.stack((lon, lat), axis=1)
    hint = "give a network of that region"
    if not len(roads):
        reason = f"no road of it is near the log, which is at {_format_extent(log)}"
        return InputError(reason, path=roads.name, remedy=hint)

    # Would the log be near if its axes were swapped?
    vertices = roads.coordinates
    low, high = vertices.min(axis=0) - _NEARBY_DEGREES, vertices.max(axis=0) + _NEARBY_DEGREES
    swapped = log[:, ::-1]
    if plane is not None and ((swapped >= low) & (swapped <= high)).all(axis=1).any():
        hint = "latitude and longitude look swapped in one of them"
    return InputError(
        f"lies elsewhere than the log: {_format_extent(vertices)} of the network "
        f"against {_format_extent(log)} of the log",
        path=roads.name,
        remedy=hint,
    )


def _format_extent(points: Floats) -> str:
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return f"{x0:.6g}..{x1:.6g}, {y0:.6g}..{y1:.6g}"


def read_road_graph(
    source: RoadSource | Sequence[RoadSource],
    *,
    metric: bool | None = None,
    directed: bool | None = None,
) -> RoadGraph:
    """Read sources that are not prepared, and join their lines.

    Parameters
    ----------
    source : str, Path, binary stream, or sequence of these
        As for :func:`read_network`.
    metric : bool, optional
        Whether the log is in x and y; found from the source if left out.
    directed : bool, optional
        Whether a line without a one-way rule may be travelled along its vertices only, as if the
        source had one line for each direction; found from the lines if left out.
    """
    # A list names several sources; anything else is one.
    sources: list[Any] = list(source) if isinstance(source, (list, tuple)) else [source]

    # Read the lines of all files.
    lines_read: list[RoadLines] = []
    for item in sources:
        if isinstance(item, RoadLines):
            lines_read.append(item)
        else:
            lines_read += [_read_lines(file, metric) for file in expand(item, unzip=False)]
    if not lines_read:
        raise InputError("no network given", remedy="name a file")

    # Join them.
    lines = lines_read[0] if len(lines_read) == 1 else _concatenate(lines_read)
    if directed is not None and lines.directed is None:
        lines = replace(lines, directed=directed)
    return build_road_graph(lines)


def _read_lines(source: Source | InputError, metric: bool | None) -> RoadLines:
    if isinstance(source, InputError):
        raise source
    return find_network_format(source).read(source, metric)


def _concatenate(lines_read: Sequence[RoadLines]) -> RoadLines:
    """Return the lines of several sources, which have to have the same coordinates."""
    # Refuse to mix degrees and metres.
    first, last = lines_read[0], lines_read[-1]
    if len({lines.geographic for lines in lines_read}) > 1:
        raise InputError(
            f"{first.name} and {last.name}: one is in degrees and the other in metres",
            remedy="convert one of them",
        )

    # The offsets of a source count from its own start.
    counts = np.concatenate([np.diff(lines.offsets) for lines in lines_read])
    return replace(
        first,
        name=f"{first.name} and {len(lines_read) - 1} more",
        coordinates=np.concatenate([lines.coordinates for lines in lines_read]),
        offsets=np.append(0, np.cumsum(counts)),
        forward=np.concatenate([lines.forward for lines in lines_read]),
        backward=np.concatenate([lines.backward for lines in lines_read]),
        speeds=np.concatenate([lines.speeds for lines in lines_read]),
        users=np.concatenate([lines.users for lines in lines_read]),
        ids=pa.concat_arrays([lines.ids for lines in lines_read]),
        names=pa.concat_arrays([lines.names for lines in lines_read]),
        directed=False if any(lines.directed is False for lines in lines_read) else None,
        repairs=tuple(repair for lines in lines_read for repair in lines.repairs),
        error=_largest_error(lines_read),
    )


def _largest_error(lines_read: Sequence[RoadLines]) -> float | None:
    """Largest error of learned maps; None with roads that were not learned."""
    errors = [lines.error for lines in lines_read if lines.error is not None]
    return max(errors) if len(errors) == len(lines_read) else None


def is_archive(source: Any) -> bool:
    """Whether a source of roads is the file of an archive, whose map another package reads."""
    return _starts_with(source, _ARCHIVE_MAGIC)


def _find_prepared(source: Any) -> Path | None:
    """Return the path of a prepared network; None for any other source."""
    if isinstance(source, (list, tuple)) and len(source) == 1:
        return _find_prepared(source[0])
    return Path(source) if _starts_with(source, PREPARED_MAGIC) else None


def _starts_with(source: Any, magic: bytes) -> bool:
    if not isinstance(source, (str, Path)) or not Path(source).is_file():
        return False
    with Path(source).open("rb") as file:
        return file.read(len(magic)) == magic
