"""Changes of a generated log's roads: closed for some time, or slower."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import Track, Walk
from gpszip.testing.log_with_truth import LogWithTruth, join_truth
from gpszip.testing.roads import positions_on

__all__ = ["close_road", "slow_road"]

Floats = NDArray[np.float64]


def close_road(
    log: LogWithTruth,
    road: int,
    *,
    since: float = -math.inf,
    until: float = math.inf,
    forward: bool | None = None,
) -> LogWithTruth:
    """Close a road of a generated log for some time.

    Every passage that would begin in that time takes the shortest other way from one end of the
    road to the other, at the same speed, and all that follows in the track comes later. Samples
    keep their times and their errors.

    Parameters
    ----------
    log : LogWithTruth
        Any generated log whose agents travel on its roads.
    road : int
        Edge of ``log.road_map``.
    since, until : float
        Seconds between which it is closed. A road that is closed until some time is new from then
        on.
    forward : bool, optional
        Close only this direction; by default both.

    Raises
    ------
    OptionError
        If there is no such road, or no other way.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> log = close_road(ring(4, laps=2), 0, since=0.0)
    >>> log.road_map.forward[0] + log.road_map.backward[0]
    np.int64(0)
    """
    # The other way, there and back.
    u, v = _ends(log, road)
    there = _other_way(log, u, v)
    ways = {(u, v): there, (v, u): there[::-1]}
    if forward is not None:
        del ways[(v, u) if forward else (u, v)]

    # Each track goes round, passage by passage.
    walks = []
    for walk in log.walks:
        assert walk.times is not None
        nodes, times = [int(walk.nodes[0])], [float(walk.times[0])]
        for before, after, seconds in zip(
            walk.nodes[:-1].tolist(),
            walk.nodes[1:].tolist(),
            np.diff(walk.times).tolist(),
            strict=True,
        ):
            way = ways.get((before, after))
            is_closed = way is not None and since <= times[-1] < until
            path = way if way is not None and is_closed else [before, after]
            lengths = _lengths(log, path)
            direct = _lengths(log, [before, after]).sum()
            pace = seconds / direct if direct else 0.0
            steps = lengths * pace if direct else np.array([seconds])
            times += (times[-1] + np.cumsum(steps)).tolist()
            nodes += path[1:]
        walks.append(_walk(walk, nodes, times))
    return _record(log, walks)


def slow_road(log: LogWithTruth, road: int, factor: float, *, since: float) -> LogWithTruth:
    """Make passages of a road take longer from some time on.

    Parameters
    ----------
    log : LogWithTruth
        Any generated log whose agents travel on its roads.
    road : int
        Edge of ``log.road_map``.
    factor : float
        By which passages take longer; below 1, they are faster.
    since : float
        Seconds.

    Raises
    ------
    OptionError
        If there is no such road.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> before = ring(4, laps=2)
    >>> after = slow_road(before, 0, 2.0, since=0.0)
    >>> bool(after.walks[0].times[-1] > before.walks[0].times[-1])
    True
    """
    ends = set(_ends(log, road))
    walks = []
    for walk in log.walks:
        # All that follows a passage comes later.
        assert walk.times is not None
        steps, now, times = np.diff(walk.times), float(walk.times[0]), [float(walk.times[0])]
        for before, after, seconds in zip(
            walk.nodes[:-1].tolist(), walk.nodes[1:].tolist(), steps.tolist(), strict=True
        ):
            is_slow = {before, after} == ends and now >= since
            now += seconds * factor if is_slow else seconds
            times.append(now)
        walks.append(_walk(walk, walk.nodes.tolist(), times))
    return _record(log, walks)


def _ends(log: LogWithTruth, road: int) -> tuple[int, int]:
    """Nodes of a road."""
    if not 0 <= road < len(log.road_map.edges):
        raise OptionError(
            f"the log has no road {road}", remedy=f"it has roads 0 to {len(log.road_map.edges) - 1}"
        )
    u, v = log.road_map.edges[road].tolist()
    return int(u), int(v)


def _other_way(log: LogWithTruth, u: int, v: int) -> list[int]:
    """Nodes of the shortest path from u to v without the road between them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    # All other roads.
    edges, nodes = log.road_map.edges, log.road_map.nodes
    kept = edges[~((edges == sorted((u, v))).all(axis=1))]
    length = np.linalg.norm(nodes[kept[:, 0]] - nodes[kept[:, 1]], axis=1)
    graph = coo_array((length, (kept[:, 0], kept[:, 1])), shape=(len(nodes), len(nodes)))
    _, found = dijkstra(graph.tocsr(), directed=False, indices=[u], return_predecessors=True)
    before = found[0]

    # From v back to u.
    path = [v]
    while path[-1] != u:
        if before[path[-1]] < 0:
            raise OptionError("no other way leads around this road", remedy="close another one")
        path.append(int(before[path[-1]]))
    return path[::-1]


def _lengths(log: LogWithTruth, path: list[int]) -> Floats:
    """Metres of each step of a path."""
    lengths: Floats = np.linalg.norm(np.diff(log.road_map.nodes[path], axis=0), axis=1)
    return lengths


def _walk(walk: Walk, nodes: list[int], times: list[float]) -> Walk:
    return Walk(
        walk.id,
        np.array(nodes, np.int32),
        np.array(times),
        np.zeros(len(nodes) - 1, np.bool_),
        walk.time_ranges,
    )


def _record(log: LogWithTruth, walks: list[Walk]) -> LogWithTruth:
    """Record other walks at the times and with the errors of a log."""
    tracks: list[Track] = []
    truths: list[Floats] = []
    for track, truth, walk in zip(log.tracks, log.positions, walks, strict=True):
        moved = positions_on(walk, log.road_map.nodes, track.times)
        tracks.append(replace(track, positions=moved + (track.positions - truth)))
        truths.append(moved)
    return join_truth(tracks, truths, log.road_map.nodes, log.road_map.edges, walks)
