"""Networks and traversals of a few rows, for tests of histories."""

import numpy as np

from gpszip.history.traversals import Traversals
from gpszip.model import Network


def street(edges: int = 2) -> Network:
    """Edges of 100 m one after the other."""
    nodes = np.stack([100.0 * np.arange(edges + 1), np.zeros(edges + 1)], axis=1)
    start = np.arange(edges, dtype=np.int32)
    yes = np.ones(edges, bool)
    points = np.repeat(nodes, 2, axis=0)[1:-1]
    offsets = 2 * np.arange(edges + 1)
    return Network(nodes, start, start + 1, offsets, points, yes, yes, np.full(edges, np.nan))


def drives(rows: list[tuple[int, int, bool, float, float]]) -> Traversals:
    """Traversals of entire edges of 100 m from track, edge, forward, enter and leave."""
    track, edge, forward, enter, leave = map(np.array, zip(*rows, strict=True))
    starts = np.append(True, (np.diff(track) != 0) | (enter[1:] != leave[:-1]))
    return Traversals(
        tuple(f"car {i}" for i in range(track.max() + 1)),
        track.astype(np.int32),
        edge,
        forward,
        enter.astype(float),
        leave.astype(float),
        np.where(forward, 0.0, 100.0),
        np.where(forward, 100.0, 0.0),
        np.zeros(len(rows)),
        starts,
    )
