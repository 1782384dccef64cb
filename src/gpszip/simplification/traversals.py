"""Traversals of the clean map's edges: how often, how fast, when, and how far off the centreline.

Walks traverse edges of the road map. :func:`match_edges` finds the path of each of these edges on
the skeleton; the other functions transfer counts, speeds, widths and heights along these paths to
the chains of the skeleton, which become the edges of the clean map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from gpszip.model import RoadMap, Walk
from gpszip.simplification.corridors import corridor_bounds
from gpszip.simplification.skeleton import Chains, Skeleton
from gpszip.walks.counting import find_travelled_segments

__all__ = [
    "EdgePaths",
    "Traversals",
    "add_heights",
    "chain_speeds",
    "chain_speeds_by_daytime",
    "chain_widths",
    "count_chain_traversals",
    "grouped_quantiles",
    "list_traversals",
    "match_edges",
]

#: Start of 1980 in seconds since 1970. Smaller times don't count from 1970: no log is as old.
_EARLIEST = 315_532_800.0

#: Seconds in a day.
_DAY = 86_400.0

#: Longest path between two samples, as a multiple of their distance.
_DETOUR = 1.5

#: Error of samples and of the skeleton, in scales.
_MARGIN = 6.0

#: Largest distance between a node and the skeleton vertex that it is matched to, in scales.
_MAX_NODE_DISTANCE = 4

#: Quantiles of speeds.
_QUARTILES = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class Traversals:
    """Traversals of road map edges by all walks, without stops and gaps.

    Parameters
    ----------
    edges : int32 array, shape (t,)
        Edge of the road map of each traversal.
    seconds : float64 array, shape (t,)
        Duration; NaN for walks without times.
    times : float64 array, shape (t,)
        Middle of the traversal in seconds, in the log's own zero.
    """

    edges: NDArray[np.int32]
    seconds: NDArray[np.float64]
    times: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgePaths:
    """Paths of the road map's edges on a skeleton.

    Parameters
    ----------
    vertices : int32 array, shape (V,)
        Vertex of each node of the road map; -1 if none is near.
    offsets : int64 array, shape (E + 1,)
        Edge e takes the links ``links[offsets[e]:offsets[e + 1]]``; none if it is not matched.
    links : int32 array, shape (s,)
        Numbers of the skeleton's links.
    is_forward : bool array, shape (s,)
        Whether the path passes each link from its first vertex to its second.
    """

    vertices: NDArray[np.int32]
    offsets: NDArray[np.int64]
    links: NDArray[np.int32]
    is_forward: NDArray[np.bool_]

    @property
    def owner(self) -> NDArray[np.int64]:
        """Edge of each entry of ``links``."""
        return np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))


def list_traversals(road_map: RoadMap, walks: Sequence[Walk]) -> Traversals:
    """List the traversals of all walks, in their order."""
    # Nodes and times of each travelled segment.
    ends, times = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2))]
    for walk in walks:
        travelled = find_travelled_segments(walk)
        clock = np.full(len(walk.nodes), np.nan) if walk.times is None else walk.times
        pairs = np.stack((walk.nodes[:-1], walk.nodes[1:]), axis=1)
        ends.append(pairs[travelled].astype(np.int64))
        times.append(np.stack((clock[:-1], clock[1:]), axis=1)[travelled])

    # The edges of a road map are sorted, so a binary search finds those of the pairs.
    pairs, clocks = np.sort(np.concatenate(ends), axis=1), np.concatenate(times)
    count = len(road_map.nodes)
    edge = np.searchsorted(_pair_keys(road_map.edges, count), pairs[:, 0] * count + pairs[:, 1])
    return Traversals(edge.astype(np.int32), clocks[:, 1] - clocks[:, 0], clocks.mean(axis=1))


def match_edges(
    road_map: RoadMap, skeleton: Skeleton, spacing: NDArray[np.float64], scale: float
) -> EdgePaths:
    """Find the shortest path on the skeleton for each edge of the road map.

    Parameters
    ----------
    road_map : RoadMap
        The map, of which the first two axes count.
    skeleton : Skeleton
        The lines to match edges to.
    spacing : float64 array, shape (E,)
        Unobserved length of each edge in metres.
    scale : float
        Metres. Nodes more than 4 scales off the skeleton are not matched.
    """
    from gpszip.simplification.kernels.routes import cheapest_paths

    # On a line, the skeleton has edges of the map itself; without links, no edge has a path.
    if skeleton.positions.shape[1] < 2 or not len(skeleton.links):
        return _identity_paths(road_map, skeleton)

    # Match the nodes to their nearest vertices.
    distance, nearest = cKDTree(skeleton.positions).query(
        road_map.nodes[:, :2], distance_upper_bound=_MAX_NODE_DISTANCE * scale
    )
    vertices = np.where(np.isfinite(distance), nearest, -1).astype(np.int32)
    start, end = vertices[road_map.edges[:, 0]], vertices[road_map.edges[:, 1]]
    matched = np.flatnonzero((start >= 0) & (end >= 0))

    # Find the shortest paths between them.
    price = np.ones(len(skeleton.positions))
    first, last = start[matched], end[matched]
    distance = np.linalg.norm(skeleton.positions[last] - skeleton.positions[first], axis=1)
    bounds = corridor_bounds(distance, spacing[matched], _DETOUR, _MARGIN * scale)
    offsets, visited = cheapest_paths(
        skeleton.positions, _neighbour_table(skeleton), price, first, last, *bounds
    )

    # Turn visited vertices into links; the pair across the end of a path and the next is none.
    counts = np.zeros(len(road_map.edges), np.int64)
    counts[matched] = np.maximum(np.diff(offsets) - 1, 0)
    pairs = np.stack((visited[:-1], visited[1:]), axis=1).astype(np.int64)
    inner = offsets[1:-1]
    pairs = np.delete(pairs, inner[(inner > 0) & (inner < len(visited))] - 1, axis=0)
    size = len(skeleton.positions)
    keys = pairs.min(axis=1) * size + pairs.max(axis=1)
    links = np.searchsorted(_pair_keys(skeleton.links, size), keys).astype(np.int32)
    return EdgePaths(vertices, np.append(0, np.cumsum(counts)), links, pairs[:, 0] < pairs[:, 1])


def count_chain_traversals(
    road_map: RoadMap, skeleton: Skeleton, chains: Chains, paths: EdgePaths
) -> NDArray[np.int64]:
    """Traversals of each chain along it and against it, shape (2, c).

    The count of a chain is the (upper) median over its links.
    """
    # Count the traversals of each link along it and against it.
    edge = paths.owner
    forward, backward = road_map.forward[edge], road_map.backward[edge]
    counts = np.zeros((2, len(skeleton.links)), np.int64)
    np.add.at(counts[0], paths.links, np.where(paths.is_forward, forward, backward))
    np.add.at(counts[1], paths.links, np.where(paths.is_forward, backward, forward))

    # Turn them into the direction of the chain, and take the median of each.
    in_chains = np.where(chains.is_forward, counts[:, chains.links], counts[::-1, chains.links])
    middle = (chains.offsets[:-1] + chains.offsets[1:]) // 2
    owner = chains.owner
    medians = [row[np.lexsort((row, owner))][middle] for row in in_chains]
    return np.array(medians, dtype=np.int64).reshape(2, len(chains))


def chain_speeds(
    road_map: RoadMap,
    traversals: Traversals,
    skeleton: Skeleton,
    chains: Chains,
    paths: EdgePaths,
) -> NDArray[np.float64]:
    """Quartiles of the speed on each chain in m/s, shape (c, 3), weighted by metres travelled.

    They are lower quartile, median and upper quartile; NaN without any duration.
    """
    observed = _chain_observations(road_map, traversals, skeleton, chains, paths)
    return grouped_quantiles(
        observed.chains, observed.speeds, observed.metres, len(chains), _QUARTILES
    )


def chain_speeds_by_daytime(
    road_map: RoadMap,
    traversals: Traversals,
    skeleton: Skeleton,
    chains: Chains,
    paths: EdgePaths,
    intervals: int,
) -> NDArray[np.float64]:
    """Median speed on each chain in m/s in equal intervals of the day (UTC).

    Returns
    -------
    float64 array, shape (c, intervals)
        NaN without travel; shape (c, 0) if times don't count from 1970.
    """
    if not len(traversals.times) or not traversals.times.min() > _EARLIEST:
        return np.zeros((len(chains), 0))

    observed = _chain_observations(road_map, traversals, skeleton, chains, paths)
    interval = (observed.times % _DAY / _DAY * intervals).astype(np.int64)
    medians = grouped_quantiles(
        observed.chains * intervals + interval,
        observed.speeds,
        observed.metres,
        len(chains) * intervals,
        (0.5,),
    )
    return medians.reshape(-1, intervals)


def chain_widths(
    road_map: RoadMap,
    traversals: Traversals,
    skeleton: Skeleton,
    chains: Chains,
    paths: EdgePaths,
) -> NDArray[np.float64]:
    """Root mean square distance in metres between each chain and the knots on it, shape (c,).

    NaN for chains without knots.
    """
    # Choose the nodes with knots whose vertex is on a chain.
    if not len(chains):
        return np.zeros(0)
    visits = np.bincount(road_map.edges[traversals.edges].ravel(), minlength=len(road_map.nodes))
    is_known = (paths.vertices >= 0) & (skeleton.degrees[paths.vertices] > 0) & (visits > 0)
    known = np.flatnonzero(is_known)

    # Measure the distance of each node from a link at its vertex.
    link = _link_at_vertex(skeleton, chains)[paths.vertices[known]]
    distance = _distance_from_line(road_map.nodes[known, :2], skeleton, link)

    # Average over the visits of each chain.
    owner = _chain_of_link(skeleton, chains)
    weight = np.bincount(owner[link], weights=visits[known], minlength=len(chains))
    total = np.bincount(owner[link], weights=visits[known] * distance**2, minlength=len(chains))
    with np.errstate(invalid="ignore", divide="ignore"):
        root: NDArray[np.float64] = np.sqrt(total / weight)
    return root


def grouped_quantiles(
    group: NDArray[np.int64],
    values: NDArray[np.float64],
    weights: NDArray[np.float64],
    count: int,
    fractions: ArrayLike,
) -> NDArray[np.float64]:
    """Weighted quantiles of values in groups.

    Parameters
    ----------
    group : int64 array, shape (n,)
        Group of each value, below ``count``.
    values, weights : float64 arrays, shape (n,)
        The values and their weights.
    count : int
        Number of groups.
    fractions : array_like, shape (q,)
        Quantiles in [0, 1].

    Returns
    -------
    float64 array, shape (count, q)
        NaN for empty groups.

    Examples
    --------
    >>> group, values = np.array([0, 0, 0, 2]), np.array([3.0, 1, 2, 9])
    >>> grouped_quantiles(group, values, np.ones(4), 3, [0.5]).ravel().tolist()
    [2.0, nan, 9.0]
    """
    # Sort by group and value.
    wanted = np.atleast_1d(np.asarray(fractions, dtype=np.float64))
    order = np.lexsort((values, group))
    group, values, weights = group[order], values[order], weights[order]
    first = np.searchsorted(group, np.arange(count))
    last = np.searchsorted(group, np.arange(count), side="right")

    # Find where the cumulative weight reaches each fraction of the group's weight.
    cumulative = np.append(0.0, np.cumsum(weights))
    target = cumulative[first, None] + wanted * (cumulative[last] - cumulative[first])[:, None]
    index = np.clip(
        np.searchsorted(cumulative, target, side="left") - 1,
        first[:, None],
        np.maximum(last - 1, first)[:, None],
    )
    return np.where((last > first)[:, None], np.append(values, np.nan)[index], np.nan)


def add_heights(road_map: RoadMap, skeleton: Skeleton, paths: EdgePaths) -> NDArray[np.float64]:
    """Vertices with all axes of the road map, shape (n, d).

    The third axis and more are interpolated between the nodes of the matched edges, weighted by
    traversals. Vertices without an edge take them from the nearest node.
    """
    # A map without a third axis has no heights.
    if road_map.nodes.shape[1] <= skeleton.positions.shape[1]:
        return skeleton.positions

    # Fraction of its edge at the middle of each link.
    edge, (low, high) = paths.owner, road_map.edges[paths.owner].T
    metres = skeleton.lengths[paths.links]
    cumulative = np.cumsum(metres)
    start = np.append(0.0, cumulative)[paths.offsets[edge]]
    length = np.append(0.0, cumulative)[paths.offsets[edge + 1]] - start
    fraction = (cumulative - 0.5 * metres - start) / np.maximum(length, 1e-12)

    # Average over the links at each vertex.
    counts = (road_map.forward + road_map.backward)[edge]
    nearest = cKDTree(road_map.nodes[:, :2]).query(skeleton.positions)[1]
    heights = []
    for axis in road_map.nodes[:, 2:].T:
        level = counts * ((1 - fraction) * axis[low] + fraction * axis[high])
        total, weight = np.zeros(len(skeleton.positions)), np.zeros(len(skeleton.positions))
        for vertex in skeleton.links[paths.links].T:
            total += np.bincount(vertex, weights=level, minlength=len(total))
            weight += np.bincount(vertex, weights=counts, minlength=len(total))
        heights.append(np.where(weight > 0, total / np.maximum(weight, 1), axis[nearest]))
    return np.column_stack([skeleton.positions, *heights])


class _ChainObservations(NamedTuple):
    """Travel on a chain within one traversal of an edge, with a duration."""

    chains: NDArray[np.int64]
    speeds: NDArray[np.float64]  # m/s
    metres: NDArray[np.float64]
    times: NDArray[np.float64]  # seconds in the log's own zero


def _chain_observations(
    road_map: RoadMap,
    traversals: Traversals,
    skeleton: Skeleton,
    chains: Chains,
    paths: EdgePaths,
) -> _ChainObservations:
    """Split the traversals of edges by the chains that their paths take."""
    # Metres of each edge on each chain, sorted by edge.
    owner = _chain_of_link(skeleton, chains)
    link_lengths = skeleton.lengths[paths.links]
    edges, chain_count = len(paths.offsets) - 1, max(len(chains), 1)
    keys, index = np.unique(paths.owner * chain_count + owner[paths.links], return_inverse=True)
    metres = np.bincount(index, weights=link_lengths, minlength=len(keys))
    edge, chain = np.divmod(keys, chain_count)

    # Length of each edge. Its ends may have moved inwards, but travel is no shorter than straight.
    straight = np.linalg.norm(
        road_map.nodes[road_map.edges[:, 1]] - road_map.nodes[road_map.edges[:, 0]], axis=1
    )
    length = np.maximum(np.bincount(edge, weights=metres, minlength=edges), straight)

    # Repeat each traversal for the chains of its edge.
    first, number = np.searchsorted(edge, np.arange(edges)), np.bincount(edge, minlength=edges)
    timed = np.flatnonzero(traversals.seconds > 0)
    repeats = number[traversals.edges[timed]]
    traversal = np.repeat(timed, repeats)
    position = np.arange(len(traversal)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    entry = position + first[traversals.edges[traversal]]

    # Speeds are those of the entire edge; metres are those on the chain.
    return _ChainObservations(
        chain[entry],
        length[traversals.edges[traversal]] / traversals.seconds[traversal],
        metres[entry],
        traversals.times[traversal],
    )


def _identity_paths(road_map: RoadMap, skeleton: Skeleton) -> EdgePaths:
    """Paths of edges on a skeleton that consists of some of these edges."""
    size = len(road_map.nodes)
    kept = np.isin(_pair_keys(road_map.edges, size), _pair_keys(skeleton.links, size))
    links = np.arange(int(kept.sum()), dtype=np.int32)
    return EdgePaths(
        np.arange(size, dtype=np.int32),
        np.append(0, np.cumsum(kept)),
        links,
        np.ones(len(links), np.bool_),
    )


def _pair_keys(pairs: NDArray[np.int32], count: int) -> NDArray[np.int64]:
    """One number for each pair of numbers below ``count``, sorted like the pairs."""
    keys: NDArray[np.int64] = pairs[:, 0].astype(np.int64) * count + pairs[:, 1]
    return keys


def _neighbour_table(skeleton: Skeleton) -> NDArray[np.int32]:
    """Neighbours of each vertex, filled up with -1, shape (n, largest degree)."""
    # List each link in both directions, sorted.
    start = np.concatenate([skeleton.links[:, 0], skeleton.links[:, 1]])
    end = np.concatenate([skeleton.links[:, 1], skeleton.links[:, 0]])
    order = np.lexsort((end, start))
    start, end = start[order], end[order]

    column = np.arange(len(start)) - np.searchsorted(start, start)
    shape = (len(skeleton.positions), int(column.max(initial=0)) + 1)
    table = np.full(shape, -1, np.int32)
    table[start, column] = end
    return table


def _chain_of_link(skeleton: Skeleton, chains: Chains) -> NDArray[np.int64]:
    """Chain of each link of the skeleton."""
    owner = np.empty(len(skeleton.links), np.int64)
    owner[chains.links] = chains.owner
    return owner


def _link_at_vertex(skeleton: Skeleton, chains: Chains) -> NDArray[np.int64]:
    """A link at each vertex; at junctions, one of the longest chain."""
    # Later assignments overwrite earlier ones, so the longest chain comes last.
    length = chains.lengths(skeleton)
    order = chains.links[np.argsort(length[chains.owner], kind="stable")]
    link = np.zeros(len(skeleton.positions), np.int64)
    for side in range(2):
        link[skeleton.links[order, side]] = order
    return link


def _distance_from_line(
    points: NDArray[np.float64], skeleton: Skeleton, links: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Distance of each point from the infinite line through a link."""
    if points.shape[1] < 2:
        return np.zeros(len(points))
    start = skeleton.positions[skeleton.links[links, 0]]
    end = skeleton.positions[skeleton.links[links, 1]]
    along, offset = end - start, points - start
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    cross = along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]
    distance: NDArray[np.float64] = np.abs(cross) / length
    return distance
