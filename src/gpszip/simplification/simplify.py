"""A clean map from an archive: one way for each street, between junctions that are shared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model import RoadMap, Walk
from gpszip.model.way_map import WayMap
from gpszip.simplification import traversals as travels
from gpszip.simplification.bundling import bundle
from gpszip.simplification.centrelines import centred
from gpszip.simplification.corridors import chords
from gpszip.simplification.skeleton import LineGraph, contract, prune, simplified, skeleton, smooth_lines, string

__all__ = ["clean_map"]

#: Dead ends shorter than this many scales are noise; junctions nearer than this are one; a hole of a smaller radius is filled.
_SPUR, _JUNCTION, _HOLE = 4.0, 1.5, 2.0

#: Passes of smoothing that take the steps of the grid away.
_SMOOTHING = 4

#: A move this many times as fast as 19 of 20 is a jump of the receiver: nobody travelled it.
_JUMP = 4.0

#: Parts of the day for which speeds are told.
_PARTS = 4

#: Lines keep their shape to this share of a scale when vertices are dropped.
_SHAPE = 0.1


def clean_map(
    road_map: RoadMap, walks: Sequence[Walk], resolution: float, *, sampling: float | None = None, min_traversals: int = 1
) -> WayMap:
    """Make one way of what was travelled along the same street.

    Edges of the road map attract each other within the scale of their bundles and follow shared ground instead of cutting its
    corners (:mod:`gpszip.simplification.bundling`). The ground is thinned to lines, spurs and holes of noise go, and near junctions
    become one. Then every move of the walks is matched with the lines, which gives their counts, speeds and widths.

    Parameters
    ----------
    road_map : RoadMap
        Of an archive. Ways follow its first two axes and keep the height of its nodes; on a line (d = 1) nothing is moved.
    walks : sequence of Walk
        All walks on it.
    resolution : float
        Quantum of the archive's nodes in metres: it goes with the error that was allowed, and is the least scale.
    sampling : float, optional
        Seconds between two samples of the log; guessed from the walks where that is not known.
    min_traversals : int, default 1
        Leave out ways that were travelled less often, both directions together.

    Returns
    -------
    WayMap
        Deterministic. Empty where nobody moved.

    Examples
    --------
    >>> from gpszip.walks.counting import count_edges
    >>> nodes = np.array([[0.0, 0], [50, 1], [100, 0], [50, -1]])
    >>> walks = [Walk(str(i), np.array([0, 1 + 2 * (i % 2), 2]), np.array([0.0, 5, 10]), np.zeros(2, bool)) for i in range(4)]
    >>> made = clean_map(count_edges(nodes, walks), walks, 2.0)
    >>> made.forward.tolist(), made.backward.tolist(), np.round(made.speed).tolist()
    ([4], [0], [[10.0, 10.0, 10.0]])
    """
    hops = travels.hops_of(road_map, walks)
    believed = _believed(road_map, hops)
    travelled = np.bincount(hops.edges[believed], minlength=len(road_map.edges))
    length = np.linalg.norm(np.diff(road_map.nodes[road_map.edges], axis=1)[:, 0], axis=1)
    chord = chords(length, hops.edges[believed], hops.seconds[believed], sampling)
    lines = _lines(road_map, travelled, chord, resolution)
    routes = travels.match_edges(road_map, lines, chord, resolution)
    if lines.places.shape[1] == 2 and len(lines.pairs):
        lines = smooth_lines(centred(road_map, travelled.astype(np.float64), chord, lines, routes, resolution), _SMOOTHING)
    lines, routes = _often(road_map, lines, routes, max(min_traversals, 1))
    trusted = replace(hops, seconds=np.where(believed, hops.seconds, np.nan))
    return _told(road_map, trusted, lines, routes, resolution)


def _believed(road_map: RoadMap, hops: travels.Hops) -> NDArray[np.bool_]:
    """Which moves were no jumps."""
    if not len(hops.edges) or np.isnan(hops.seconds).any():
        return np.ones(len(hops.edges), np.bool_)
    ends = road_map.nodes[road_map.edges[hops.edges]]
    speed = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / hops.seconds
    slow: NDArray[np.bool_] = speed <= _JUMP * np.quantile(speed, 0.95)
    return slow


def _lines(road_map: RoadMap, travelled: NDArray[np.int64], chord: NDArray[np.float64], scale: float) -> LineGraph:
    flat, kept = road_map.nodes[:, :2], np.flatnonzero(travelled)
    if flat.shape[1] < 2 or not len(kept):
        return LineGraph(flat, road_map.edges[kept])
    ground = bundle(flat, road_map.edges[kept], travelled[kept].astype(np.float64), chord[kept], scale)
    lines = skeleton(ground.grid, ground.density, math.pi * (_HOLE * scale) ** 2)
    lines = contract(prune(lines, _SPUR * scale), _JUNCTION * scale)
    return smooth_lines(prune(lines, _SPUR * scale), _SMOOTHING)


def _often(road_map: RoadMap, lines: LineGraph, routes: travels.Routes, least: int) -> tuple[LineGraph, travels.Routes]:
    """Leave out the strings that were travelled less often."""
    strings = string(lines)
    rare = travels.counts(road_map, lines, strings, routes).sum(axis=0) < least
    kept = np.ones(len(lines.pairs), np.bool_)
    kept[strings.pairs[rare[strings.owner]]] = False
    steps = kept[routes.steps]
    offsets = np.append(0, np.cumsum(steps))[routes.offsets]
    number = np.cumsum(kept) - 1
    routes = replace(routes, offsets=offsets, steps=number[routes.steps[steps]], along=routes.along[steps])
    return LineGraph(lines.places, lines.pairs[kept]), routes


def _told(road_map: RoadMap, hops: travels.Hops, lines: LineGraph, routes: travels.Routes, scale: float) -> WayMap:
    strings = string(lines)
    forward, backward = travels.counts(road_map, lines, strings, routes)
    offsets, vertices = simplified(lines, strings, _SHAPE * scale)
    junctions, ends = np.unique(strings.ends, return_inverse=True)
    places = travels.lifted(road_map, lines, routes)
    return WayMap(
        junctions=places[junctions],
        ends=ends.reshape(-1, 2).astype(np.int32),
        offsets=offsets,
        points=places[vertices],
        length=strings.lengths(lines),
        forward=forward,
        backward=backward,
        speed=travels.speeds(road_map, hops, lines, strings, routes),
        hourly=travels.hourly_speeds(road_map, hops, lines, strings, routes, _PARTS),
        width=travels.widths(road_map, hops, lines, strings, routes),
        plane=road_map.plane,
    )
