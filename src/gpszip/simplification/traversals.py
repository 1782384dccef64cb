"""What walks tell of the ways that they took: how often, how fast, when, and how far beside the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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

#: Times below this, in seconds, don't count from 1970: nobody logged positions before 1980.
_EARLIEST = 315_532_800.0

_DAY = 86_400.0

#: A way between two samples may be this much longer than the straight line; samples and lines err by so many scales.
_DETOUR, _MARGIN = 1.5, 6.0


@dataclass(frozen=True, eq=False)
class Traversals:
    """Moves of all walks from a node to another, without stops and gaps.

    Parameters
    ----------
    edges : int32 array, shape (h,)
        Edge of the road map that each took.
    seconds : float64 array, shape (h,)
        How long; NaN where no times are kept.
    times : float64 array, shape (h,)
        When, in the middle of the move, in the log's own zero.
    """

    edges: NDArray[np.int32]
    seconds: NDArray[np.float64]
    times: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EdgePaths:
    """Ways of the road map's edges over a line graph.

    Parameters
    ----------
    at : int32 array, shape (V,)
        Vertex of each node of the road map; -1 where none is near.
    offsets : int64 array, shape (E + 1,)
        Edge e takes the steps ``offsets[e]:offsets[e + 1]``; none where it is not matched.
    links : int32 array, shape (s,)
        Pairs of the line graph.
    is_forward : bool array, shape (s,)
        Whether the pair is taken from its first to its second vertex when the edge is.
    """

    at: NDArray[np.int32]
    offsets: NDArray[np.int64]
    links: NDArray[np.int32]
    is_forward: NDArray[np.bool_]

    @property
    def owner(self) -> NDArray[np.int64]:
        """Edge of each step."""
        return np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))


def list_traversals(road_map: RoadMap, walks: Sequence[Walk]) -> Traversals:
    """List the moves of all walks, in their order."""
    ends, times = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2))]
    for walk in walks:
        moved = find_travelled_segments(walk)
        clock = np.full(len(walk.nodes), np.nan) if walk.times is None else walk.times
        ends.append(np.stack((walk.nodes[:-1], walk.nodes[1:]), axis=1)[moved].astype(np.int64))
        times.append(np.stack((clock[:-1], clock[1:]), axis=1)[moved])
    pairs, clocks = np.sort(np.concatenate(ends), axis=1), np.concatenate(times)
    size = len(road_map.nodes)
    keys = road_map.edges[:, 0].astype(np.int64) * size + road_map.edges[:, 1]
    found = np.searchsorted(keys, pairs[:, 0] * size + pairs[:, 1]).astype(np.int32)
    return Traversals(found, clocks[:, 1] - clocks[:, 0], clocks.mean(axis=1))


def match_edges(
    road_map: RoadMap, lines: Skeleton, spacing: NDArray[np.float64], scale: float
) -> EdgePaths:
    """Find the shortest way over the lines for each edge of the road map.

    Parameters
    ----------
    road_map : RoadMap
        Of whose nodes the first two axes count.
    lines : LineGraph
        Where the edges shall go.
    spacing : float64 array, shape (E,)
        Metres of each edge that may have been travelled unseen.
    scale : float
        Metres; nodes farther than 4 of them from the lines are not matched.
    """
    from gpszip.simplification.kernels.routes import cheapest_paths

    if lines.positions.shape[1] < 2 or not len(lines.links):
        return _identity_paths(road_map, lines)
    away, nearest = cKDTree(lines.positions).query(
        road_map.nodes[:, :2], distance_upper_bound=4 * scale
    )
    at = np.where(np.isfinite(away), nearest, -1).astype(np.int32)
    start, end = at[road_map.edges[:, 0]], at[road_map.edges[:, 1]]
    matched = np.flatnonzero((start >= 0) & (end >= 0))
    price = np.ones(len(lines.positions))
    first, last = start[matched], end[matched]
    apart = np.linalg.norm(lines.positions[last] - lines.positions[first], axis=1)
    bounds = corridor_bounds(apart, spacing[matched], _DETOUR, _MARGIN * scale)
    offsets, nodes = cheapest_paths(
        lines.positions, _neighbour_table(lines), price, first, last, *bounds
    )
    stops = np.zeros(len(road_map.edges), np.int64)
    stops[matched] = np.maximum(np.diff(offsets) - 1, 0)
    hop = np.stack((nodes[:-1], nodes[1:]), axis=1).astype(np.int64)
    hop = np.delete(
        hop, offsets[1:-1][(offsets[1:-1] > 0) & (offsets[1:-1] < len(nodes))] - 1, axis=0
    )
    keys = lines.links[:, 0].astype(np.int64) * len(lines.positions) + lines.links[:, 1]
    steps = np.searchsorted(keys, hop.min(axis=1) * len(lines.positions) + hop.max(axis=1)).astype(
        np.int32
    )
    return EdgePaths(at, np.append(0, np.cumsum(stops)), steps, hop[:, 0] < hop[:, 1])


def count_chain_traversals(
    road_map: RoadMap, lines: Skeleton, strings: Chains, routes: EdgePaths
) -> NDArray[np.int64]:
    """Traversals of each string, along it and against it, shape (2, w): as often as half of it was travelled, at least."""
    edge = routes.owner
    ahead, back = road_map.forward[edge], road_map.backward[edge]
    taken = np.zeros((2, len(lines.links)), np.int64)
    np.add.at(taken[0], routes.links, np.where(routes.is_forward, ahead, back))
    np.add.at(taken[1], routes.links, np.where(routes.is_forward, back, ahead))
    ordered = np.where(strings.is_forward, taken[:, strings.links], taken[::-1, strings.links])
    middle = (strings.offsets[:-1] + strings.offsets[1:]) // 2
    owner = strings.owner
    found = [one[np.lexsort((one, owner))][middle] for one in ordered]
    return np.array(found, dtype=np.int64).reshape(2, len(strings))


def chain_speeds(
    road_map: RoadMap, hops: Traversals, lines: Skeleton, strings: Chains, routes: EdgePaths
) -> NDArray[np.float64]:
    """Lower quartile, median and upper quartile in m/s of the speed on each string, over metres travelled; shape (w, 3)."""
    string, speed, metres, _ = _chain_observations(road_map, hops, lines, strings, routes)
    return grouped_quantiles(string, speed, metres, len(strings), (0.25, 0.5, 0.75))


def chain_speeds_by_daytime(
    road_map: RoadMap,
    hops: Traversals,
    lines: Skeleton,
    strings: Chains,
    routes: EdgePaths,
    parts: int,
) -> NDArray[np.float64]:
    """Median speed in m/s on each string in equal parts of the day, shape (w, parts); no parts where times are not since 1970."""
    if not len(hops.times) or not hops.times.min() > _EARLIEST:
        return np.zeros((len(strings), 0))
    string, speed, metres, times = _chain_observations(road_map, hops, lines, strings, routes)
    part = (times % _DAY / _DAY * parts).astype(np.int64)
    return grouped_quantiles(
        string * parts + part, speed, metres, len(strings) * parts, (0.5,)
    ).reshape(-1, parts)


def chain_widths(
    road_map: RoadMap, hops: Traversals, lines: Skeleton, strings: Chains, routes: EdgePaths
) -> NDArray[np.float64]:
    """Root mean square distance between each string and the knots on it, in metres, shape (w,); NaN where there is none."""
    visits = np.bincount(road_map.edges[hops.edges].ravel(), minlength=len(road_map.nodes))
    known = np.flatnonzero((routes.at >= 0) & (lines.degrees[routes.at] > 0) & (visits > 0))
    if not len(strings):
        return np.zeros(0)
    # The nearest pair at the vertex nearest to the node.
    home = _link_at_vertex(lines, strings)[routes.at[known]]
    away = _distance_from_line(road_map.nodes[known, :2], lines, home)
    owner = np.empty(len(lines.links), np.int64)
    owner[strings.links] = strings.owner
    weight = np.bincount(owner[home], weights=visits[known], minlength=len(strings))
    total = np.bincount(owner[home], weights=visits[known] * away**2, minlength=len(strings))
    with np.errstate(invalid="ignore", divide="ignore"):
        root: NDArray[np.float64] = np.sqrt(total / weight)
    return root


def grouped_quantiles(
    group: NDArray[np.int64],
    values: NDArray[np.float64],
    weights: NDArray[np.float64],
    count: int,
    shares: ArrayLike,
) -> NDArray[np.float64]:
    """Weighted quantiles of values in groups numbered below ``count``; shape (count, q), NaN for empty groups.

    Examples
    --------
    >>> grouped_quantiles(np.array([0, 0, 0, 2]), np.array([3.0, 1, 2, 9]), np.ones(4), 3, [0.5]).ravel().tolist()
    [2.0, nan, 9.0]
    """
    wanted = np.atleast_1d(np.asarray(shares, dtype=np.float64))
    order = np.lexsort((values, group))
    group, values, weights = group[order], values[order], weights[order]
    first, last = (
        np.searchsorted(group, np.arange(count)),
        np.searchsorted(group, np.arange(count), side="right"),
    )
    heap = np.append(0.0, np.cumsum(weights))
    aim = heap[first, None] + wanted * (heap[last] - heap[first])[:, None]
    place = np.clip(
        np.searchsorted(heap, aim, side="left") - 1,
        first[:, None],
        np.maximum(last - 1, first)[:, None],
    )
    return np.where((last > first)[:, None], np.append(values, np.nan)[place], np.nan)


def add_heights(road_map: RoadMap, lines: Skeleton, routes: EdgePaths) -> NDArray[np.float64]:
    """Vertices with all axes of the road map: heights and more run evenly between the nodes of the edges matched; shape (n, d)."""
    if road_map.nodes.shape[1] <= lines.positions.shape[1]:
        return lines.positions
    edge, (low, high) = routes.owner, road_map.edges[routes.owner].T
    metres = lines.lengths[routes.links]
    run = np.cumsum(metres)
    before = np.append(0.0, run)[routes.offsets[edge]]
    share = (run - 0.5 * metres - before) / np.maximum(
        np.append(0.0, run)[routes.offsets[edge + 1]] - before, 1e-12
    )
    travels = (road_map.forward + road_map.backward)[edge]
    nearest = cKDTree(road_map.nodes[:, :2]).query(lines.positions)[1]
    heights = []
    for axis in road_map.nodes[:, 2:].T:
        level = travels * ((1 - share) * axis[low] + share * axis[high])
        total, weight = np.zeros(len(lines.positions)), np.zeros(len(lines.positions))
        for end in lines.links[routes.links].T:
            total += np.bincount(end, weights=level, minlength=len(total))
            weight += np.bincount(end, weights=travels, minlength=len(total))
        heights.append(np.where(weight > 0, total / np.maximum(weight, 1), axis[nearest]))
    return np.column_stack([lines.positions, *heights])


def _identity_paths(road_map: RoadMap, lines: Skeleton) -> EdgePaths:
    """Edges as their own routes, on lines that are some of them."""
    size = len(road_map.nodes)
    keys = road_map.edges[:, 0].astype(np.int64) * size + road_map.edges[:, 1]
    kept = np.isin(keys, lines.links[:, 0].astype(np.int64) * size + lines.links[:, 1])
    steps = np.arange(int(kept.sum()), dtype=np.int32)
    return EdgePaths(
        np.arange(size, dtype=np.int32),
        np.append(0, np.cumsum(kept)),
        steps,
        np.ones(len(steps), np.bool_),
    )


def _chain_observations(
    road_map: RoadMap, hops: Traversals, lines: Skeleton, strings: Chains, routes: EdgePaths
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """String, speed, metres and time of each stretch that a walk made of a string within one move."""
    owner = np.empty(len(lines.links), np.int64)
    owner[strings.links] = strings.owner
    metres = lines.lengths[routes.links]
    edges, strung = len(routes.offsets) - 1, max(len(strings), 1)
    keys, place = np.unique(routes.owner * strung + owner[routes.links], return_inverse=True)
    share = np.bincount(place, weights=metres, minlength=len(keys))
    edge, string = np.divmod(keys, strung)
    # Ends of routes are drawn in a little; nobody went less far than straight.
    straight = np.linalg.norm(
        road_map.nodes[road_map.edges[:, 1]] - road_map.nodes[road_map.edges[:, 0]], axis=1
    )
    whole = np.maximum(np.bincount(edge, weights=share, minlength=edges), straight)
    first, number = np.searchsorted(edge, np.arange(edges)), np.bincount(edge, minlength=edges)
    timed = np.flatnonzero(hops.seconds > 0)
    repeats = number[hops.edges[timed]]
    hop = np.repeat(timed, repeats)
    entry = (
        np.arange(len(hop))
        - np.repeat(np.cumsum(repeats) - repeats, repeats)
        + first[hops.edges[hop]]
    )
    return string[entry], whole[hops.edges[hop]] / hops.seconds[hop], share[entry], hops.times[hop]


def _neighbour_table(lines: Skeleton) -> NDArray[np.int32]:
    """Neighbours of each vertex, ending with -1, shape (n, most)."""
    start = np.concatenate([lines.links[:, 0], lines.links[:, 1]])
    end = np.concatenate([lines.links[:, 1], lines.links[:, 0]])
    order = np.lexsort((end, start))
    start, end = start[order], end[order]
    column = np.arange(len(start)) - np.searchsorted(start, start)
    near = np.full((len(lines.positions), int(column.max(initial=0)) + 1), -1, np.int32)
    near[start, column] = end
    return near


def _link_at_vertex(lines: Skeleton, strings: Chains) -> NDArray[np.int64]:
    """One pair at each vertex; at junctions one of the longest string."""
    length = strings.lengths(lines)
    order = strings.links[np.argsort(length[strings.owner], kind="stable")]
    pair = np.zeros(len(lines.positions), np.int64)
    for side in range(2):
        pair[lines.links[order, side]] = order
    return pair


def _distance_from_line(
    points: NDArray[np.float64], lines: Skeleton, pairs: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Distance of each point from the endless line through a pair."""
    start, end = lines.positions[lines.links[pairs, 0]], lines.positions[lines.links[pairs, 1]]
    along, offset = end - start, points - start
    if points.shape[1] < 2:
        return np.zeros(len(points))
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
    away: NDArray[np.float64] = (
        np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]) / length
    )
    return away
