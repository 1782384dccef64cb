"""From lines to a graph: places united, doubled roads made one, lines cut where they meet."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.networks.lines import RoadLines, take_attributes, take_lines, vertex_rows
from gpszip.model.read_result import Repair

__all__ = ["RoadGraph", "build_road_graph"]

#: Vertices that are the same in so many parts of a degree (of a centimetre), or of a metre, are one place.
_STEPS_PER_DEGREE, _STEPS_PER_METRE = 1e7, 1e3

#: Coordinates beyond are no place in degrees or metres: the Earth is 4e7 m around.
_MAX_COORDINATE = 1e9

#: Where more than this share of at least so many lines has a twin that runs against it, every line is one direction.
_MIN_TWIN_SHARE, _MIN_SHAPES = 0.5, 20

_HASH_MULTIPLIERS = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)
_HASH_BASE = np.uint64(0xD6E8FEB86659FD93)

Longs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RoadGraph:
    """A graph of roads in the coordinates of its source.

    Parameters
    ----------
    name : str
        Of the source.
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
        What was mended.
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

    def __len__(self) -> int:
        return len(self.starts)


def build_road_graph(lines: RoadLines) -> RoadGraph:
    """Make a graph of lines.

    Vertices at the same place are one. Lines are cut at every vertex that they share with another line or with themselves;
    where lines cross without sharing a vertex, one leads over the other. Roads of the same shape are one, which may be
    travelled as any of them; roads without a length are dropped.

    Parameters
    ----------
    lines : RoadLines
        In any order.

    Returns
    -------
    JoinedRoads
        Roads in the order of the lines.

    Raises
    ------
    InputError
        If no line has a length, or coordinates said to be degrees are none.
    """
    repairs = list(lines.repairs)
    lines = _drop_invalid(lines, repairs)
    lines = _unify_antimeridian(lines)
    places, at = _index_positions(lines)
    lines, at = _drop_repeated_vertices(lines, at, repairs)
    lines, at = _merge_same_shapes(lines, at, repairs, whole=True)
    lines, at = _split_at_shared_vertices(lines, at, len(places), repairs)
    lines, at = _merge_same_shapes(lines, at, repairs, whole=False)
    first, last = at[lines.offsets[:-1]], at[lines.offsets[1:] - 1]
    nodes, ends = np.unique(np.concatenate((first, last)), return_inverse=True)
    return RoadGraph(
        name=lines.name,
        nodes=places[nodes],
        starts=ends[: len(lines)].astype(np.int32),
        ends=ends[len(lines) :].astype(np.int32),
        offsets=lines.offsets,
        coordinates=places[at],
        geographic=lines.geographic,
        forward=lines.forward,
        backward=lines.backward,
        speeds=lines.speeds,
        users=lines.users,
        ids=lines.ids,
        names=lines.names,
        repairs=tuple(repairs),
    )


def _unify_antimeridian(lines: RoadLines) -> RoadLines:
    """Lines that were cut at the antimeridian meet there again: -180 degrees are 180."""
    if not lines.geographic or not (lines.coordinates[:, 0] == -180.0).any():
        return lines
    lon, lat = lines.coordinates.T
    return replace(lines, coordinates=np.stack([np.where(lon == -180.0, 180.0, lon), lat], axis=1))


def _drop_invalid(lines: RoadLines, repairs: list[Repair]) -> RoadLines:
    """Lines all of whose coordinates can be used."""
    bad = ~(np.abs(lines.coordinates) < _MAX_COORDINATE).all(
        axis=1
    )  # what is no number is not less, either
    if lines.geographic:
        lon, lat = lines.coordinates.T
        off = (np.abs(lat) > 90) | (np.abs(lon) > 360)
        if off.sum() > 0.01 * len(off):
            first = int(off.argmax())
            where = f"{lines.name}: longitude {lon[first]:g}, latitude {lat[first]:g}"
            raise InputError(
                f"{where}: no degrees; say in which coordinates it is (its CRS), or convert it to WGS84"
            )
        bad |= off
    if not bad.any():
        return lines
    owner = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))
    broken = np.bincount(owner[bad], minlength=len(lines)) > 0
    _note_dropped(repairs, lines, "roads with a vertex that is no position dropped", broken)
    return take_lines(lines, np.flatnonzero(~broken))


