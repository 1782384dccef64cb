"""A road network of a town, and drives on it along shortest paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Track, Walk

__all__ = ["Roads", "build_roads", "drive", "end_at", "positions_on", "record"]

#: Share of the streets of the grid that a town lacks; the others still connect all crossings.
_MISSING = 0.2

#: Standard deviation of crossings about the grid, relative to a block.
_CROSSING_NOISE = 0.12

#: Seconds between arrival and departure that count as a wait; less is rounding.
_MIN_WAIT = 1e-6

#: No node; stands where a path has ended.
_NONE = -1

Floats = NDArray[np.float64]
Nodes = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Roads:
    """Straight roads between crossings, and the way from each crossing to each other.

    Parameters
    ----------
    nodes : float64 array, shape (V, 2)
        Crossings in metres.
    edges : int32 array, shape (E, 2)
        Both ends of each road.
    onward : int32 array, shape (V, V)
        ``onward[target, node]`` follows the node on a shortest path to the target.
    """

    nodes: Floats
    edges: Nodes
    onward: Nodes


def build_roads(blocks: int, block: float, rng: np.random.Generator) -> Roads:
    """Build the roads of a town: a square grid of uneven blocks with some streets missing.

    Parameters
    ----------
    blocks : int
        Blocks along each side, at least 1.
    block : float
        Mean metres between two crossings.
    rng : numpy.random.Generator
        Random numbers.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    # Crossings about the middle of the town, and all streets between neighbours.
    side = blocks + 1
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    nodes = block * (grid - blocks / 2 + rng.normal(0, _CROSSING_NOISE, grid.shape))
    number = np.arange(side**2, dtype=np.int32).reshape(side, side)
    streets = np.concatenate(
        [
            np.stack((number[:-1].ravel(), number[1:].ravel()), axis=1),
            np.stack((number[:, :-1].ravel(), number[:, 1:].ravel()), axis=1),
        ]
    )

    # Keep what connects the crossings, and most of the others.
    edges = streets[_kept_streets(streets, len(nodes), rng)]
    lengths = np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
    graph = coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(len(nodes), len(nodes)))

    # On an undirected graph, what precedes a node on the way from a target leads back to it.
    _, onward = dijkstra(graph.tocsr(), directed=False, return_predecessors=True)
    return Roads(nodes, edges, onward.astype(np.int32))


def _kept_streets(streets: Nodes, nodes: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Whether each street is built: all of a random spanning tree, and most of the others."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    weights = 1 + rng.random(len(streets))
    graph = coo_array((weights, (streets[:, 0], streets[:, 1])), shape=(nodes, nodes))
    tree = minimum_spanning_tree(graph.tocsr()).tocoo()
    in_tree = np.isin(streets[:, 0] * nodes + streets[:, 1], tree.row * nodes + tree.col)
    return in_tree | (rng.random(len(streets)) >= _MISSING)


def drive(
    name: str,
    roads: Roads,
    stops: Nodes,
    departures: Floats,
    speeds: Floats,
    *,
    wait: float = 0.0,
    until: float,
) -> Walk:
    """Drive from stop to stop along shortest paths.

    A drive begins at its departure, or after a wait on arrival at its start if that is later.

    Parameters
    ----------
    name : str
        Id of the track.
    roads : Roads
        The roads.
    stops : int32 array, shape (s + 1,)
        Nodes; two in a row differ.
    departures : float64 array, shape (s,)
        Earliest seconds at which each drive begins, not decreasing.
    speeds : float64 array, shape (s,)
        Metres a second of each drive.
    wait : float
        Least seconds between two drives.
    until : float
        The walk ends with the first node reached at this time or later. If there is none, it stays
        at its last stop until then.

    Returns
    -------
    Walk
        Nodes and times. A wait is the same node twice in a row.
    """
    # All paths side by side, from their starts to their ends.
    paths = _paths(roads, stops)
    is_node = paths != _NONE
    drives = np.repeat(np.arange(len(paths)), is_node.sum(axis=1))
    nodes = paths[is_node]

    # Metres from the start of the drive to each node; the first node of each has none.
    steps = np.zeros(len(nodes))
    steps[1:] = np.linalg.norm(np.diff(roads.nodes[nodes], axis=0), axis=1)
    first = np.flatnonzero(np.diff(drives, prepend=-1))
    steps[first] = 0.0
    seconds = np.cumsum(steps / speeds[drives])
    elapsed = seconds - seconds[first][drives]

    # Begin each drive after the one before: b(i) = max(departure(i), b(i-1) + d(i-1) + wait).
    ends = np.append(first[1:], len(nodes)) - 1
    before = np.append(0.0, np.cumsum(elapsed[ends] + wait)[:-1])
    begins = before + np.maximum.accumulate(departures - before)
    times = begins[drives] + elapsed

    # An arrival without a wait is the departure, too.
    later = np.append(True, np.diff(times) > _MIN_WAIT)
    return end_at(name, nodes[later], times[later], until)


def end_at(name: str, nodes: Nodes, times: Floats, until: float) -> Walk:
    """Return a walk that is cut after the first node reached at a time, or waits until then."""
    if times[-1] < until:
        nodes, times = np.append(nodes, nodes[-1]), np.append(times, until + 1.0)
    count = int(np.searchsorted(times, until)) + 1
    return Walk(name, nodes[:count], times[:count], np.zeros(count - 1, np.bool_))


def _paths(roads: Roads, stops: Nodes) -> Nodes:
    """Return the nodes of each drive in a row, which ends with -1 after the last node."""
    # All drives go on by one road at a time until the last one arrives.
    columns = [stops[:-1]]
    targets = stops[1:]
    while (columns[-1] != _NONE).any():
        here = columns[-1]
        going = (here != _NONE) & (here != targets)
        columns.append(np.where(going, roads.onward[targets, here], _NONE))
    return np.stack(columns, axis=1)


def positions_on(walk: Walk, nodes: Floats, times: Floats) -> Floats:
    """Return the true positions at given times; before and after the walk, those of its ends."""
    assert walk.times is not None
    corners = nodes[walk.nodes]
    return np.column_stack([np.interp(times, walk.times, column) for column in corners.T])


def record(walk: Walk, nodes: Floats, times: Floats, noise: Floats) -> tuple[Track, Floats, Walk]:
    """Record a walk at some of its times with position errors.

    Parameters
    ----------
    walk : Walk
        Nodes and times.
    nodes : float64 array, shape (V, 2)
        Crossings in metres.
    times : float64 array, shape (n,)
        Seconds of the samples, strictly increasing.
    noise : float64 array, shape (n, 2)
        Position errors in metres.

    Returns
    -------
    Track, float64 array of shape (n, 2), Walk
        The log, the true positions, and the walk with the time range of the log.
    """
    truth = positions_on(walk, nodes, times)
    ranges = times[[0, -1]][None]
    walk = Walk(walk.id, walk.nodes, walk.times, walk.gaps, ranges)
    return Track(walk.id, times, truth + noise), truth, walk
