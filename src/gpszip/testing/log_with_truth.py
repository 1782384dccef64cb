"""A generated log with what it was generated from: the map, the walks, and the true positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Network, RoadMap, Track, Walk
from gpszip.model.text import count_text
from gpszip.walks.counting import build_road_map_from_counts, find_travelled_segments

__all__ = ["LogWithTruth", "join_truth", "one_track"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class LogWithTruth:
    """A generated log, and the truth that a program is to find in it.

    Tracks, positions and walks have one order.

    Parameters
    ----------
    tracks : tuple of Track
        The log: what a receiver wrote, with its noise, gaps and outliers.
    positions : tuple of float64 arrays, shape (n, d)
        Where each agent truly was at each sample of its track, in metres.
    road_map : RoadMap
        All roads, also those that nobody travelled, with the true number of traversals. Roads are
        straight between two nodes.
    walks : tuple of Walk
        The nodes that each agent passed, with the true times. Travel ends at the last sample, which
        may come before the last node. A walk has no gaps: the agent also travels where its receiver
        is off.

    Examples
    --------
    >>> from gpszip.testing import ring
    >>> log = ring(4, laps=2)
    >>> log
    LogWithTruth(1 track, 9 samples, 4 nodes, 4 edges)
    >>> log.walks[0].nodes.tolist(), log.road_map.forward.tolist()
    ([0, 1, 2, 3, 0, 1, 2, 3, 0], [2, 0, 2, 2])
    """

    tracks: tuple[Track, ...]
    positions: tuple[Floats, ...]
    road_map: RoadMap
    walks: tuple[Walk, ...]

    def __repr__(self) -> str:
        facts = (
            count_text(len(self.tracks), "track"),
            count_text(len(self), "sample"),
            count_text(len(self.road_map.nodes), "node"),
            count_text(len(self.road_map.edges), "edge"),
        )
        return f"LogWithTruth({', '.join(facts)})"

    def __len__(self) -> int:
        """Return the number of samples of all tracks."""
        return sum(map(len, self.tracks))

    @property
    def errors(self) -> tuple[Floats, ...]:
        """Metres between each sample and the true position at its time.

        Examples
        --------
        >>> from gpszip.testing import ring
        >>> ring(4, laps=1, noise=0.0).errors[0].max().item()
        0.0
        """
        return tuple(
            np.linalg.norm(track.positions - truth, axis=1)
            for track, truth in zip(self.tracks, self.positions, strict=True)
        )

    @property
    def network(self) -> Network:
        """The roads as a network for :func:`gpszip.match` and :func:`gpszip.patch`, both ways open.

        Examples
        --------
        >>> from gpszip.testing import ring
        >>> ring(4).network
        Network(4 nodes, 4 roads, 0.6 km, x, y)
        """
        edges, nodes = self.road_map.edges, self.road_map.nodes
        is_open = np.ones(len(edges), np.bool_)
        return Network(
            nodes,
            edges[:, 0],
            edges[:, 1],
            np.arange(0, 2 * len(edges) + 1, 2, dtype=np.int64),
            nodes[edges.ravel()],
            is_open,
            is_open,
            np.full(len(edges), np.nan),
        )


def one_track(
    track: Track, truth: Floats, nodes: Floats, edges: NDArray[np.int32], walk: Walk
) -> LogWithTruth:
    """Return the log of one track, with the traversals of its walk counted."""
    return join_truth([track], [truth], nodes, edges, [walk])


def join_truth(
    tracks: list[Track],
    truths: list[Floats],
    nodes: Floats,
    edges: NDArray[np.int32],
    walks: list[Walk],
) -> LogWithTruth:
    """Return the log of several tracks on one map, with the traversals of all walks counted.

    Parameters
    ----------
    tracks : list of Track
        The log.
    truths : list of float64 arrays, shape (n, d)
        True positions in metres.
    nodes : float64 array, shape (V, d)
        Positions of the crossings in metres.
    edges : int32 array, shape (E, 2)
        Both ends of each road.
    walks : list of Walk
        The walk of each track.
    """
    # Roads that nobody travelled are counted with zero.
    travelled = [
        np.stack((walk.nodes[:-1], walk.nodes[1:]), axis=1)[find_travelled_segments(walk)]
        for walk in walks
    ]
    pairs = np.concatenate([edges, *travelled])
    counts = np.ones(len(pairs), np.int64)
    counts[: len(edges)] = 0
    road_map = build_road_map_from_counts(nodes, pairs, counts)
    return LogWithTruth(tuple(tracks), tuple(truths), road_map, tuple(walks))