def _index_positions(lines: RoadLines) -> tuple[NDArray[np.float64], Longs]:
    """Places, and that of each vertex."""
    scale = _STEPS_PER_DEGREE if lines.geographic else _STEPS_PER_METRE
    points = lines.coordinates
    if not len(points):
        return np.empty((0, 2)), np.empty(0, np.int64)
    low, high = points.min(axis=0), points.max(axis=0)
    while np.prod((high - low) * scale + 2) > 2.0**62:
        scale /= 10
    x0, y0 = np.rint(low * scale).astype(np.int64)
    x, y = np.rint(points * scale).astype(np.int64).T
    span = int(y.max() - y0) + 1
    keys, at = np.unique((x - x0) * span + (y - y0), return_inverse=True)
    return np.stack((keys // span + x0, keys % span + y0), axis=1) / scale, at.astype(np.int64)


def _drop_repeated_vertices(
    lines: RoadLines, at: Longs, repairs: list[Repair]
) -> tuple[RoadLines, Longs]:
    """Drop vertices that repeat the one before, and lines of which nothing is left."""
    keep = np.ones(len(at), np.bool_)
    keep[1:] = at[1:] != at[:-1]
    keep[lines.offsets[:-1][np.diff(lines.offsets) > 0]] = True
    counts = np.diff(np.append(0, np.cumsum(keep))[lines.offsets])
    good = counts >= 2
    _note_dropped(repairs, lines, "roads without a length dropped", ~good)
    if not good.any():
        raise InputError(f"{lines.name}: holds no road: no line with two different vertices")
    keep &= np.repeat(good, np.diff(lines.offsets))
    offsets = np.append(0, np.cumsum(counts[good]))
    return replace(take_attributes(lines, np.flatnonzero(good)), offsets=offsets), at[keep]


def _hash_shapes(at: Longs, offsets: Longs) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Hash of each line's vertices read forwards, and backwards."""
    counts = np.diff(offsets)
    with np.errstate(over="ignore"):
        powers = np.cumprod(np.full(int(counts.max()), _HASH_BASE, np.uint64))
        mixed = (at.astype(np.uint64) + np.uint64(1)) * _HASH_MULTIPLIERS[0]
        mixed = (mixed ^ (mixed >> np.uint64(30))) * _HASH_MULTIPLIERS[1]
        mixed = (mixed ^ (mixed >> np.uint64(27))) * _HASH_MULTIPLIERS[2]
        mixed ^= mixed >> np.uint64(31)
        position = np.arange(len(at)) - np.repeat(offsets[:-1], counts)
        onward = np.add.reduceat(mixed * powers[position], offsets[:-1])
        position = np.repeat(counts, counts) - 1 - position
        return onward, np.add.reduceat(mixed * powers[position], offsets[:-1])


def _merge_same_shapes(
    lines: RoadLines, at: Longs, repairs: list[Repair], *, whole: bool
) -> tuple[RoadLines, Longs]:
    """One line of all those of the same shape, in either direction."""
    onward, back = _hash_shapes(at, lines.offsets)
    turned = back < onward
    _, first, group = np.unique(
        np.where(turned, back, onward), return_index=True, return_inverse=True
    )
    if whole and lines.directed is not False:
        lines = _resolve_direction(lines, turned, group, len(first), repairs)
    if len(first) == len(lines):
        return lines, at
    _add_repair(
        repairs, lines, "roads united with another one of the same shape", len(lines) - len(first)
    )
    along, against = (
        np.where(turned, lines.backward, lines.forward),
        np.where(turned, lines.forward, lines.backward),
    )
    along, against = np.bincount(group, along) > 0, np.bincount(group, against) > 0
    speeds = np.full(len(first), np.nan)
    np.fmax.at(speeds, group, lines.speeds)
    users = np.full(len(first), 255, np.uint8)
    np.minimum.at(users, group, lines.users)
    chosen = np.sort(first)
    kept, turned = group[chosen], turned[chosen]
    united = replace(
        take_attributes(lines, chosen),
        offsets=np.append(0, np.cumsum(np.diff(lines.offsets)[chosen])),
        forward=np.where(turned, against[kept], along[kept]),
        backward=np.where(turned, along[kept], against[kept]),
        speeds=speeds[kept],
        users=users[kept],
        names=lines.names.take(pa.array(_choose_named(lines, group, first)[kept])),
    )
    return united, at[vertex_rows(lines.offsets, chosen)]


def _choose_named(lines: RoadLines, group: Longs, first: Longs) -> Longs:
    """For each group of lines the first one that has a name, or the first one of all."""
    named = np.flatnonzero(lines.names.is_valid().to_numpy(zero_copy_only=False))
    best = np.full(len(first), len(lines))
    np.minimum.at(best, group[named], named)
    return np.where(best < len(lines), best, first)


def _resolve_direction(
    lines: RoadLines, turned: NDArray[np.bool_], group: Longs, groups: int, repairs: list[Repair]
) -> RoadLines:
    """Tell whether lines come one for each direction; those without a twin are then one-way."""
    if lines.directed is None:
        twins = (np.bincount(group, turned, groups) > 0) & (np.bincount(group, ~turned, groups) > 0)
        if groups < _MIN_SHAPES or twins.mean() <= _MIN_TWIN_SHARE:
            return lines
        _add_repair(
            repairs,
            lines,
            "roads read as one-way: most have a twin against them, these don't",
            int((~twins).sum()),
        )
    return replace(lines, forward=lines.forward.copy(), backward=np.zeros(len(lines), np.bool_))


def _split_at_shared_vertices(
    lines: RoadLines, at: Longs, places: int, repairs: list[Repair]
) -> tuple[RoadLines, Longs]:
    """Cut lines at the vertices that they share."""
    first, last = np.zeros(len(at), np.bool_), np.zeros(len(at), np.bool_)
    first[lines.offsets[:-1]] = last[lines.offsets[1:] - 1] = True
    begins = first | ((np.bincount(at, minlength=places) > 1)[at] & ~last)
    begin = np.flatnonzero(begins)
    if len(begin) == len(lines):
        return lines, at
    owner = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))[begin]
    _add_repair(
        repairs, lines, "roads cut where others meet them", len(np.unique(owner[~first[begin]]))
    )
    ends = np.append(begin[1:], len(at))
    ends = np.where(np.append(first[begin[1:]], True), ends - 1, ends)
    counts = ends - begin + 1
    offsets = np.append(0, np.cumsum(counts))
    rows = np.arange(offsets[-1]) + np.repeat(begin - offsets[:-1], counts)
    return replace(take_attributes(lines, owner), offsets=offsets), at[rows]


def _note_dropped(
    repairs: list[Repair], lines: RoadLines, what: str, which: NDArray[np.bool_]
) -> None:
    """Note which lines were dropped, if any were, with the first of them."""
    if which.any():
        _add_repair(
            repairs,
            lines,
            what,
            int(which.sum()),
            f"road {lines.ids[int(which.argmax())].as_py()!r}",
        )


def _add_repair(
    repairs: list[Repair], lines: RoadLines, what: str, count: int, value: str = ""
) -> None:
    if count:
        repairs.append(Repair(what, count, lines.name, drops="dropped" in what, value=value))
