"""A clean map from an archive: one edge for each street, between shared junctions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.model import RoadMap, Walk
from gpszip.model.clean_map import CleanMap
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
from gpszip.simplification.traversals import (
    EdgePaths,
    Traversals,
    add_heights,
    chain_speeds,
    chain_speeds_by_daytime,
    chain_widths,
    count_chain_traversals,
    list_traversals,
    match_edges,
)

__all__ = ["clean_map"]

#: Length below which a dead end is noise, in scales.
_SPUR = 4.0

#: Distance below which two junctions are merged, in scales.
_JUNCTION = 1.5

#: Radius of the largest hole that is filled, in scales.
_HOLE = 2.0

#: Smoothing passes; this many remove the steps of the grid.
_SMOOTHING_PASSES = 4

#: A traversal this many times as fast as the 95 % quantile is an outlier of the receiver.
_OUTLIER_FACTOR = 4.0

#: Quantile of speeds that outliers are compared with.
_FAST_QUANTILE = 0.95

#: Number of intervals of the day in which speeds are reported.
_DAYTIMES = 4

#: Tolerance of line simplification, in scales.
_SHAPE_TOLERANCE = 0.1


def clean_map(
    road_map: RoadMap,
    walks: Sequence[Walk],
    resolution: float,
    *,
    sampling: float | None = None,
    min_traversals: int = 1,
) -> CleanMap:
    """Merge all travel along the same street to one edge.

    1. Edges of the road map are bundled: they attract each other and follow common courses instead
       of cutting corners (:mod:`gpszip.simplification.bundling`).
    2. Their density is thinned to a skeleton. Spurs and holes of noise are removed, and junctions
       nearby consolidated.
    3. Every edge is matched to the skeleton, whose vertices move to centrelines.
    4. The traversals of the walks give counts, speeds and widths.

    Parameters
    ----------
    road_map : RoadMap
        Map of an archive. The clean map follows its first two axes and keeps the height of its
        nodes; positions on a line (d = 1) don't move.
    walks : sequence of Walk
        All walks on it.
    resolution : float
        Spatial step of the archive in metres, which is the scale of bundling. It grows with the
        permitted error.
    sampling : float, optional
        Seconds between two samples of the log; by default estimated from the walks.
    min_traversals : int, default 1
        Omit edges with fewer traversals, both directions together.

    Returns
    -------
    CleanMap
        Deterministic; empty if the walks have no travel.

    Examples
    --------
    >>> from gpszip.walks.counting import build_road_map
    >>> nodes = np.array([[0.0, 0], [50, 1], [100, 0], [50, -1]])
    >>> times, gaps = np.array([0.0, 5, 10]), np.zeros(2, bool)
    >>> walks = [Walk(str(i), np.array([0, 1 + 2 * (i % 2), 2]), times, gaps) for i in range(4)]
    >>> streets = clean_map(build_road_map(nodes, walks), walks, 2.0)
    >>> streets.forward.tolist(), streets.backward.tolist(), np.round(streets.speed).tolist()
    ([4], [0], [[10.0, 10.0, 10.0]])
    """
    # Count the plausible traversals of each edge, and bound its unobserved length.
    traversals = list_traversals(road_map, walks)
    is_plausible = _find_plausible(road_map, traversals)
    edges, seconds = traversals.edges[is_plausible], traversals.seconds[is_plausible]
    counts = np.bincount(edges, minlength=len(road_map.edges))
    length = np.linalg.norm(np.diff(road_map.nodes[road_map.edges], axis=1)[:, 0], axis=1)
    spacing = sample_spacings(length, edges, seconds, sampling)

    # Extract the skeleton, and match the edges to it.
    skeleton, scale = _extract_skeleton(road_map, counts, spacing, resolution)
    paths = match_edges(road_map, skeleton, spacing, scale)

    # Move its vertices to the middle of travel.
    if skeleton.positions.shape[1] == 2 and len(skeleton.links):
        centred = move_to_centrelines(
            road_map, counts.astype(np.float64), spacing, skeleton, paths, scale
        )
        skeleton = smooth_skeleton(centred, _SMOOTHING_PASSES)

    # Transfer what is known of the traversals; outliers keep their count, but not their speed.
    skeleton, paths = _drop_rare_chains(road_map, skeleton, paths, max(min_traversals, 1))
    plausible = replace(traversals, seconds=np.where(is_plausible, traversals.seconds, np.nan))
    return _assemble_map(road_map, plausible, skeleton, paths, scale)


def _find_plausible(road_map: RoadMap, traversals: Traversals) -> NDArray[np.bool_]:
    """Which traversals are no outliers by their speed."""
    if not len(traversals.edges) or np.isnan(traversals.seconds).any():
        return np.ones(len(traversals.edges), np.bool_)
    ends = road_map.nodes[road_map.edges[traversals.edges]]
    speed = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / traversals.seconds
    plausible: NDArray[np.bool_] = speed <= _OUTLIER_FACTOR * np.quantile(speed, _FAST_QUANTILE)
    return plausible


def _extract_skeleton(
    road_map: RoadMap, counts: NDArray[np.int64], spacing: NDArray[np.float64], scale: float
) -> tuple[Skeleton, float]:
    """Bundle the travelled edges and thin their density; on a line, the edges themselves.

    Also return the scale, which is no finer than the cells: nothing can be matched to less.
    """
    positions, kept = road_map.nodes[:, :2], np.flatnonzero(counts)
    if positions.shape[1] < 2 or not len(kept):
        return Skeleton(positions, road_map.edges[kept]), scale

    bundles = bundle_edges(
        positions, road_map.edges[kept], counts[kept].astype(np.float64), spacing[kept], scale
    )
    scale = max(scale, bundles.grid.size)
    skeleton = build_skeleton(bundles.grid, bundles.density, math.pi * (_HOLE * scale) ** 2)

    # Consolidation may turn chains into dead ends, so spurs are pruned twice.
    skeleton = consolidate_junctions(prune_spurs(skeleton, _SPUR * scale), _JUNCTION * scale)
    return smooth_skeleton(prune_spurs(skeleton, _SPUR * scale), _SMOOTHING_PASSES), scale


def _drop_rare_chains(
    road_map: RoadMap, skeleton: Skeleton, paths: EdgePaths, min_traversals: int
) -> tuple[Skeleton, EdgePaths]:
    """Remove the chains with too few traversals from the skeleton and from the paths on it."""
    # Find the links of chains with too few traversals, both directions added up.
    chains = build_chains(skeleton)
    counts = count_chain_traversals(road_map, skeleton, chains, paths).sum(axis=0)
    is_rare = counts < min_traversals
    kept = np.ones(len(skeleton.links), np.bool_)
    kept[chains.links[is_rare[chains.owner]]] = False

    # Renumber the links in the paths.
    is_kept_link = kept[paths.links]
    number = np.cumsum(kept) - 1
    paths = replace(
        paths,
        offsets=np.append(0, np.cumsum(is_kept_link))[paths.offsets],
        links=number[paths.links[is_kept_link]],
        is_forward=paths.is_forward[is_kept_link],
    )
    return Skeleton(skeleton.positions, skeleton.links[kept]), paths


def _assemble_map(
    road_map: RoadMap,
    traversals: Traversals,
    skeleton: Skeleton,
    paths: EdgePaths,
    scale: float,
) -> CleanMap:
    """Turn the chains of the skeleton into the edges of a clean map."""
    # Junctions and shapes.
    chains = build_chains(skeleton)
    offsets, vertices = simplify_chains(skeleton, chains, _SHAPE_TOLERANCE * scale)
    junctions, ends = np.unique(chains.ends, return_inverse=True)
    positions = add_heights(road_map, skeleton, paths)

    # Counts, speeds and widths.
    forward, backward = count_chain_traversals(road_map, skeleton, chains, paths)
    travel = (road_map, traversals, skeleton, chains, paths)
    return CleanMap(
        junctions=positions[junctions],
        ends=ends.reshape(-1, 2).astype(np.int32),
        offsets=offsets,
        points=positions[vertices],
        length=chains.lengths(skeleton),
        forward=forward,
        backward=backward,
        speed=chain_speeds(*travel),
        hourly=chain_speeds_by_daytime(*travel, _DAYTIMES),
        width=chain_widths(*travel),
        plane=road_map.plane,
    )
