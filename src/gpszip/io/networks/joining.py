"""Join road lines to a graph: index positions, merge doubled roads, split lines where they meet."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.networks.lines import RoadLines, take_attributes, take_lines, vertex_rows
from gpszip.model.read_result import Repair

__all__ = ["RoadGraph", "build_road_graph"]

#: Positions are rounded to 1e-7 degrees, about a centimetre; vertices that round alike are one.
_STEPS_PER_DEGREE = 1e7

#: The same for metres: a millimetre.
_STEPS_PER_METRE = 1e3

#: Coordinates beyond are positions neither in degrees nor in metres: the Earth is 4e7 m around.
_MAX_COORDINATE = 1e9

#: Share of lines off the globe above which the coordinates can't be degrees.
_MAX_OFF_GLOBE_SHARE = 0.01

#: If more than this share of the lines has a twin that runs the other way, the source has one line
#: for each direction.
_MIN_TWIN_SHARE = 0.5

#: The share is measured on at least this many different shapes.
_MIN_SHAPES = 20

#: Multipliers that mix the bits of a vertex, those of SplitMix64.
_HASH_MULTIPLIERS = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)

#: Base of the polynomial over the vertices of a line; odd, so that its powers never become 0.
_HASH_BASE = np.uint64(0xD6E8FEB86659FD93)

#: Value of an int64 that keys of positions stay below.
_MAX_KEY = 2.0**62

Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RoadGraph:
    """A graph of roads in the coordinates of its source.

    Parameters
    ----------
    name : str
        Name of the source.
    nodes : float64 array, shape (V, 2)
        Nodes: longitude and latitude, or metres.
    starts, ends : int32 array, shape (E,)
        Nodes of each road.
    offsets : int64 array, shape (E + 1,)
        As in :class:`RoadLines`.
    coordinates : float64 array, shape (N, 2)
        Vertices of the roads, from start to end.
    geographic : bool
        Whether coordinates are degrees.
    forward, backward, speeds, users, ids, names
        As in :class:`RoadLines`.
    repairs : tuple of Repair
        What was repaired.
    error : float or None
        As in :class:`RoadLines`.
    """

    name: str
    nodes: NDArray[np.float64]
    starts: NDArray[np.int32]
    ends: NDArray[np.int32]
    offsets: Longs
    coordinates: NDArray[np.float64]
    geographic: bool
    forward: NDArray[np.bool_]
    backward: NDArray[np.bool_]
    speeds: NDArray[np.float64]
    users: NDArray[np.uint8]
    ids: Any
    names: Any
    repairs: tuple[Repair, ...] = field(default=())
    error: float | None = None

    def __len__(self) -> int:
        return len(self.starts)


class _IndexedLines(NamedTuple):
    """Lines whose vertices are indices of positions.

    Parameters
    ----------
    lines : RoadLines
        Attributes and offsets; their coordinates are not used any more.
    vertices : int64 array, shape (N,)
        Index of each vertex's position.
    """

    lines: RoadLines
    vertices: Longs


def build_road_graph(lines: RoadLines) -> RoadGraph:
    """Join lines to a graph.

    1. Drop lines with invalid coordinates.
    2. Index positions: vertices at the same position are one.
    3. Merge lines of the same shape to one road, which may be travelled as any of them.
    4. Split lines at every vertex that they share with another line or with themselves. Where
       lines cross without a shared vertex, one is a bridge over the other.
    5. Merge the fragments of the same shape.
    6. The ends of lines are the nodes.

    Parameters
    ----------
    lines : RoadLines
        In any order.

    Returns
    -------
    RoadGraph
        Roads in the order of the lines.

    Raises
    ------
    InputError
        If no line has a length, or coordinates that should be degrees are not.
    """
    # 1. Valid lines.
    repairs = list(lines.repairs)
    lines = _drop_invalid(lines, repairs)
    lines = _unify_antimeridian(lines)

    # 2. Positions.
    positions, vertices = _index_positions(lines)
    indexed = _drop_repeated_vertices(_IndexedLines(lines, vertices), repairs)

    # 3. to 5. Merge and split.
    indexed = _merge_same_shapes(indexed, repairs, resolve_direction=True)
    indexed = _split_at_shared_vertices(indexed, len(positions), repairs)
    lines, vertices = _merge_same_shapes(indexed, repairs, resolve_direction=False)

    # 6. Nodes.
    first, last = vertices[lines.offsets[:-1]], vertices[lines.offsets[1:] - 1]
    nodes, ends = np.unique(np.concatenate((first, last)), return_inverse=True)
    return RoadGraph(
        name=lines.name,
        nodes=positions[nodes],
        starts=ends[: len(lines)].astype(np.int32),
        ends=ends[len(lines) :].astype(np.int32),
        offsets=lines.offsets,
        coordinates=positions[vertices],
        geographic=lines.geographic,
        forward=lines.forward,
        backward=lines.backward,
        speeds=lines.speeds,
        users=lines.users,
        ids=lines.ids,
        names=lines.names,
        repairs=tuple(repairs),
        error=lines.error,
    )


def _drop_invalid(lines: RoadLines, repairs: list[Repair]) -> RoadLines:
    """Drop lines with a vertex that is no position."""
    # NaN compares as false, so it is invalid, too.
    bad = ~(np.abs(lines.coordinates) < _MAX_COORDINATE).all(axis=1)
    if lines.geographic:
        lon, lat = lines.coordinates.T
        off = (np.abs(lat) > 90) | (np.abs(lon) > 360)
        if off.sum() > _MAX_OFF_GLOBE_SHARE * len(off):
            first = int(off.argmax())
            raise InputError(
                "these are no degrees",
                path=lines.name,
                location=f"longitude {lon[first]:g}, latitude {lat[first]:g}",
                remedy="say in which coordinates it is (its CRS), or convert it to WGS84",
            )
        bad |= off
    if not bad.any():
        return lines

    # Drop a line even if only one vertex is bad: the rest would have another shape.
    owner = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))
    is_broken = np.bincount(owner[bad], minlength=len(lines)) > 0
    _note_dropped(repairs, lines, "roads with a vertex that is no position dropped", is_broken)
    return take_lines(lines, np.flatnonzero(~is_broken))


def _unify_antimeridian(lines: RoadLines) -> RoadLines:
    """Turn a longitude of -180 into 180 degrees: lines cut at the antimeridian meet again."""
    if not lines.geographic or not (lines.coordinates[:, 0] == -180.0).any():
        return lines
    lon, lat = lines.coordinates.T
    return replace(lines, coordinates=np.stack([np.where(lon == -180.0, 180.0, lon), lat], axis=1))


def _index_positions(lines: RoadLines) -> tuple[NDArray[np.float64], Longs]:
    """Return the distinct positions, rounded, and the index of each vertex's position."""
    # An empty network has no extent.
    points = lines.coordinates
    if not len(points):
        return np.empty((0, 2)), np.empty(0, np.int64)

    # Round coarser where the extent is so large that keys of positions would overflow.
    scale = _STEPS_PER_DEGREE if lines.geographic else _STEPS_PER_METRE
    low, high = points.min(axis=0), points.max(axis=0)
    while np.prod((high - low) * scale + 2) > _MAX_KEY:
        scale /= 10

    # A key holds both coordinates: x * height + y.
    x0, y0 = np.rint(low * scale).astype(np.int64)
    x, y = np.rint(points * scale).astype(np.int64).T
    height = int(y.max() - y0) + 1
    keys, vertices = np.unique((x - x0) * height + (y - y0), return_inverse=True)
    positions = np.stack((keys // height + x0, keys % height + y0), axis=1) / scale
    return positions, vertices.astype(np.int64)


def _drop_repeated_vertices(indexed: _IndexedLines, repairs: list[Repair]) -> _IndexedLines:
    """Drop vertices that repeat the one before, and lines that have only one vertex left."""
    lines, vertices = indexed

    # Keep the first vertex of each line, and those that differ from the one before.
    keep = np.ones(len(vertices), np.bool_)
    keep[1:] = vertices[1:] != vertices[:-1]
    keep[lines.offsets[:-1][np.diff(lines.offsets) > 0]] = True
    counts = np.diff(np.append(0, np.cumsum(keep))[lines.offsets])

    # A line with a single vertex left has no length, so that it is no road.
    has_length = counts >= 2
    _note_dropped(repairs, lines, "roads without a length dropped", ~has_length)
    if not has_length.any():
        raise InputError("holds no road: no line with two different vertices", path=lines.name)
    keep &= np.repeat(has_length, np.diff(lines.offsets))
    offsets = np.append(0, np.cumsum(counts[has_length]))
    lines = replace(take_attributes(lines, np.flatnonzero(has_length)), offsets=offsets)
    return _IndexedLines(lines, vertices[keep])


def _hash_shapes(vertices: Longs, offsets: Longs) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Return a hash of each line's vertices read forwards, and one read backwards.

    The hash of vertices v_0 ... v_n is the sum of mix(v_i) * base**i modulo 2**64, where mix is
    the finaliser of SplitMix64 (Steele, Lea, Flood: Fast splittable pseudorandom number
    generators, 2014).
    """
    counts = np.diff(offsets)
    # powers[i] is base**(i + 1): all hashes have the same factor, so that equal shapes stay equal.
    with np.errstate(over="ignore"):
        powers = np.cumprod(np.full(int(counts.max()), _HASH_BASE, np.uint64))

        # Mix the bits of each vertex.
        # One is added, as 0 is mixed to 0, so that position 0 would not count.
        mixed = (vertices.astype(np.uint64) + np.uint64(1)) * _HASH_MULTIPLIERS[0]
        mixed = (mixed ^ (mixed >> np.uint64(30))) * _HASH_MULTIPLIERS[1]
        mixed = (mixed ^ (mixed >> np.uint64(27))) * _HASH_MULTIPLIERS[2]
        mixed ^= mixed >> np.uint64(31)

        # Sum up each line in both directions.
        # The exponent is the rank of a vertex in its line, from its start and then from its end.
        exponent = np.arange(len(vertices)) - np.repeat(offsets[:-1], counts)
        forwards = np.add.reduceat(mixed * powers[exponent], offsets[:-1])
        exponent = np.repeat(counts, counts) - 1 - exponent
        return forwards, np.add.reduceat(mixed * powers[exponent], offsets[:-1])


def _merge_same_shapes(
    indexed: _IndexedLines, repairs: list[Repair], *, resolve_direction: bool
) -> _IndexedLines:
    """Merge lines of the same shape, whatever their direction.

    The first line of a group stays. It may be travelled in each direction in which any of the
    lines may, has the highest speed and the least restricted users, and the first name.
    """
    # Group lines by the lower one of their two hashes; a line is reversed if that is the backward.
    lines, vertices = indexed
    forwards, backwards = _hash_shapes(vertices, lines.offsets)
    is_reversed = backwards < forwards
    _, first, group = np.unique(
        np.where(is_reversed, backwards, forwards), return_index=True, return_inverse=True
    )
    if resolve_direction and lines.directed is not False:
        lines = _resolve_direction(lines, is_reversed, group, len(first), repairs)
    if len(first) == len(lines):
        return _IndexedLines(lines, vertices)
    merged_count = len(lines) - len(first)
    _add_repair(repairs, lines, "roads merged with another one of the same shape", merged_count)

    # Combine the attributes of each group.
    along = np.where(is_reversed, lines.backward, lines.forward)
    against = np.where(is_reversed, lines.forward, lines.backward)
    along, against = np.bincount(group, along) > 0, np.bincount(group, against) > 0
    speeds = np.full(len(first), np.nan)
    np.fmax.at(speeds, group, lines.speeds)
    users = np.full(len(first), 255, np.uint8)
    np.minimum.at(users, group, lines.users)
    named = _choose_named(lines, group, first)

    # Keep the first line of each group, in the order of the lines.
    chosen = np.sort(first)
    chosen_group, is_reversed = group[chosen], is_reversed[chosen]
    merged = replace(
        take_attributes(lines, chosen),
        offsets=np.append(0, np.cumsum(np.diff(lines.offsets)[chosen])),
        forward=np.where(is_reversed, against[chosen_group], along[chosen_group]),
        backward=np.where(is_reversed, along[chosen_group], against[chosen_group]),
        speeds=speeds[chosen_group],
        users=users[chosen_group],
        names=lines.names.take(pa.array(named[chosen_group])),
    )
    return _IndexedLines(merged, vertices[vertex_rows(lines.offsets, chosen)])


def _choose_named(lines: RoadLines, group: Longs, first: Longs) -> Longs:
    """Return the first line of each group that has a name, or its first line if none has."""
    named = np.flatnonzero(lines.names.is_valid().to_numpy(zero_copy_only=False))
    best = np.full(len(first), len(lines))
    np.minimum.at(best, group[named], named)
    return np.where(best < len(lines), best, first)


def _resolve_direction(
    lines: RoadLines,
    is_reversed: NDArray[np.bool_],
    group: Longs,
    group_count: int,
    repairs: list[Repair],
) -> RoadLines:
    """Find out whether the source has one line for each direction.

    If so, a line may be travelled along its vertices only: a line without a twin is one-way.
    """
    if lines.directed is None:
        has_forward = np.bincount(group, ~is_reversed, group_count) > 0
        has_backward = np.bincount(group, is_reversed, group_count) > 0
        has_twin = has_backward & has_forward
        if group_count < _MIN_SHAPES or has_twin.mean() <= _MIN_TWIN_SHARE:
            return lines

        what = "roads read as one-way: most have a twin against them, these don't"
        _add_repair(repairs, lines, what, int((~has_twin).sum()))
    return replace(lines, forward=lines.forward.copy(), backward=np.zeros(len(lines), np.bool_))


def _split_at_shared_vertices(
    indexed: _IndexedLines, position_count: int, repairs: list[Repair]
) -> _IndexedLines:
    """Split lines at inner vertices that occur more than once in all lines."""
    # Find where a fragment begins.
    lines, vertices = indexed
    is_first, is_last = np.zeros(len(vertices), np.bool_), np.zeros(len(vertices), np.bool_)
    is_first[lines.offsets[:-1]] = True
    is_last[lines.offsets[1:] - 1] = True
    is_shared = (np.bincount(vertices, minlength=position_count) > 1)[vertices]
    begin = np.flatnonzero(is_first | (is_shared & ~is_last))
    if len(begin) == len(lines):
        return indexed
    owner = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))[begin]
    split_count = len(np.unique(owner[~is_first[begin]]))
    _add_repair(repairs, lines, "roads split where others meet them", split_count)

    # A fragment ends with the vertex at which the next one of its line begins.
    end = np.append(begin[1:], len(vertices))
    is_last_of_line = np.append(is_first[begin[1:]], True)
    end = np.where(is_last_of_line, end - 1, end)
    counts = end - begin + 1
    offsets = np.append(0, np.cumsum(counts))
    rows = np.arange(offsets[-1]) + np.repeat(begin - offsets[:-1], counts)
    lines = replace(take_attributes(lines, owner), offsets=offsets)
    return _IndexedLines(lines, vertices[rows])


def _note_dropped(
    repairs: list[Repair], lines: RoadLines, what: str, is_dropped: NDArray[np.bool_]
) -> None:
    """Note how many lines were dropped, with the id of the first one."""
    if is_dropped.any():
        first_id = lines.ids[int(is_dropped.argmax())].as_py()
        _add_repair(repairs, lines, what, int(is_dropped.sum()), f"road {first_id!r}")


def _add_repair(
    repairs: list[Repair], lines: RoadLines, what: str, count: int, value: str = ""
) -> None:
    if count:
        repairs.append(Repair(what, count, lines.name, drops="dropped" in what, value=value))
