"""A ring and a complete graph: where walks are the easiest and the hardest to compress."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import OptionError
from gpszip.model import Track, Walk
from gpszip.testing.log_with_truth import LogWithTruth, one_track

__all__ = ["complete_graph", "ring"]

#: Metres from the middle to each node.
_RADIUS = 100.0

Floats = NDArray[np.float64]


def ring(
    nodes: int = 24,
    *,
    laps: int = 20,
    samples: int = 1,
    seed: int = 1,
    noise: float = 0.0,
    id: str = "0",
) -> LogWithTruth:
    """Generate laps on a ring: the best case of walks on a map.

    Shortest paths reach half the ring, so that three waypoints hold a lap, however many nodes it
    has.

    Parameters
    ----------
    nodes : int
        Number of nodes, at least 3.
    laps : int
        Number of laps, at least 1.
    samples : int
        Number of samples for each edge, one a second; at least 1.
    seed : int
        Seed of the random generator; selects the errors.
    noise : float
        Standard deviation of the position error in metres.
    id : str
        Name of the track.

    Returns
    -------
    LogWithTruth
        One track of ``nodes * laps * samples + 1`` samples.

    Raises
    ------
    OptionError
        If a number is below the least one.

    Examples
    --------
    >>> ring(6, laps=10, samples=5)
    LogWithTruth(1 track, 301 samples, 6 nodes, 6 edges)
    """
    _check("ring", nodes, laps, samples)
    numbers = np.arange(nodes, dtype=np.int32)
    edges = np.stack((numbers, np.roll(numbers, -1)), axis=1)
    visited = (np.arange(nodes * laps + 1) % nodes).astype(np.int32)
    return _travel(id, _circle(nodes), edges, visited, samples, noise, np.random.default_rng(seed))


def complete_graph(
    nodes: int = 24,
    *,
    steps: int = 480,
    samples: int = 1,
    seed: int = 1,
    noise: float = 0.0,
    id: str = "0",
) -> LogWithTruth:
    """Generate a random walk on a complete graph: the worst case of walks on a map.

    Each edge is the only shortest path between its ends. So every node is a waypoint, and nothing
    tells which comes next.

    Parameters
    ----------
    nodes : int
        Number of nodes, at least 3; each is connected with each other one.
    steps : int
        Number of edges that the walk takes, at least 1.
    samples : int
        Number of samples for each edge, one a second; at least 1.
    seed : int
        Seed of the random generator; selects the walk and the errors.
    noise : float
        Standard deviation of the position error in metres.
    id : str
        Name of the track.

    Returns
    -------
    LogWithTruth
        One track of ``steps * samples + 1`` samples.

    Raises
    ------
    OptionError
        If a number is below the least one.

    Examples
    --------
    >>> complete_graph(6, steps=100)
    LogWithTruth(1 track, 101 samples, 6 nodes, 15 edges)
    """
    _check("complete graph", nodes, steps, samples)
    rng = np.random.default_rng(seed)
    edges = np.stack(np.triu_indices(nodes, 1), axis=1).astype(np.int32)

    # Each step goes on by 1 to nodes - 1 about the circle, to each other node alike.
    advances = rng.integers(1, nodes, steps)
    visited = (np.append(0, np.cumsum(advances)) % nodes).astype(np.int32)
    return _travel(id, _circle(nodes), edges, visited, samples, noise, rng)


def _check(name: str, nodes: int, steps: int, samples: int) -> None:
    """Raise OptionError if a number is below the least one."""
    if nodes < 3 or steps < 1 or samples < 1:
        raise OptionError(
            f"no {name} has {nodes} nodes, {steps} laps or steps, and {samples} samples an edge",
            remedy="give 3 nodes or more, and 1 or more of the others",
        )


def _circle(count: int) -> Floats:
    """Return nodes on a circle in metres, shape (count, 2); three are never in a line."""
    angles = 2 * np.pi * np.arange(count) / count
    return _RADIUS * np.column_stack([np.cos(angles), np.sin(angles)])


def _travel(
    name: str,
    nodes: Floats,
    edges: NDArray[np.int32],
    visited: NDArray[np.int32],
    samples: int,
    noise: float,
    rng: np.random.Generator,
) -> LogWithTruth:
    """Return the log of a walk that takes as many seconds for each edge as it has samples."""
    # Samples at shares of each edge, and at the last node.
    shares = np.arange(samples)[:, None] / samples
    begins, ends = nodes[visited[:-1], None], nodes[visited[1:], None]
    truth = np.concatenate([(begins + (ends - begins) * shares).reshape(-1, 2), ends[-1]])
    times = np.arange(len(truth), dtype=np.float64)
    track = Track(name, times, truth + rng.normal(0, noise, truth.shape))

    # Nodes are passed at every samples-th second.
    gaps = np.zeros(len(visited) - 1, np.bool_)
    walk = Walk(name, visited, times[::samples].copy(), gaps, times[[0, -1]][None])
    return one_track(track, truth, nodes, edges, walk)
