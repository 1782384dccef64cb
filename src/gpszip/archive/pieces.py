"""Names of the pieces in which tracks with gaps come back."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gpszip.model.walk import Walk

__all__ = ["pieces_by_track"]


def pieces_by_track(walks: Sequence[Walk]) -> dict[str, list[tuple[str, slice]]]:
    """Name and knots of the pieces between gaps, for each track.

    A track without gaps keeps its name, any other has pieces ``id/0``, ``id/1``, ...; with more slashes where one of these names is taken.

    Examples
    --------
    >>> torn, whole = np.array([False, True, False]), np.zeros(3, bool)
    >>> nodes, times = np.arange(4, dtype=np.int32), np.arange(4.0)
    >>> found = pieces_by_track([Walk("a", nodes, times, torn), Walk("a/1", nodes, times, whole)])
    >>> [name for pieces in found.values() for name, _ in pieces]
    ['a//0', 'a//1', 'a/1']
    """
    ends = [[0, *(np.flatnonzero(walk.gaps) + 1).tolist(), len(walk.nodes)] for walk in walks]
    taken = {walk.id for walk, cuts in zip(walks, ends, strict=True) if len(cuts) == 2}
    found = {}
    for walk, cuts in zip(walks, ends, strict=True):
        names, slashes = [walk.id], "/"
        if len(cuts) > 2:
            while not taken.isdisjoint(names := [f"{walk.id}{slashes}{i}" for i in range(len(cuts) - 1)]):
                slashes += "/"
            taken.update(names)
        found[walk.id] = [(name, slice(a, b)) for name, (a, b) in zip(names, pairwise(cuts), strict=True)]
    return found
