"""A clean map from an archive: one way for each street, between junctions that are shared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model import RoadMap, Walk
from gpszip.model.clean_map import CleanMap
from gpszip.simplification import traversals as travels
from gpszip.simplification.bundling import bundle_edges
from gpszip.simplification.centrelines import move_to_centrelines
from gpszip.simplification.corridors import sample_spacings
from gpszip.simplification.skeleton import (
    Skeleton,
    build_chains,
    build_skeleton,
    consolidate_junctions,
    prune_spurs,
    simplify_chains,
    smooth_skeleton,
)

__all__ = ["clean_map"]

#: Dead ends shorter than this many scales are noise; junctions nearer than this are one; a hole of a smaller radius is filled.
_SPUR, _JUNCTION, _HOLE = 4.0, 1.5, 2.0

#: Passes of smoothing that take the steps of the grid away.
_SMOOTHING_PASSES = 4

#: A move this many times as fast as 19 of 20 is a jump of the receiver: nobody travelled it.
_OUTLIER_FACTOR = 4.0

#: Parts of the day for which speeds are told.
_DAYTIMES = 4

#: Lines keep their shape to this share of a scale when vertices are dropped.
_SHAPE_TOLERANCE = 0.1


def clean_map(
    road_map: RoadMap,
    walks: Sequence[Walk],
    resolution: float,
    *,
    sampling: float | None = None,
    min_traversals: int = 1,
) -> CleanMap:
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
    hops = travels.list_traversals(road_map, walks)
    believed = _find_plausible(road_map, hops)
    travelled = np.bincount(hops.edges[believed], minlength=len(road_map.edges))
    length = np.linalg.norm(np.diff(road_map.nodes[road_map.edges], axis=1)[:, 0], axis=1)
    spacing = sample_spacings(length, hops.edges[believed], hops.seconds[believed], sampling)
    lines = _extract_skeleton(road_map, travelled, spacing, resolution)
    routes = travels.match_edges(road_map, lines, spacing, resolution)
    if lines.positions.shape[1] == 2 and len(lines.links):
        lines = smooth_skeleton(
            move_to_centrelines(
                road_map, travelled.astype(np.float64), spacing, lines, routes, resolution
            ),
            _SMOOTHING_PASSES,
        )
    lines, routes = _drop_rare_chains(road_map, lines, routes, max(min_traversals, 1))
    trusted = replace(hops, seconds=np.where(believed, hops.seconds, np.nan))
    return _assemble_map(road_map, trusted, lines, routes, resolution)


def _find_plausible(road_map: RoadMap, hops: travels.Traversals) -> NDArray[np.bool_]:
    """Which moves were no jumps."""
    if not len(hops.edges) or np.isnan(hops.seconds).any():
        return np.ones(len(hops.edges), np.bool_)
    ends = road_map.nodes[road_map.edges[hops.edges]]
    speed = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / hops.seconds
    slow: NDArray[np.bool_] = speed <= _OUTLIER_FACTOR * np.quantile(speed, 0.95)
    return slow


def _extract_skeleton(
    road_map: RoadMap, travelled: NDArray[np.int64], spacing: NDArray[np.float64], scale: float
) -> Skeleton:
    flat, kept = road_map.nodes[:, :2], np.flatnonzero(travelled)
    if flat.shape[1] < 2 or not len(kept):
        return Skeleton(flat, road_map.edges[kept])
    ground = bundle_edges(
        flat, road_map.edges[kept], travelled[kept].astype(np.float64), spacing[kept], scale
    )
    lines = build_skeleton(ground.grid, ground.density, math.pi * (_HOLE * scale) ** 2)
    lines = consolidate_junctions(prune_spurs(lines, _SPUR * scale), _JUNCTION * scale)
    return smooth_skeleton(prune_spurs(lines, _SPUR * scale), _SMOOTHING_PASSES)


def _drop_rare_chains(
    road_map: RoadMap, lines: Skeleton, routes: travels.EdgePaths, least: int
) -> tuple[Skeleton, travels.EdgePaths]:
    """Leave out the strings that were travelled less often."""
    strings = build_chains(lines)
    rare = travels.count_chain_traversals(road_map, lines, strings, routes).sum(axis=0) < least
    kept = np.ones(len(lines.links), np.bool_)
    kept[strings.links[rare[strings.owner]]] = False
    steps = kept[routes.links]
    offsets = np.append(0, np.cumsum(steps))[routes.offsets]
    number = np.cumsum(kept) - 1
    routes = replace(
        routes,
        offsets=offsets,
        links=number[routes.links[steps]],
        is_forward=routes.is_forward[steps],
    )
    return Skeleton(lines.positions, lines.links[kept]), routes


def _assemble_map(
    road_map: RoadMap,
    hops: travels.Traversals,
    lines: Skeleton,
    routes: travels.EdgePaths,
    scale: float,
) -> CleanMap:
    strings = build_chains(lines)
    forward, backward = travels.count_chain_traversals(road_map, lines, strings, routes)
    offsets, vertices = simplify_chains(lines, strings, _SHAPE_TOLERANCE * scale)
    junctions, ends = np.unique(strings.ends, return_inverse=True)
    places = travels.add_heights(road_map, lines, routes)
    return CleanMap(
        junctions=places[junctions],
        ends=ends.reshape(-1, 2).astype(np.int32),
        offsets=offsets,
        points=places[vertices],
        length=strings.lengths(lines),
        forward=forward,
        backward=backward,
        speed=travels.chain_speeds(road_map, hops, lines, strings, routes),
        hourly=travels.chain_speeds_by_daytime(road_map, hops, lines, strings, routes, _DAYTIMES),
        width=travels.chain_widths(road_map, hops, lines, strings, routes),
        plane=road_map.plane,
    )
