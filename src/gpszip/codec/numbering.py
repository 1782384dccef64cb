"""Numbers of nodes in the order in which walks first visit them, as a payload has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpszip.model import GridWalk, GridWalks

__all__ = ["number_by_visit"]


def number_by_visit(walks: GridWalks, known: int = 0) -> GridWalks:
    """Number the nodes in the order in which the walks first visit them; drop those not visited.

    Parameters
    ----------
    walks : GridWalks
        Numbered in any way.
    known : int, default 0
        The first ``known`` nodes keep their numbers, visited or not.

    Examples
    --------
    >>> import numpy as np
    >>> walk = GridWalk(np.array([2, 0], np.int32), np.array([0, 1]), np.array([False]))
    >>> numbered = number_by_visit(GridWalks(np.array([[5, 5], [6, 6], [7, 7]]), (walk,)))
    >>> numbered.nodes.tolist(), numbered.walks[0].nodes.tolist()
    ([[7, 7], [5, 5]], [0, 1])
    """
    # Order the nodes by first visit.
    visits = np.zeros(0, np.int32)
    if walks.walks:
        visits = np.concatenate([walk.nodes for walk in walks.walks])
    # unique() sorts by number; the index of each node's first visit sorts by visit.
    visited, first = np.unique(visits[visits >= known], return_index=True)
    order = np.append(np.arange(known), visited[np.argsort(first)])

    # Renumber the walks.
    numbers = np.full(len(walks.nodes), -1, np.int32)
    numbers[order] = np.arange(len(order), dtype=np.int32)
    visits, ends = numbers[visits], np.cumsum([len(walk.nodes) for walk in walks.walks]).tolist()
    renumbered = tuple(
        GridWalk(visits[end - len(walk.nodes) : end], walk.time_steps, walk.gaps)
        for walk, end in zip(walks.walks, ends, strict=True)
    )
    return replace(walks, nodes=walks.nodes[order], walks=renumbered)
